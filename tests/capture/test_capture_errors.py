"""Everything a capture can be given by mistake ends in one paragraph, and leaves no half-written file.

The texts are stored in tests/snapshots/capture_*.txt; ``pytest --update-snapshots`` writes them anew.
"""

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import ExifTags, Image
from tests.capture.test_capture import photos_with_positions
from tests.capture.test_frames import ground, seen

from plnerf.cli.main import main

Spoil = Callable[[Path], Path]
CASES: dict[str, Spoil] = {}
G = ExifTags.GPS


def case(spoil: Spoil) -> Spoil:
    """A case makes the source in a folder of its own and returns it."""
    CASES[spoil.__name__] = spoil
    return spoil


def write_video(path: Path, count: int) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 25.0, (320, 200))
    for i in range(count):
        writer.write(cv2.cvtColor(seen(9.0 * i), cv2.COLOR_RGB2BGR))
    writer.release()
    return path


def write_photos(folder: Path, pictures: list[np.ndarray]) -> Path:
    folder.mkdir()
    for i, picture in enumerate(pictures):
        Image.fromarray(picture).save(folder / f"{i}.jpg", quality=95)
    return folder


@case
def absent(folder: Path) -> Path:
    return folder / "photos"


@case
def no_photos(folder: Path) -> Path:
    return write_photos(folder / "photos", [])


@case
def one_photo(folder: Path) -> Path:
    return write_photos(folder / "photos", [seen(0)])


@case
def no_overlap(folder: Path) -> Path:
    return write_photos(folder / "photos", [ground(30 + i)[:200, :320] for i in range(4)])


@case
def without_texture(folder: Path) -> Path:
    return write_photos(folder / "photos", [np.full((200, 320, 3), 90 + i, np.uint8) for i in range(4)])


@case
def all_cut_off(folder: Path) -> Path:
    photos = write_photos(folder / "photos", [seen(0), seen(30)])
    for path in photos.iterdir():
        path.write_bytes(path.read_bytes()[:400])
    return photos


@case
def heic_and_raw(folder: Path) -> Path:
    photos = write_photos(folder / "photos", [])
    for name in ("IMG_1.HEIC", "IMG_2.heic", "DJI_3.DNG"):
        (photos / name).write_bytes(b"as the phone stored it")
    return photos


@case
def video_without_pictures(folder: Path) -> Path:
    return write_video(folder / "flight.avi", 0)


@case
def video_cut_off_at_its_head(folder: Path) -> Path:
    path = write_video(folder / "flight.avi", 20)
    path.write_bytes(path.read_bytes()[:300])
    return path


@case
def no_video_at_all(folder: Path) -> Path:
    (folder / "flight.mp4").write_text("notes of the flight")
    return folder / "flight.mp4"


@case
def video_of_one_place(folder: Path) -> Path:
    path = folder / "hover.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 25.0, (320, 200))
    for _ in range(20):
        writer.write(cv2.cvtColor(seen(0.0), cv2.COLOR_RGB2BGR))
    writer.release()
    return path


@case
def a_broken_geo_txt(folder: Path) -> Path:
    photos = write_photos(folder / "photos", [seen(30.0 * i) for i in range(4)])
    (photos / "geo.txt").write_text("EPSG:4326\n0.jpg 8.5 north 400\n")
    return photos


def told(
    arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], folder: Path
) -> str:
    monkeypatch.setattr(sys, "argv", ["plnerf", *arguments])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 1
    text = capsys.readouterr().err.strip()
    assert "Traceback" not in text
    return re.sub(re.escape(str(folder)), "FOLDER", text)


@pytest.mark.parametrize("name", CASES)
def test_a_bad_capture_is_told_and_leaves_nothing_half_written(
    name: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    snapshot: Callable[[str, str], None],
) -> None:
    source = CASES[name](tmp_path)
    text = told(["capture", str(source), "-o", str(tmp_path / "scene")], monkeypatch, capsys, tmp_path)
    snapshot(f"capture_{name}", text)
    left = [path.name for path in tmp_path.rglob("*") if "partial" in path.name or ".part" in path.name]
    assert not left
    assert not (tmp_path / "scene" / "transforms.json").exists()
    assert not (tmp_path / "scene" / "capture.json").exists()


def test_a_scene_that_cannot_be_written_is_told(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    snapshot: Callable[[str, str], None],
) -> None:
    source = write_photos(tmp_path / "photos", [seen(30.0 * i) for i in range(4)])
    (tmp_path / "file").write_text("in the way")  # as permissions do, also for root
    out = tmp_path / "file" / "scene"
    snapshot(
        "capture_unwritable", told(["capture", str(source), "-o", str(out)], monkeypatch, capsys, tmp_path)
    )
    assert (tmp_path / "file").read_text() == "in the way"


@pytest.mark.slow
def test_photos_of_one_stated_place_become_an_unscaled_scene(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A receiver that stood still, and one photo of another camera: used, and said."""
    photos = tmp_path / "photos"
    photos_with_positions(photos)
    first = Image.open(photos / "00.jpg").getexif()
    for path in sorted(photos.glob("*.jpg")):
        Image.open(path).save(path, quality=97, exif=first)
    Image.open(photos / "03.jpg").resize((400, 300), Image.Resampling.LANCZOS).save(
        photos / "03.jpg", quality=97, exif=first
    )
    arguments = ["capture", str(photos), "-o", str(tmp_path / "scene"), "--features", "1500"]
    monkeypatch.setattr(sys, "argv", ["plnerf", *arguments, "--camera-model", "SIMPLE_PINHOLE"])
    main()
    out = capsys.readouterr().out
    assert "Not georeferenced, lengths are unscaled: All 9 positions are the same" in out
    data = json.loads((tmp_path / "scene" / "transforms.json").read_text())
    assert data["plnerf"]["unit"] == "unscaled" and data["plnerf"]["crs"] is None
    assert {(frame["w"], frame["h"]) for frame in data["frames"]} == {(320, 240), (400, 300)}
