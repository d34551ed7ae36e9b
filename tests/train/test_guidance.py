"""What training makes of found curves: which pixels, which curves, and what the search costs."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch
from plnerf.detect.curves import Curve, write_curves
from tests.support.tiny_run import open_tiny, tiny_config

from plnerf.scene.cameras import project
from plnerf.scene.scene import Scene
from plnerf.train.config import RunConfig
from plnerf.train.guidance import CURVES, curve_pixels, favoured_pixels, guides_for, run_curves
from plnerf.train.loop import billable_seconds

CURVE = Curve((0.05, 0.1), (-0.25, 0.05, 0.2), (-0.4, 0.4), 0.002, 0.04, True)


@pytest.fixture
def scene(tiny_scene: Path, tmp_path: Path) -> Scene:
    return open_tiny(tiny_scene, tmp_path)


@pytest.fixture
def config(tiny_scene: Path) -> RunConfig:
    return tiny_config(tiny_scene, "train.find_wires=true", "train.curve_share=0.25", steps=3)


def test_curve_pixels_are_those_near_the_curves_image_in_training_images(scene: Scene) -> None:
    """Against all pixels of all images, each by its distance from the finely projected curve."""
    chosen = set(curve_pixels(scene, [CURVE]).tolist())
    points = torch.from_numpy(CURVE.points(np.linspace(*CURVE.ends, 2000))).float()
    seen, depth = project(scene.cameras, points)
    on_curve = 0
    for i in range(len(scene.names)):
        w, h = (int(side) for side in scene.cameras.size_px[i])
        image = seen[i][depth[i] > 1e-3].numpy()
        row, column = np.divmod(np.arange(w * h), w)
        centre = np.stack([column + 0.5, row + 0.5], 1)
        apart = (
            np.linalg.norm(centre[:, None] - image[None], axis=2).min(1) if len(image) else np.full(w * h, 99)
        )
        widest = CURVE.reach * float(scene.cameras.focal_px[i].mean() / depth[i][depth[i] > 1e-3].min())
        mine = np.array([int(scene.images.starts[i]) + k in chosen for k in range(w * h)])
        if i in scene.test:
            assert not mine.any()
            continue
        assert mine[apart < 0.7].all()
        assert not mine[apart > max(widest, 2) + 2].any()
        on_curve += int(mine.sum())
    assert on_curve == len(chosen) > 0
    assert sorted(chosen) == curve_pixels(scene, [CURVE]).tolist()


def test_a_curve_behind_all_cameras_has_no_pixels(scene: Scene) -> None:
    up = float(scene.cameras.centre[:, 2].max()) + 5.0
    behind = dataclasses.replace(CURVE, z=(up, 0.0, 0.0))
    ahead, depth = project(scene.cameras, torch.from_numpy(behind.points(np.linspace(-0.4, 0.4, 50))).float())
    w, h = scene.cameras.size_px.T[..., None]
    inside = (depth > 0) & (ahead[..., 0] > -9) & (ahead[..., 0] < w + 9)
    inside &= (ahead[..., 1] > -9) & (ahead[..., 1] < h + 9)
    assert not inside.any()
    assert len(curve_pixels(scene, [behind])) == 0


def test_only_certain_curves_guide_and_a_stored_search_costs_nothing(
    scene: Scene, config: RunConfig, tmp_path: Path
) -> None:
    unsure = dataclasses.replace(CURVE, certain=False)
    write_curves(tmp_path / CURVES, [CURVE, unsure])
    curves, seconds = run_curves(config, scene, tmp_path)
    assert (curves, seconds) == ((CURVE,), 0.0)
    guides = guides_for(curves, config)
    assert guides is not None and len(guides) == 1
    assert guides_for((), config) is None
    off = dataclasses.replace(config, train=dataclasses.replace(config.train, find_wires=False))
    assert run_curves(off, scene, tmp_path) == ((), 0.0)


def test_curve_pixels_have_their_share_of_the_draws(scene: Scene, config: RunConfig) -> None:
    assert [pool.share for pool in favoured_pixels(config, scene, [CURVE])][-1] == 0.25
    without = favoured_pixels(config, scene, ())
    assert len(without) == len(favoured_pixels(config, scene, [CURVE])) - 1


def test_a_long_search_leaves_a_tenth_of_the_budget(config: RunConfig) -> None:
    by_time = dataclasses.replace(config, steps=None, seconds=20.0)
    assert billable_seconds(7.0, by_time) == 7.0
    with pytest.warns(UserWarning, match=r"took 50\.0 s of a budget of 20 s"):
        assert billable_seconds(50.0, by_time) == 18.0
    assert billable_seconds(50.0, config) == 50.0  # a budget in steps is not used up by time
