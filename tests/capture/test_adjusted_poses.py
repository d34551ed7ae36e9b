"""Poses of a scene adjusted to its photos: nearer to the truth where they are off, untouched where not."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import torch
from jaxtyping import Float
from tests.support.flown_plane import SIZE, write_flight

from plnerf.capture import tie_points as tie_points_module
from plnerf.capture.adjusted_poses import PoseAdjustment, with_adjusted_poses
from plnerf.capture.pairs import Pair
from plnerf.capture.poses_config import PosesConfig, TieConfig
from plnerf.capture.tie_points import Features, TiePoints, features_of, images_of, neighbour_pairs, tie_points
from plnerf.errors import ConfigError
from plnerf.scene.cameras import Cameras
from plnerf.scene.photos import Pictures
from plnerf.scene.scene import Scene, load_scene

FEW = PosesConfig(groups=2, group_size=4, ties=TieConfig(features=400, partners=6))


def errors_m(scene: Scene, true: list[Float[np.ndarray, "4 4"]]) -> Float[np.ndarray, "n 3"]:
    centre = scene.frames.to_world(scene.cameras.centre.double().numpy())
    return centre - np.array(true)[:, :3, 3]


def tied(scene: Scene, pairs: list[Pair], config: TieConfig = FEW.ties) -> TiePoints:
    cameras = scene.photo_cameras
    return tie_points(features_of(scene.photos, cameras, images_of(pairs), config), cameras, pairs, config)


def rms(x: Float[np.ndarray, "..."]) -> float:
    return float(np.sqrt((x**2).mean()))


class Off(NamedTuple):
    """A scene with poses that are off, and the true ones."""

    scene: Scene
    true: list[Float[np.ndarray, "4 4"]]


@pytest.fixture(scope="module")
def off(tmp_path_factory: pytest.TempPathFactory) -> Off:
    folder = tmp_path_factory.mktemp("off") / "s"
    true = write_flight(folder, off_m=0.05, off_deg=0.15)
    return Off(load_scene(folder), true)


@pytest.fixture(scope="module")
def adjusted(off: Off) -> tuple[Scene, PoseAdjustment | None]:
    return with_adjusted_poses(off.scene, FEW)


def test_poses_that_are_off_are_adjusted(off: Off, adjusted: tuple[Scene, PoseAdjustment | None]) -> None:
    scene, true = off
    moved, change = adjusted
    assert change is not None and change.images == 12
    assert change.after_px < 0.2 * change.before_px
    # What all have in common is not seen in photos.
    own_before, own_after = (one - one.mean(0) for one in (errors_m(scene, true), errors_m(moved, true)))
    assert rms(own_after) < 0.5 * rms(own_before)
    assert rms(errors_m(moved, true)) < rms(errors_m(scene, true))
    assert torch.equal(moved.stated_centre, scene.cameras.centre)
    assert moved.frames is scene.frames and moved.images is scene.images
    assert "adjusted to" in change.text("m") and " cm and turned by" in change.text("m")
    assert "unscaled" in change.text("unscaled")


def test_the_same_photos_give_the_same_poses_and_each_is_read_once(
    off: Off, adjusted: tuple[Scene, PoseAdjustment | None], monkeypatch: pytest.MonkeyPatch
) -> None:
    read, steps = list[int](), list[tuple[int, int]]()

    def counted(pictures: Pictures, cameras: Cameras, image: int, config: TieConfig) -> Features:
        read.append(image)
        return found_in(pictures, cameras, image, config)

    found_in = tie_points_module._features
    monkeypatch.setattr(tie_points_module, "_features", counted)
    again, _ = with_adjusted_poses(off.scene, FEW, lambda done, of: steps.append((done, of)))
    assert torch.equal(again.cameras.centre, adjusted[0].cameras.centre)
    assert torch.equal(again.cameras.R_scene_camera, adjusted[0].cameras.R_scene_camera)
    assert sorted(read) == list(range(12))
    assert [done for done, _ in steps] == list(range(1, steps[-1][1] + 1))


def test_poses_that_agree_stay(tmp_path: Path) -> None:
    write_flight(tmp_path / "s")
    scene = load_scene(tmp_path / "s")
    same, change = with_adjusted_poses(scene, FEW)
    assert change is None and same is scene


def test_without_the_setting_or_with_too_many_images_poses_stay(off: Off) -> None:
    for config in (replace(FEW, adjust=False), replace(FEW, max_images=11), replace(FEW, min_points=10_000)):
        same, change = with_adjusted_poses(off.scene, config)
        assert change is None and same is off.scene


def test_tie_points_are_where_the_photos_show_them(tmp_path: Path) -> None:
    true = write_flight(tmp_path / "s")
    scene = load_scene(tmp_path / "s")
    found = tied(scene, neighbour_pairs(scene.cameras, 6))
    assert found.point.max() > 100 and np.bincount(found.point).min() >= 3
    assert (np.diff(found.point) >= 0).all()
    apart = []
    for i, plane, point in zip(found.image, found.plane, found.point, strict=True):
        R, c = true[i][:3, :3], true[i][:3, 3]
        ray = R @ [*plane, 1.0]
        apart.append((point, *(c - ray * c[2] / ray[2])[:2]))  # on the ground, in metres
    rows = np.array(apart)
    middle = np.array([rows[rows[:, 0] == p, 1:].mean(0) for p in range(found.point.max() + 1)])
    off_m = np.linalg.norm(rows[:, 1:] - middle[found.point], axis=1)
    # A pixel is 7 cm; hardly any match by chance along their epipolar lines.
    assert np.median(off_m) < 0.01 and np.quantile(off_m, 0.97) < 0.1


def test_a_feature_lies_where_its_spot_is(tmp_path: Path) -> None:
    """Photos taken in different directions would else be pulled apart, each to its own side."""
    write_flight(tmp_path / "s", views=2)
    cameras = load_scene(tmp_path / "s").photo_cameras[[0]]
    w, h = SIZE
    rng = np.random.default_rng(0)
    grid = np.stack(np.meshgrid(np.arange(30.0, w - 20, 40), np.arange(30.0, h - 20, 40)), -1).reshape(-1, 2)
    spots = grid + rng.uniform(0, 1, grid.shape)
    y, x = np.mgrid[:h, :w] + 0.5  # pixel centres
    squares = (x - spots[:, 0, None, None]) ** 2 + (y - spots[:, 1, None, None]) ** 2
    bright = 60 + 150 * np.exp(-squares / (2 * 2.5**2)).sum(0)

    class Spots:
        has_masks = False

        def image(self, i: int) -> np.ndarray:
            return np.repeat(bright.astype(np.uint8)[..., None], 3, 2)

        def valid(self, i: int) -> np.ndarray:
            return np.ones((h, w), bool)

    (features,) = features_of(Spots(), cameras, [0], FEW.ties).values()
    pixels = features.plane * cameras.focal_px[0].numpy() + cameras.principal_px[0].numpy()
    apart = np.linalg.norm(pixels[:, None] - spots, axis=2)
    assert apart.min(0).max() < 0.05 and (apart.argmin(1)[apart.min(1) < 3]).size >= len(spots)


@pytest.mark.slow
def test_features_in_smaller_photos_are_at_the_same_place(tmp_path: Path) -> None:
    write_flight(tmp_path / "s", views=6)
    scene = load_scene(tmp_path / "s")
    cameras, config = scene.photo_cameras, replace(FEW.ties, features=4000)
    half = replace(config, max_image_px=SIZE[0] // 2)
    whole, halved = (features_of(scene.photos, cameras, range(6), one) for one in (config, half))
    focal_px = cameras.focal_px[0].numpy()
    assert np.allclose(tied(scene, neighbour_pairs(cameras, 5), half).focal_px, focal_px.mean() / 2)
    nearest = []
    for i in range(6):
        apart = (halved[i].plane[:, None] - whole[i].plane) * focal_px
        nearest.append(apart[np.arange(len(apart)), np.linalg.norm(apart, axis=2).argmin(1)])
    off_px = np.concatenate(nearest)
    # Half of the size has some features of its own.
    same = np.linalg.norm(off_px, axis=1) < 0.3
    assert same.mean() > 0.6 and np.abs(off_px[same].mean(0)).max() < 0.02


def test_pixels_that_masks_ignore_have_no_features(tmp_path: Path) -> None:
    write_flight(tmp_path / "s")
    scene = load_scene(tmp_path / "s")

    class LeftHalf:
        has_masks = True

        def image(self, i: int) -> np.ndarray:
            return scene.photos.image(i)

        def valid(self, i: int) -> np.ndarray:
            keep = np.zeros(SIZE[::-1], bool)
            keep[:, : SIZE[0] // 2] = True
            return keep

    pairs = neighbour_pairs(scene.cameras, 6)
    cameras, config = scene.photo_cameras, replace(FEW.ties, min_images=2)
    found = tie_points(features_of(LeftHalf(), cameras, range(12), config), cameras, pairs, config)
    assert len(found.image) and found.plane[:, 0].max() <= 0.01


def test_what_lies_far_from_the_epipolar_line_is_no_match(tmp_path: Path) -> None:
    counts = []
    for name, off_deg in (("exact", 0.0), ("turned", 10.0)):
        write_flight(tmp_path / name, off_deg=off_deg, views=6)
        scene = load_scene(tmp_path / name)
        pairs = neighbour_pairs(scene.cameras, 5)
        counts.append(len(tied(scene, pairs).image))
    assert counts[1] < 0.2 * counts[0]


def test_settings_that_mean_nothing_are_refused() -> None:
    for wrong in (
        {"gain": 0.0},
        {"group_size": 2},
        {"agree_px": 0.0},
        {"loose_px": 0.0},
        {"agree_px": float("nan")},
    ):
        with pytest.raises(ConfigError, match="poses need"):
            PosesConfig(**wrong)
    for wrong in (
        {"features": 10},
        {"min_images": 1},
        {"ratio": 0.0},
        {"ratio": 1.5},
        {"epipolar_px": 0.0},
        {"contrast": float("nan")},
    ):
        with pytest.raises(ConfigError, match="Tie points need"):
            TieConfig(**wrong)
