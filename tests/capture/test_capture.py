"""Photos with positions, and a video, become scenes that the rest of the program reads."""

import json
import shutil
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pytest
from PIL import ExifTags, Image
from tests.capture.test_frames import seen, video  # noqa: F401 (a fixture)
from tests.capture.test_sfm import COUNT, FOCAL, H, W, poses, steps

from plnerf.capture.capture import CaptureConfig, _Chosen, _chosen_before, _Inputs, capture
from plnerf.capture.frames import Taken
from plnerf.capture.local_frame import LocalFrame
from plnerf.capture.photos import bring_upright, find_photos
from plnerf.capture.sfm import SfmConfig
from plnerf.capture.summary import read_report, summary
from plnerf.cli.main import main
from plnerf.errors import CaptureError, ConfigError
from plnerf.scene.formats import read_listing
from plnerf.scene.formats_colmap import read_colmap
from plnerf.scene.scene import load_scene
from plnerf.scene.transforms import Frames

PLACE = LocalFrame("EPSG:4979", (8.5, 47.4, 450.0))
CONFIG = CaptureConfig(SfmConfig(camera_model="SIMPLE_PINHOLE", features=1500, threads=1))


def dms(value: float) -> tuple[float, float, float]:
    minutes = abs(value) % 1 * 60
    return (float(int(abs(value))), float(int(minutes)), minutes % 1 * 60)


def photos_with_positions(folder: Path) -> np.ndarray:
    """The drawn scene as JPEG with GPS tags, ten times as large; returns the centres in metres.

    z of the drawing points down: half a turn about x makes it point up.
    """
    centres = steps(folder / "png") * [10, -10, -10]
    G = ExifTags.GPS
    for i, (longitude, latitude, height) in enumerate(PLACE.to_crs(centres)):
        image = Image.open(folder / "png" / f"{i:02d}.png")
        exif = image.getexif()
        exif.get_ifd(ExifTags.IFD.GPSInfo).update({
            G.GPSLatitudeRef: "N", G.GPSLatitude: dms(latitude), G.GPSLongitudeRef: "E",
            G.GPSLongitude: dms(longitude), G.GPSAltitudeRef: b"\0", G.GPSAltitude: float(height),
        })  # fmt: skip
        image.save(folder / f"{i:02d}.jpg", quality=97, exif=exif)
    return centres


class Captured(NamedTuple):
    """A folder with photos and what `capture` made of them, and the true camera centres in metres."""

    folder: Path
    truth: np.ndarray

    def copied(self, folder: Path) -> np.ndarray:
        """Copies both, with the times of files; returns the centres."""
        shutil.copytree(self.folder, folder, dirs_exist_ok=True)
        return self.truth


