"""Structure from motion on a drawn scene: poses come back, work is kept, and images that fail say why."""

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import pytest
from PIL import Image
from tests.capture.test_frames import ground
from tests.conftest import look_at

from plnerf.capture.exif import read_facts
from plnerf.capture.pairs import PairConfig, choose_pairs
from plnerf.capture.sfm import SfmConfig, SfmResult, _camera, _number_of, reconstruct, tolerance_px
from plnerf.capture.similarity import fit_similarity
from plnerf.errors import CaptureError, ConfigError
from plnerf.scene.colmap import pycolmap

W, H, FOCAL, COUNT = 320, 240, 300.0, 9
PER_METRE = 120.0  # texture pixels


def centres() -> np.ndarray:
    s = np.linspace(0, 1, COUNT)
    return np.stack([2 + 6 * s, 1.2 + 0.5 * np.sin(4 * s), -3.0 + 0.4 * np.cos(5 * s)], 1)


def floor_picture(pose: np.ndarray, texture: np.ndarray, z: float) -> np.ndarray:
    """A textured plane of height z (z points down) as the camera sees it; NaN-free, black where none."""
    R, t = pose[:3, :3].T, -pose[:3, :3].T @ pose[:3, 3]
    K = np.array([[FOCAL, 0, (W - 1) / 2], [0, FOCAL, (H - 1) / 2], [0, 0, 1]])  # OpenCV's pixels begin at 0
    plane = K @ np.stack([R[:, 0], R[:, 1], R[:, 2] * z + t], 1) @ np.diag([1 / PER_METRE, 1 / PER_METRE, 1])
    return cv2.warpPerspective(texture, plane, (W, H), flags=cv2.INTER_AREA)


def poses() -> list[np.ndarray]:
    """Camera to the drawing, looking down, each another way aside."""
    aside = [np.array([0.15 + 0.9 * np.sin(3 * i), 0.1 + 0.6 * np.cos(2 * i), 3.0]) for i in range(COUNT)]
    return [look_at(centre, centre + to) for centre, to in zip(centres(), aside, strict=True)]


def steps(folder: Path) -> np.ndarray:
    """Photos of a floor with a step on it; returns the camera centres."""
    folder.mkdir(parents=True)
    low, high = ground(1), ground(2)
    high[:, : 2 * W] = 0  # the step covers what is further on
    for i, pose in enumerate(poses()):
        picture = floor_picture(pose, low, 0.0)
        raised = floor_picture(pose, high, -1.0)
        picture[raised.any(2)] = raised[raised.any(2)]
        Image.fromarray(picture).save(folder / f"{i:02d}.png")
    return centres()


def run(
    folder: Path, work: Path, cut_at: str = "", told: list[str] | None = None
) -> tuple[SfmResult, list[str]]:
    """The result and the progress; cut_at: progress at which it is interrupted, which `told` holds then."""
    facts = {path.name: read_facts(path) for path in sorted(folder.glob("*.png"))}
    told = [] if told is None else told

    def tell(stage: str, done: int, of: int) -> None:
        told.append(f"{stage} {done}/{of}")
        if told[-1] == cut_at:
            raise KeyboardInterrupt

    result = reconstruct(
        folder, facts, work, choose_pairs(len(facts), PairConfig()),
        SfmConfig(camera_model="SIMPLE_PINHOLE", features=1500, threads=1),
        tell=tell,
    )  # fmt: skip
    return result, told


def cut(folder: Path, at: str) -> list[str]:
    """The progress up to where a reconstruction is interrupted."""
    told: list[str] = []
    with pytest.raises(KeyboardInterrupt):
        run(folder / "images", folder / "work", at, told)
    return told


