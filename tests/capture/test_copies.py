"""Copies of photos in a scene: never shared with the originals, and made again where a photo was replaced."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image

from plnerf.capture.copies import RECORD
from plnerf.capture.photos import Photos, bring_upright, find_photos


def put(path: Path, grey: int, orientation: int = 1) -> None:
    """A photo in a file of its own, as a camera or a download replaces one."""
    path.parent.mkdir(exist_ok=True)
    path.unlink(missing_ok=True)
    image = Image.fromarray(np.full((30, 40, 3), grey, np.uint8))
    exif = image.getexif()
    exif[ExifTags.Base.Orientation] = orientation
    image.save(path, exif=exif)


def copied(folder: Path) -> Photos:
    return bring_upright(find_photos(folder / "in"), folder / "out")


def grey(path: Path) -> int:
    with Image.open(path) as image:
        return int(np.asarray(image).max())


@pytest.mark.parametrize("orientation", [1, 6])
def test_a_photo_replaced_under_its_name_is_copied_again(orientation: int, tmp_path: Path) -> None:
    for name, value in (("a.png", 10), ("b.png", 20)):
        put(tmp_path / "in" / name, value, orientation)
    copied(tmp_path)
    before = {name: (tmp_path / "out" / name).stat().st_mtime_ns for name in ("a.png", "b.png")}
    stat = (tmp_path / "in" / "a.png").stat()
    put(tmp_path / "in" / "a.png", 11, orientation)
    os.utime(tmp_path / "in" / "a.png", ns=(stat.st_atime_ns, stat.st_mtime_ns))  # as `cp -p` leaves it
    assert (tmp_path / "in" / "a.png").stat().st_size == stat.st_size
    copied(tmp_path)
    assert grey(tmp_path / "out" / "a.png") == 11 and grey(tmp_path / "out" / "b.png") == 20
    # What did not change is not written again: structure from motion goes by the time.
    assert (tmp_path / "out" / "b.png").stat().st_mtime_ns == before["b.png"]
    copied(tmp_path)
    assert (tmp_path / "out" / "b.png").stat().st_mtime_ns == before["b.png"]


def test_a_copy_that_was_changed_or_has_no_record_is_made_again(tmp_path: Path) -> None:
    put(tmp_path / "in" / "a.png", 10)
    copied(tmp_path)
    put(tmp_path / "out" / "a.png", 99)
    copied(tmp_path)
    assert grey(tmp_path / "out" / "a.png") == 10
    for record in ("{", "[]", '{"format_version": 1, "photos": []}', "[" * 100_000):
        put(tmp_path / "out" / "a.png", 99)
        (tmp_path / RECORD).write_text(record)
        copied(tmp_path)
        assert grey(tmp_path / "out" / "a.png") == 10


def test_a_copy_shares_nothing_with_the_photo(tmp_path: Path) -> None:
    """Nor does one that an earlier version, or a program that looks for duplicates, linked."""
    put(tmp_path / "in" / "a.png", 10)
    copied(tmp_path)
    assert not (tmp_path / "out" / "a.png").samefile(tmp_path / "in" / "a.png")
    for link in (os.link, os.symlink):
        (tmp_path / "out" / "a.png").unlink()
        link(tmp_path / "in" / "a.png", tmp_path / "out" / "a.png")
        record = json.loads((tmp_path / RECORD).read_text())
        stat = (tmp_path / "out" / "a.png").stat()
        record["photos"]["a.png"][1:] = [stat.st_size, stat.st_mtime_ns]  # though it is as it was recorded
        (tmp_path / RECORD).write_text(json.dumps(record))
        copied(tmp_path)
        assert not (tmp_path / "out" / "a.png").samefile(tmp_path / "in" / "a.png")
        assert grey(tmp_path / "in" / "a.png") == grey(tmp_path / "out" / "a.png") == 10


def test_a_photo_replaced_by_a_damaged_one_is_left_out(tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        put(tmp_path / "in" / name, 10)
    copied(tmp_path)
    data = (tmp_path / "in" / "a.png").read_bytes()
    (tmp_path / "in" / "a.png").write_bytes(data[:-30])
    photos = copied(tmp_path)
    assert list(photos.facts) == ["b.png"]
    assert photos.problems[0].startswith("a.png: its pixels cannot be read (")


def test_photos_in_their_own_scene_stay_as_they_are(tmp_path: Path) -> None:
    put(tmp_path / "in" / "a.png", 10)
    photos = bring_upright(find_photos(tmp_path / "in"), tmp_path / "in")
    assert list(photos.facts) == ["a.png"] and not (tmp_path / RECORD).exists()
