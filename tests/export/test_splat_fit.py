"""Gaussians fitted to made-up views: colours come back, wires stay where they are, counts are kept."""

import numpy as np
import pytest
import torch
from tests.support.surveys import short

from plnerf.errors import ConfigError, TrainingError
from plnerf.export.splat_config import SplatConfig
from plnerf.export.splat_fit import fit_splats
from plnerf.export.splat_project import Pinhole
from plnerf.export.splat_score import rendered_view
from plnerf.export.splat_seed import seeds, surface_points, z_along
from plnerf.export.splat_sh import Y_0
from plnerf.export.splat_views import TargetView
from plnerf.export.splat_wires import STEP, wire_splats
from plnerf.train.metrics import psnr

W, H, FOCAL, HEIGHT = 40, 30, 40.0, 4.0
NONE = wire_splats((), 2)


def colour_at(xy: np.ndarray) -> np.ndarray:
    """A smooth pattern on the ground z = 0."""
    x, y = xy[..., 0], xy[..., 1]
    return 0.5 + 0.4 * np.stack([np.sin(x), np.cos(y), np.sin(x + y)], -1)


def looking_down(x: float, y: float, surface: bool = True) -> TargetView:
    """The ground from straight above, exactly."""
    R = torch.tensor([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    eye = Pinhole(
        R,
        torch.tensor([x, y, HEIGHT]),
        torch.tensor([FOCAL, FOCAL]),
        torch.tensor([W / 2, H / 2]),
        (W, H),
        0.1,
    )
    flat = np.full((H, W), HEIGHT, np.float32)
    bare = TargetView(eye, np.zeros((H, W, 3), np.uint8), flat, np.full((H, W), surface))
    rgb = np.round(colour_at(surface_points(bare)) * 255).astype(np.uint8)
    return TargetView(eye, rgb, flat, bare.surface)


VIEWS = [looking_down(x, y) for x in (-1.0, 0.0, 1.0) for y in (-0.7, 0.7)]


def test_points_of_a_render_lie_on_what_it_shows() -> None:
    points = surface_points(VIEWS[0])
    np.testing.assert_allclose(points[..., 2], 0, atol=1e-5)
    np.testing.assert_allclose(
        points[0, 0, :2], [-1 + (0.5 - W / 2) / 10, -0.7 - (0.5 - H / 2) / 10], atol=1e-5
    )


def test_seeds_are_spread_evenly_flat_on_the_surface_and_no_more_than_asked_for() -> None:
    found = seeds(VIEWS, 300, 1, np.random.default_rng(0))
    assert 150 < len(found) <= 300 and found.sh.shape == (len(found), 4, 3)
    assert np.abs(found.xyz[:, 2]).max() < 1e-4
    apart = np.linalg.norm(found.xyz[:, None] - found.xyz, axis=-1) + 1e3 * np.eye(len(found))
    area = np.ptp(found.xyz[:, 0]) * np.ptp(found.xyz[:, 1])
    assert np.median(apart.min(1)) > 0.4 * np.sqrt(area / len(found))
    _, x, y, _ = found.rotation.T
    np.testing.assert_allclose(np.abs(1 - 2 * (x**2 + y**2)), 1, atol=1e-4)  # their thin axis is upright
    assert (found.scale[:, 2] < found.scale[:, 0]).all()
    np.testing.assert_allclose(found.sh[:, 0] * Y_0 + 0.5, colour_at(found.xyz[:, :2]), atol=0.01)


@pytest.mark.slow
def test_the_fit_comes_near_the_views_and_near_one_between_them() -> None:
    config = SplatConfig(count=900, steps=120)
    found = fit_splats(VIEWS, NONE, config)
    assert len(found) <= config.count
    between, before = looking_down(0.4, 0.1), fit_splats(VIEWS, NONE, SplatConfig(count=900, steps=0))
    whole = np.ones((H, W), bool)
    scores = [
        psnr(rendered_view(one, between), between.rgb.astype(np.float32) / 255, whole)
        for one in (before, found)
    ]
    assert scores[0] is not None and scores[1] is not None
    assert scores[1] > 30 and scores[1] > scores[0] + 5, scores


def test_the_same_seed_gives_the_same_gaussians() -> None:
    config = SplatConfig(count=200, steps=10)
    a, b = (fit_splats(VIEWS, NONE, config) for _ in range(2))
    np.testing.assert_array_equal(a.xyz, b.xyz)
    assert not np.array_equal(a.xyz, fit_splats(VIEWS, NONE, SplatConfig(count=200, steps=10, seed=1)).xyz)


def test_wires_keep_place_and_shape_and_follow_the_others() -> None:
    wires = wire_splats(short().wires, 2)
    assert len(wires) > 20
    found = fit_splats(VIEWS, wires, SplatConfig(count=200, steps=10))
    assert found.drawn == len(wires)
    last = slice(len(found) - len(wires), None)
    np.testing.assert_allclose(found.xyz[last], wires.xyz, atol=1e-4)
    np.testing.assert_allclose(found.scale[last], wires.scale, rtol=1e-5)
    np.testing.assert_allclose(np.abs((found.rotation[last] * wires.rotation).sum(1)), 1, atol=1e-5)


def test_gaussians_of_wires_lie_along_their_curves() -> None:
    survey = short()
    found = wire_splats(survey.wires, 1)
    assert found.drawn == len(found)
    curve = np.concatenate([wire.polyline(0.01) for wire in survey.wires])
    w, x, y, z = found.rotation.astype(float).T
    axis = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x**2 + y**2)], 1)
    for sign in (-1, 0, 1):  # in their middle and towards their ends
        places = found.xyz + sign * 0.5 * STEP * axis
        apart = np.array([np.linalg.norm(curve - place, axis=1).min() for place in places[::7]])
        assert apart.max() < 0.02
    assert (found.scale[:, 2] > 5 * found.scale[:, 0]).all() and (found.scale[:, 0] < 0.05).all()


def test_z_along_turns_z_into_any_direction() -> None:
    given = np.array([
        [0, 0, 1.0],
        [0, 0, -1.0],
        [1.0, 0, 0],
        [0, -1.0, 0],
        [0.6, 0, -0.8],
        [0.48, 0.64, 0.6],
    ])
    w, x, y, z = z_along(given).astype(float).T
    turned = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x**2 + y**2)], 1)
    np.testing.assert_allclose(turned, given, atol=1e-6)


def test_a_field_that_shows_nothing_is_refused() -> None:
    with pytest.raises(TrainingError, match="shows no surface in any of 2 renders"):
        fit_splats([looking_down(0, 0, surface=False)] * 2, NONE, SplatConfig(count=10, steps=1))


@pytest.mark.parametrize("wrong", [{"count": 0}, {"degree": 3}, {"steps": -1}, {"views": 0}, {"seed": -1}])
def test_settings_that_cannot_be_are_refused(wrong: dict[str, int]) -> None:
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        SplatConfig(**wrong)