@pytest.mark.slow
def test_poses_come_back_and_work_is_kept(tmp_path: Path) -> None:
    truth = steps(tmp_path / "images")
    Image.fromarray(np.full((H, W, 3), 90, np.uint8)).save(tmp_path / "images" / "90.png")
    Image.fromarray(ground(7)[:H, :W]).save(tmp_path / "images" / "91.png")
    found, told = run(tmp_path / "images", tmp_path / "work")
    assert found.registered == tuple(f"{i:02d}.png" for i in range(COUNT))
    assert found.failed["90.png"].startswith("hardly a feature")
    assert found.failed["91.png"].startswith("matches no other image")
    assert found.reprojection_px < 1 and found.points > 200
    assert list(found.seconds) == ["features", "matches", "model"]
    assert told[0] == "features 0/11" and "features 11/11" in told and "matches 55/55" in told
    model = found.reconstruction
    x = np.array([model.find_image_with_name(name).projection_center() for name in found.registered])
    off = fit_similarity(x, truth)(x) - truth
    track = np.linalg.norm(np.diff(truth, axis=0), axis=1).sum()
    assert np.linalg.norm(off, axis=1).max() < 0.01 * track

    again, told = run(tmp_path / "images", tmp_path / "work")
    assert told == ["features 11/11", "matches 55/55", "model 11/11"]
    assert again.registered == found.registered and again.failed == found.failed

    (tmp_path / "images" / "90.png").unlink()  # another set of images is another reconstruction
    assert cut(tmp_path, "features 0/10") == ["features 0/10"]
    assert not any((tmp_path / "work").glob("models*"))


@pytest.mark.slow
def test_a_lens_that_is_not_fitted_stays_as_photos_state_it(tmp_path: Path) -> None:
    truth = steps(tmp_path / "images")
    bare = {path.name: read_facts(path) for path in sorted((tmp_path / "images").glob("*.png"))}
    config = SfmConfig(camera_model="SIMPLE_PINHOLE", fit_lens=False, features=1500, threads=1)
    pairs = choose_pairs(COUNT, PairConfig())
    with pytest.raises(CaptureError, match=r"9 of 9 state no focal length \(00\.png\)"):
        reconstruct(tmp_path / "images", bare, tmp_path / "work", pairs, config)
    stated = FOCAL + 2  # what is fitted comes out as 300, or anything else but this
    facts = {name: replace(fact, focal_px=stated) for name, fact in bare.items()}
    found = reconstruct(tmp_path / "images", facts, tmp_path / "work", pairs, config)
    model = found.reconstruction
    assert len(found.registered) == COUNT
    assert {camera.params[0] for camera in model.cameras.values()} == {stated}
    x = np.array([model.find_image_with_name(name).projection_center() for name in found.registered])
    track = np.linalg.norm(np.diff(truth, axis=0), axis=1).sum()
    assert np.linalg.norm(fit_similarity(x, truth)(x) - truth, axis=1).max() < 0.02 * track


@pytest.mark.slow
def test_many_images_are_mapped_in_blocks(tmp_path: Path) -> None:
    """Nine images in blocks of seven, which five images join: one model, as good as that of all at once."""
    truth = steps(tmp_path / "images")
    facts = {path.name: read_facts(path) for path in sorted((tmp_path / "images").glob("*.png"))}
    config = SfmConfig(camera_model="SIMPLE_PINHOLE", features=1500, threads=1, block=7)
    told: list[str] = []
    found = reconstruct(
        tmp_path / "images", facts, tmp_path / "work", choose_pairs(COUNT, PairConfig()), config,
        tell=lambda stage, done, of: told.append(f"{stage} {done}/{of}"),
    )  # fmt: skip
    assert len(found.registered) == COUNT
    assert "model 1/9" not in told and told[-1] == "model 9/9"
    assert found.reprojection_px < 1 and len(found.reconstruction.cameras) == 1
    x = np.array([found.reconstruction.find_image_with_name(name).projection_center() for name in facts])
    track = np.linalg.norm(np.diff(truth, axis=0), axis=1).sum()
    assert np.linalg.norm(fit_similarity(x, truth)(x) - truth, axis=1).max() < 0.01 * track


@pytest.mark.slow
def test_it_goes_on_where_it_was_cut_off(tmp_path: Path) -> None:
    """Three times, in each of its stages."""
    steps(tmp_path / "images")
    assert cut(tmp_path, "features 8/9")[0] == "features 0/9"
    assert cut(tmp_path, "matches 0/36")[0] == "features 8/9"
    told = cut(tmp_path, "model 3/9")
    assert told[0] == "features 9/9" and "matches 0/36" in told
    found, told = run(tmp_path / "images", tmp_path / "work")
    assert len(found.registered) == COUNT
    assert told[0] == "features 9/9" and "matches 0/36" not in told


