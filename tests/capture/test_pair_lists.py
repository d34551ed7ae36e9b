"""Lists of pairs: images whose names they cannot hold have other names in the database meanwhile."""

from pathlib import Path

import pycolmap
import pytest

from plnerf.capture.pair_lists import listed_pairs, rename_images, stand_ins

NAMES = ["a.jpg", "IMG (1).jpg", "IMG (2).jpg", "#3.jpg", "4\n.jpg"]


@pytest.fixture
def database(tmp_path: Path) -> Path:
    with pycolmap.Database.open(tmp_path / "database.db") as db:
        camera = pycolmap.Camera.create_from_model_name(
            camera_id=1, model_name="PINHOLE", focal_length=100.0, width=64, height=64
        )
        number = db.write_camera(camera)
        for name in NAMES:
            db.write_image(pycolmap.Image(name=name, camera_id=number))
    return tmp_path / "database.db"


def names_in(database: Path) -> list[str]:
    with pycolmap.Database.open(database) as db:
        return [image.name for image in db.read_all_images()]


def test_every_line_names_two_images_of_the_database(database: Path) -> None:
    listing = database.with_name("pairs.txt")
    pairs = [(a, b) for i, a in enumerate(NAMES) for b in NAMES[:i]]
    with listed_pairs(database, listing, NAMES, pairs):
        now = names_in(database)
        lines = [line.split(" ") for line in listing.read_text().splitlines()]
        place = {name: now[i] for i, name in enumerate(NAMES)}
        assert lines == [[place[a], place[b]] for a, b in pairs]
        assert now[0] == "a.jpg" and not any(name.startswith("#") for name in now)
    assert names_in(database) == NAMES


def test_names_come_back_after_an_error_and_after_a_kill(database: Path) -> None:
    with pytest.raises(RuntimeError), listed_pairs(database, database.with_name("pairs.txt"), NAMES, []):
        raise RuntimeError
    assert names_in(database) == NAMES
    rename_images(database, stand_ins(NAMES))
    rename_images(database, {new: old for old, new in stand_ins(NAMES[::-1]).items()})  # the next call
    assert names_in(database) == NAMES
