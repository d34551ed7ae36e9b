"""The field of a run: world in, world out, the same as what the model renders."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from tests.support.changed import changed
from tests.support.oracle import oracle_run
from tests.support.tiny_run import SMALL, open_tiny
from tests.train.test_guidance import HALF, REACH, on_curve, wire_of

from plnerf.errors import ConfigError
from plnerf.field.tubes import FIRST_DEPTH
from plnerf.presets import preset_names
from plnerf.presets._find import find_preset
from plnerf.render.model import PLNeRF
from plnerf.render.views import render_view
from plnerf.scene.scene import Scene
from plnerf.scene.transforms import Frames
from plnerf.train.config import RunConfig
from plnerf.train.field import Camera, Field
from plnerf.train.guidance import guides_for
from plnerf.train.run import build_model
from plnerf.train.scene_record import SceneRecord


@pytest.fixture
def scene(tiny_scene: Path, tmp_path: Path) -> Scene:
    return open_tiny(tiny_scene, tmp_path)


def field_of(scene: Scene, preset: str = "pl-nerf", backend: str = "numba") -> Field:
    """An untrained model of a preset, its appearance and density not all alike."""
    chosen = find_preset(preset)
    start = RunConfig(str(scene.root), 1, preset, backend, "cpu", chosen.model, chosen.train, steps=1)
    config = changed(start, SMALL) if preset.startswith("pl-nerf") else start
    guides = guides_for((wire_of(scene),), scene, config)
    model = build_model(config, scene, guides).eval()
    with torch.no_grad():
        model.appearance.copy_(torch.randn_like(model.appearance))
    return Field(model, SceneRecord.of(scene))


def points_world(scene: Scene) -> np.ndarray:
    return scene.frames.to_world(np.random.default_rng(3).uniform(-1.5, 1.5, (4, 5, 3)))


DOWN = np.array([0.1, 0.2, -0.9])


@pytest.mark.parametrize("preset", preset_names())
def test_every_system_can_be_queried(preset: str, scene: Scene) -> None:
    field, x = field_of(scene, preset), points_world(scene)
    density, colour, features = field.density(x), field.colour(x, DOWN), field.features(x)
    assert density.shape == (4, 5) and density.dtype == np.float64 and (density > 0).all()
    assert colour.shape == (4, 5, 3) and ((colour > 0) & (colour < 1)).all()
    assert features.shape[:2] == (4, 5) and np.isfinite(features).all()
    assert np.ptp(features, axis=(0, 1)).max() > 0
    # A point has one density, however it is asked for.
    assert np.allclose(field.density(x[2, 3]), density[2, 3], rtol=1e-4)
    assert field.density(x[:0]).shape == (0, 5)


def test_fused_kernels_and_plain_torch_agree(scene: Scene) -> None:
    x = points_world(scene)
    fused, plain = field_of(scene), field_of(scene, backend="torch")
    plain.model.load_state_dict(fused.model.state_dict())
    fused, plain = (Field(one.model, SceneRecord.of(scene)) for one in (fused, plain))
    assert np.allclose(fused.density(x), plain.density(x), rtol=1e-3)
    assert np.allclose(fused.colour(x, DOWN), plain.colour(x, DOWN), atol=1e-3)


def test_a_density_times_a_length_is_the_same_in_every_world(scene: Scene) -> None:
    """The same model in a world that is turned, moved and four times larger."""
    field, x = field_of(scene), points_world(scene)
    turn = Rotation.from_rotvec([0.1, -0.4, 0.3]).as_matrix()
    old = scene.frames
    frames = Frames(turn, old.length_to_scene(1.0) / 4, np.array([3.0, -2.0, 50.0]), "m", None, "file")
    other = Field(field.model, replace(field.record, frames=frames))
    moved = frames.to_world(old.to_scene(x))
    assert np.allclose(other.density(moved) * 4, field.density(x), rtol=1e-3)
    assert np.allclose(other.features(moved), field.features(x), atol=1e-3)
    d_scene = old.direction_to_scene(DOWN)
    assert np.allclose(other.colour(moved, d_scene @ turn), field.colour(x, DOWN), atol=1e-3)


def test_rays_see_the_world_as_it_is(scene: Scene, tmp_path: Path) -> None:
    """A ball of radius 0.5 around (0, 0, 0.5) on the floor z = 0, in metres."""
    field = oracle_run(scene, tmp_path).field
    origins = np.array([[0.0, 0.0, 3.0], [3.0, 0.0, 0.5], [2.0, 2.0, 2.0], [3.0, 0.0, 3.0]])
    directions = np.array([[0.0, 0.0, -1.0], [-2.0, 0.0, 0.0], [0.0, 0.0, -5.0], [0.0, 0.0, 1.0]])
    seen = field.along(origins, directions)
    assert np.allclose(seen.depth, [2.0, 2.5, 2.0, np.inf], rtol=1e-5)
    assert seen.accumulation.tolist() == [1.0, 1.0, 1.0, 0.0]
    shaped = field.along(origins.reshape(2, 2, 3), directions.reshape(2, 2, 3))
    assert np.array_equal(shaped.depth.ravel(), seen.depth) and shaped.colour.shape == (2, 2, 3)


def test_a_camera_renders_as_the_scene_renders_it(scene: Scene) -> None:
    field = field_of(scene, "pl-nerf-wire")
    camera = field.cameras[3]
    assert camera.name == scene.names[3] and len(field.cameras) == 12
    seen = field.render(camera)
    view = render_view(field.model, scene.cameras[[3]], field._appearance, normals=False)
    assert seen.colour.shape == (32, 48, 3)
    assert np.allclose(seen.colour, view.rgb, atol=2e-3)
    surface = np.isfinite(seen.depth)
    assert np.array_equal(surface, view.accumulation >= 0.5) and surface.any()
    expected = scene.frames.depth_to_world(view.depth_median[surface].astype(np.float64))
    assert np.median(np.abs(seen.depth[surface] / expected - 1)) < 1e-3


def test_a_camera_of_ones_own_looks_where_it_is_told(scene: Scene, tmp_path: Path) -> None:
    """Straight down on the ball's top from 2 m above it: its axis is opposite to the world's z."""
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[:3, 3] = [0.0, 0.0, 3.0]
    seen = oracle_run(scene, tmp_path).field.render(Camera(T, (40.0, 40.0), (10.5, 7.5), (21, 15)))
    assert seen.depth.shape == (15, 21)
    assert seen.depth[7, 10] == pytest.approx(2.0, abs=1e-5) == seen.depth.min()


def test_the_tube_around_a_wire_is_part_of_the_field(scene: Scene) -> None:
    """A tube whose network is nothing but a bias has the same density all through it."""
    field = field_of(scene, "pl-nerf-wire")
    model = field.model
    assert isinstance(model, PLNeRF) and model.tubes is not None
    with torch.no_grad():
        for value in model.tubes.network.parameters():
            value.zero_()
    x = np.linspace(-0.9 * HALF, 0.9 * HALF, 50)
    on_wire = scene.frames.to_world(on_curve(x).double().numpy())
    inside, beside = (
        field.density(scene.frames.to_world(on_curve(x, up).double().numpy()))
        for up in (0.5 * REACH, 1.5 * REACH)
    )
    constant = field.density(on_wire)
    assert np.ptp(constant) < 1e-3 * constant.mean() and np.allclose(inside, constant, rtol=1e-3)
    assert constant.mean() == pytest.approx(
        FIRST_DEPTH / (2 * REACH) * np.exp(0.0) * scene.frames.length_to_scene(1.0), rel=0.5
    )
    tubes, model.tubes = model.tubes, None
    without = field.density(scene.frames.to_world(on_curve(x, 1.5 * REACH).double().numpy()))
    assert np.allclose(beside, without, rtol=1e-5)
    assert not np.allclose(field.density(on_wire), constant, rtol=1e-2)
    model.tubes = tubes


def test_directions_may_have_any_length_but_none(scene: Scene) -> None:
    field, x = field_of(scene), points_world(scene)
    assert np.allclose(field.colour(x, DOWN), field.colour(x, 7 * DOWN), atol=1e-6)
    assert not np.allclose(field.colour(x, DOWN), field.colour(x, -DOWN), atol=1e-6)
    for wrong in (np.zeros(3), np.array([np.nan, 0.0, 1.0])):
        with pytest.raises(ConfigError, match="longer than 0"):
            field.colour(x, wrong)