def test_a_camera_that_was_left_without_images_is_taken_again(tmp_path: Path) -> None:
    """Cut off between the two, a run would number its cameras otherwise."""
    Image.new("RGB", (64, 48)).save(tmp_path / "a.png")
    facts = read_facts(tmp_path / "a.png")

    def camera(model: Literal["PINHOLE", "OPENCV"] = "OPENCV") -> Any:
        return _camera(facts, SfmConfig(model))

    with pycolmap.Database.open(tmp_path / "database.db") as db:
        numbers = [db.write_camera(camera()), db.write_camera(camera())]
        unused = db.read_all_cameras()
        other = _number_of(camera("PINHOLE"), db, unused)
        assert other not in numbers
        assert [_number_of(camera(), db, unused) for _ in numbers] == numbers and unused == []
        assert _number_of(camera(), db, unused) not in {*numbers, other}


def test_photos_that_share_nothing_are_told(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    for i in range(4):
        Image.fromarray(ground(20 + i)[:H, :W]).save(tmp_path / "images" / f"{i}.png")
    with pytest.raises(CaptureError, match=r"fewer than 3 could be put together \(4 matches no other image"):
        run(tmp_path / "images", tmp_path / "work")
    for i in (2, 3):
        (tmp_path / "images" / f"{i}.png").unlink()
    with pytest.raises(CaptureError, match="needs 3 images or more, but got 2"):
        run(tmp_path / "images", tmp_path / "work")


def test_features_may_be_off_by_a_share_of_the_image(tmp_path: Path) -> None:
    Image.fromarray(np.zeros((30, 40, 3), np.uint8)).save(tmp_path / "a.png")
    fact = read_facts(tmp_path / "a.png")

    def tolerance(*sides: int) -> float:
        return tolerance_px(replace(fact, width_px=side // 2, height_px=side) for side in sides)

    assert tolerance(800) == pytest.approx(tolerance(1600) / 2)
    assert tolerance(1600) == tolerance(6000) == 4.0  # COLMAP's own
    assert tolerance(40) == tolerance(400) == 1.0  # what a feature's place is good to
    assert tolerance(480, 800) == tolerance(800)


def test_wrong_settings_are_told() -> None:
    with pytest.raises(ConfigError, match="features=3"):
        SfmConfig(features=3)
    with pytest.raises(ConfigError, match="block=5"):
        SfmConfig(block=5)
    with pytest.raises(ConfigError, match="neighbours of 1 or more"):
        PairConfig(neighbours=0)


def test_few_images_are_matched_with_all() -> None:
    assert choose_pairs(5, PairConfig()) == [(i, j) for i in range(5) for j in range(i + 1, 5)]
    assert choose_pairs(1, PairConfig()) == []


def test_many_images_are_matched_with_neighbours_and_landmarks() -> None:
    pairs = choose_pairs(300, PairConfig(neighbours=3, landmarks=10))
    assert pairs == sorted(set(pairs)) and all(0 <= i < j < 300 for i, j in pairs)
    assert {(7, 8), (7, 9), (7, 10), (7, 23), (7, 39)} <= set(pairs) and (7, 11) not in pairs
    assert (0, 299) in pairs  # the flight may come back to where it began
    assert len(pairs) < 300 * 10


def test_places_close_the_loop() -> None:
    """There and back: who stands beside whom is matched, though they are far apart in time."""
    s = np.arange(100.0)
    there = np.stack([np.minimum(s, 99 - s) * 5, 0 * s, 0 * s], 1)
    positions = there + np.array([0, 0.1, 0])
    positions[50] = np.nan
    pairs = set(choose_pairs(100, PairConfig(neighbours=2, near=4), positions))
    assert all((i, 99 - i) in pairs for i in range(49)) and (0, 50) not in pairs