@pytest.fixture(scope="module")
def captured(tmp_path_factory: pytest.TempPathFactory) -> Captured:
    folder = tmp_path_factory.mktemp("captured")
    truth = photos_with_positions(folder / "photos")
    (folder / "photos" / "broken.jpg").write_bytes(b"\xff\xd8 no more")
    whole = (folder / "photos" / "04.jpg").read_bytes()
    (folder / "photos" / "cut-off.jpg").write_bytes(whole[: len(whole) // 3])  # its header is fine
    capture(folder / "photos", folder / "scene", CONFIG)
    return Captured(folder, truth)


def test_photos_become_a_scene_in_metres(captured: Captured, tmp_path: Path) -> None:
    truth, path = captured.copied(tmp_path), tmp_path / "scene" / "transforms.json"
    report = json.loads((tmp_path / "scene" / "capture.json").read_text())
    assert report["registered"] == COUNT and not report["failed"]
    assert any("cut-off.jpg: its pixels cannot be read (" in text for text in report["left_out"])
    (tmp_path / "photos" / "cut-off.jpg").unlink()
    assert any("broken.jpg" in text for text in report["left_out"])
    # Positions good to 3 m do not hold the turn about a track of 60 m.
    assert report["georeference"]["held_by"].startswith("positions and cameras taken for level")

    places = (" ".join(map(str, xyz)) for xyz in PLACE.to_crs(truth))
    rows = [f"{i:02d}.jpg {place} 0 0 0 0.02 0.02" for i, place in enumerate(places)]
    (tmp_path / "photos" / "geo.txt").write_text("\n".join(["EPSG:4979", *rows]))
    told: list[str] = []
    capture(tmp_path / "photos", tmp_path / "scene", CONFIG, lambda stage, done, of: told.append(stage))
    assert "features" in told and told.count("model") == 1  # structure from motion is not done again
    listing = read_listing(path)
    assert listing.unit == "m" and listing.crs == "EPSG:4979" and len(listing.shots) == COUNT
    frame = LocalFrame.from_json(json.loads(path.read_text())["plnerf"])
    found = PLACE.to_local(frame.to_crs(np.stack([shot.T_world_camera[:3, 3] for shot in listing.shots])))
    track = np.linalg.norm(np.diff(truth, axis=0), axis=1).sum()
    assert np.linalg.norm(found - truth, axis=1).max() < 0.01 * track
    forward = np.stack([shot.T_world_camera[:3, 2] for shot in listing.shots])
    assert (forward[:, 2] < -0.8).all()  # they look down
    report = json.loads((tmp_path / "scene" / "capture.json").read_text())
    assert report["georeference"]["held_by"] == "positions"
    assert report["georeference"]["residual_worst_m"] < 0.01 * track
    scene = load_scene(tmp_path / "scene", store=tmp_path / "pixels")
    assert scene.frames.origin is not None and tuple(scene.frames.origin) == frame.origin
    assert Frames.from_json(scene.frames.to_json()).origin == pytest.approx(frame.origin, abs=0)
    assert len(scene.train) + len(scene.test) == COUNT
    model = read_colmap(tmp_path / "scene")
    for one, other in zip(model.shots, listing.shots, strict=True):
        assert np.abs(one.T_world_camera - other.T_world_camera).max() < 1e-9


def test_control_points_in_the_photos_hold_the_scene(captured: Captured, tmp_path: Path) -> None:
    """Without them, positions good to 3 m leave it degrees off: with four on the floor it is in its place.

    Two more say how well.  Heights that are above something else than those of good positions are an error.
    """
    truth = captured.copied(tmp_path)
    lines = ["EPSG:4979"]
    for k, (x, y) in enumerate([(2.2, 1.0), (3.2, 2.2), (4.0, 1.2), (4.6, 2.0), (2.8, 1.6), (4.9, 1.5)]):
        place = PLACE.to_crs(np.array([[10 * x, -10 * y, 0.0]]))[0]
        for i, pose in enumerate(poses()):
            u, v, depth = pose[:3, :3].T @ (np.array([x, y, 0.0]) - pose[:3, 3])
            px, py = FOCAL * u / depth + W / 2, FOCAL * v / depth + H / 2
            if 0 < px < W and 0 < py < H:
                lines.append(f"{place[0]:.10f} {place[1]:.10f} {place[2]:.4f} {px} {py} {i:02d}.jpg p{k}")
                lines[-1] += " check" * (k in {1, 4})
    (tmp_path / "photos" / "gcp_list.txt").write_text("\n".join(lines))
    listing = read_listing(capture(tmp_path / "photos", tmp_path / "scene", CONFIG))
    report = json.loads((tmp_path / "scene" / "capture.json").read_text())["georeference"]
    assert (
        report["source"] == "the photos' GPS tags and 4 control points" and report["held_by"] == "positions"
    )
    frame = LocalFrame.from_json(json.loads((tmp_path / "scene" / "transforms.json").read_text())["plnerf"])
    found = PLACE.to_local(frame.to_crs(np.stack([shot.T_world_camera[:3, 3] for shot in listing.shots])))
    track = np.linalg.norm(np.diff(truth, axis=0), axis=1).sum()
    assert np.linalg.norm(found - truth, axis=1).max() < 0.01 * track
    assert (report["control"]["n"], report["check"]["n"]) == (4, 2)
    assert max(report["check"]["rmse_h_m"], report["check"]["rmse_v_m"]) < 0.005 * track
    assert {one["name"] for one in report["points"] if one["role"] == "check"} == {"p1", "p4"}
    said = summary(read_report(tmp_path / "scene"))
    assert "Control points, n = 4: RMSE_H 0." in said and "Check points, n = 2 (the standard asks" in said

    places = (" ".join(map(str, xyz)) for xyz in PLACE.to_crs(truth + np.array([0.0, 0.0, 47.0])))
    rows = [f"{i:02d}.jpg {place} 0 0 0 0.05 0.05" for i, place in enumerate(places)]
    (tmp_path / "photos" / "geo.txt").write_text("\n".join(["EPSG:4979", *rows]))
    before = (tmp_path / "scene" / "transforms.json").read_bytes()
    with pytest.raises(CaptureError, match=r"only 0 agree .* they lie 4\d\.\d\d m lower"):
        capture(tmp_path / "photos", tmp_path / "scene", CONFIG)
    assert (tmp_path / "scene" / "transforms.json").read_bytes() == before


@pytest.mark.slow
def test_a_video_becomes_an_unscaled_scene(video: Path, tmp_path: Path) -> None:  # noqa: F811 (a fixture)
    listing = read_listing(capture(video, tmp_path / "scene", CONFIG))
    report = json.loads((tmp_path / "scene" / "capture.json").read_text())
    kept = [one["name"] for one in report["frames"] if one["kept"]]
    assert len(report["frames"]) == 40 and 3 <= len(kept) == report["images"] <= 12
    assert listing.unit == "unscaled" and report["georeference"] is None
    assert report["not_georeferenced_because"] == "no image says where it was taken"
    assert {shot.path.stem for shot in listing.shots} <= set(kept)
    assert listing.up is not None and list(listing.up) == [0, 0, 1]
    assert all(shot.T_world_camera[2, 2] < -0.99 for shot in listing.shots)  # they look straight down
    told: list[str] = []
    capture(video, tmp_path / "scene", CONFIG, lambda stage, done, of: told.append(f"{stage} {done}"))
    assert not any(text.startswith("video") for text in told)  # neither looked at again
    assert told[0] == f"features {len(kept)}"  # nor put together again


@pytest.mark.parametrize("text", ["{", "[]", '{"inputs": [], "frames": []}', "[" * 9999, '{"frames": [{}]}'])
def test_a_damaged_choice_of_frames_is_made_again(text: str, tmp_path: Path) -> None:
    inputs = _Inputs("flight.mp4", 1, 2, 0.92, 0.75)
    one = Taken("000000", None, 1.0, None, False, "blurred", False)
    whole = asdict(_Chosen(inputs, (one,)))
    path = tmp_path / "frames.json"
    path.write_text(json.dumps(whole))
    assert _chosen_before(path, inputs, tmp_path) == [one]
    assert _chosen_before(path, replace(inputs, size=2), tmp_path) is None
    path.write_text(text)
    assert _chosen_before(path, inputs, tmp_path) is None


@pytest.mark.slow
def test_a_video_that_is_cut_off_is_used_and_told(tmp_path: Path) -> None:
    path = tmp_path / "flight.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 25.0, (320, 200))
    for i in range(30):
        writer.write(cv2.cvtColor(seen(9.0 * i), cv2.COLOR_RGB2BGR))
    writer.release()
    data = path.read_bytes()
    path.write_bytes(data[: 2 * len(data) // 3])
    capture(path, tmp_path / "scene", CONFIG)
    left_out = json.loads((tmp_path / "scene" / "capture.json").read_text())["left_out"]
    assert any("flight.avi: says 30 pictures" in text and "cut off" in text for text in left_out)


def test_photos_are_turned_upright(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    picture = np.zeros((30, 40, 3), np.uint8)
    picture[:10] = 255
    image = Image.fromarray(picture)
    exif = image.getexif()
    exif[ExifTags.Base.Orientation] = 6  # to be turned right by 90 degrees
    image.save(tmp_path / "in" / "turned.png", exif=exif)
    image.save(tmp_path / "in" / "level.png")
    facts = bring_upright(find_photos(tmp_path / "in"), tmp_path / "out").facts
    turned = cv2.imread(
        str(tmp_path / "out" / "turned.png"), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    )
    assert turned.shape == (40, 30, 3) and (turned[:, -10:] == 255).all() and not turned[:, :-10].any()
    assert (facts["turned.png"].width_px, facts["turned.png"].height_px) == (30, 40)
    assert facts["turned.png"].camera != facts["level.png"].camera  # they cannot share a lens
    assert (tmp_path / "out" / "level.png").read_bytes() == (tmp_path / "in" / "level.png").read_bytes()


def test_photos_in_their_own_scene_folder_must_be_upright(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    image = Image.fromarray(np.zeros((30, 40, 3), np.uint8))
    exif = image.getexif()
    image.save(tmp_path / "images" / "a.jpg")
    facts = bring_upright(find_photos(tmp_path / "images"), tmp_path / "images").facts
    assert list(facts) == ["a.jpg"]
    exif[ExifTags.Base.Orientation] = 3
    image.save(tmp_path / "images" / "b.jpg", exif=exif)
    with pytest.raises(CaptureError, match=r"b\.jpg and 0 more of the photos in .* not stored upright"):
        bring_upright(find_photos(tmp_path / "images"), tmp_path / "images")


def test_folders_without_photos_are_told(tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match="is no folder of photos"):
        capture(tmp_path / "absent", tmp_path / "out", CONFIG)
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "IMG_1.HEIC").write_bytes(b"heic")
    with pytest.raises(CaptureError, match=r"has 0 photos .* 1 are HEIC or raw \(IMG_1\.HEIC\)"):
        capture(tmp_path / "in", tmp_path / "out", CONFIG)
    assert not (tmp_path / "out" / "transforms.json").exists()


def test_the_command_tells_what_came_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    photos_with_positions(tmp_path / "photos")
    for path in sorted((tmp_path / "photos").glob("*.jpg")):
        path.rename(path.with_name(f"IMG ({path.stem}).jpg"))  # as Windows numbers copies
    Image.fromarray(np.full((240, 320, 3), 90, np.uint8)).save(tmp_path / "photos" / "grey.jpg")
    words = [
        "plnerf",
        "capture",
        str(tmp_path / "photos"),
        "-o",
        str(tmp_path / "scene"),
        "--features",
        "1500",
    ]
    monkeypatch.setattr(sys, "argv", [*words, "--camera-model", "SIMPLE_PINHOLE"])
    main()
    out = capsys.readouterr().out
    assert f"{COUNT} of {COUNT + 1} images have a pose" in out and str(tmp_path / "scene") in out
    assert "No pose: grey.jpg: hardly a feature: blurred, dark, or without texture." in out
    where = "Georeferenced in WGS 84 (EPSG:4326), heights above what is not stated"
    assert f"{where}, by {COUNT} of {COUNT} positions (the photos' GPS tags)" in " ".join(out.split())
    assert "hold the turn about their main direction to" in out


def test_a_wrong_overlap_is_told() -> None:
    with pytest.raises(ConfigError, match=r"must lie above 0 and below 0\.92, but is 0\.95"):
        CaptureConfig(least=0.95)
