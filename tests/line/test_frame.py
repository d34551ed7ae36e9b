"""The LineFrame is entered and left without loss, and agrees with the scene frame that it stands for."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from plnerf.line.frame import NOMINAL_HALF_M, LineFrame
from plnerf.scene.cameras import Cameras
from plnerf.scene.transforms import Frames

UTM = np.array([500_000.0, 5_700_000.0, 300.0])


@st.composite
def frames(draw: st.DrawFn) -> LineFrame:
    angles = [draw(st.floats(-3.2, 3.2)), draw(st.floats(-0.3, 0.3)), draw(st.floats(-0.3, 0.3))]
    R = Rotation.from_euler("zyx", angles).as_matrix()
    origin = UTM * draw(st.floats(-1, 1))
    return LineFrame(R, draw(st.floats(0.01, 100)), origin, "m", None, None, draw(st.floats(0.001, 1)))


@given(frames())
@settings(max_examples=100, deadline=None)
def test_the_world_comes_back(frame: LineFrame) -> None:
    near = frame.origin_world + np.random.default_rng(0).normal(0, 300, (50, 3))
    np.testing.assert_allclose(frame.to_world(frame.from_world(near)), near, atol=1e-7)
    line = np.random.default_rng(1).normal(0, 300, (50, 3))
    back = frame.from_world(frame.to_world(line))
    np.testing.assert_allclose(back, line, atol=1e-8 * max(1.0, frame.scale))
    np.testing.assert_allclose(frame.from_world(frame.origin_world), np.zeros(3), atol=1e-12)
    scale, R, shift = frame.similarity
    there = scale * near @ R.T + shift
    np.testing.assert_allclose(there, frame.from_world(near), atol=1e-8 * max(1.0, scale))
    lengths = np.linalg.norm(np.diff(near, axis=0), axis=1)
    there = np.linalg.norm(np.diff(frame.from_world(near), axis=0), axis=1)
    np.testing.assert_allclose(there, frame.scale * lengths, rtol=1e-7)


@given(frames())
@settings(max_examples=50, deadline=None)
def test_the_scene_comes_back(frame: LineFrame) -> None:
    line = np.random.default_rng(1).normal(0, 300, (2, 5, 3))
    np.testing.assert_allclose(frame.from_scene(frame.to_scene(line)), line, rtol=1e-14)


@given(st.integers(0, 99), st.sampled_from([0.001, 0.01]))
@settings(max_examples=20, deadline=None)
def test_coordinates_of_clouds_lose_nothing(seed: int, step_m: float) -> None:
    """Whole steps of a LAS file in UTM come back to a micrometre, and heights stay what they are."""
    random = np.random.default_rng(seed)
    xyz = UTM + step_m * random.integers(0, 500_000, (200, 3)).astype(np.float64)
    frame = LineFrame.of_cloud(xyz, "EPSG:25832")
    line = frame.from_world(xyz)
    assert np.abs(frame.to_world(line) - xyz).max() < 1e-8
    assert (np.round(frame.to_world(line) / step_m) == np.round(xyz / step_m)).all()
    assert (line[:, 2] == xyz[:, 2]).all() and (frame.origin_world == np.round(frame.origin_world)).all()
    assert np.abs(line[:, :2].min(0) + line[:, :2].max(0)).max() <= 1.0
    assert (frame.unit, frame.crs, frame.upright, frame.scale) == ("m", "EPSG:25832", True, 1.0)


def test_a_cloud_without_points_has_a_frame() -> None:
    frame = LineFrame.of_cloud(np.zeros((0, 3)), None)
    assert (frame.from_world(np.ones(3)) == 1).all() and frame.crs is None


def scene_frames(unit: str, scale: float = 0.05) -> Frames:
    turn = Rotation.from_euler("z", 40, degrees=True).as_matrix()
    place = np.array([10.0, 51.0, 250.0])
    return Frames(turn, scale, np.array([3.0, -7.0, 12.0]), unit, "EPSG:25832", "file", place)  # type: ignore[arg-type]


@pytest.mark.parametrize("unit", ["m", "unscaled"])
def test_the_frame_of_a_scene_has_its_axes_and_its_origin(unit: str) -> None:
    """One step from the world or two by way of the scene; metres where the scene knows them."""
    of = scene_frames(unit)
    frame = LineFrame.of_scene(of)
    world = np.random.default_rng(2).normal(0, 50, (30, 3))
    scene = of.to_scene(world)
    np.testing.assert_allclose(frame.from_world(world), frame.from_scene(scene), atol=1e-10)
    np.testing.assert_allclose(frame.to_scene(frame.from_world(world)), scene, atol=1e-12)
    length = np.linalg.norm(frame.from_world(world[0]) - frame.from_world(world[1]))
    if unit == "m":
        assert length == pytest.approx(np.linalg.norm(world[0] - world[1])) and frame.scale == 1
    else:
        in_box = np.linalg.norm(scene[0] - scene[1])  # whose half is 1
        assert length == pytest.approx(NOMINAL_HALF_M * in_box)
    assert (frame.unit, frame.crs) == (unit, "EPSG:25832") and frame.origin_lon_lat_height is not None


def test_cameras_are_in_double_precision_and_metres() -> None:
    frame = LineFrame.of_scene(scene_frames("m"))
    cameras = Cameras(
        torch.eye(3)[None],
        torch.tensor([[0.5, -0.25, 1.0]]),
        torch.tensor([[400.0, 400.0]]),
        torch.tensor([[32.0, 24.0]]),
        torch.zeros(1, 5),
        torch.tensor([[64, 48]]),
    )
    there = frame.cameras(cameras)
    assert there.centre.dtype == torch.float64 and there.size_px.dtype == torch.int64
    np.testing.assert_allclose(there.centre.numpy(), [[10.0, -5.0, 20.0]])
    assert cameras.centre.tolist() == [[0.5, -0.25, 1.0]]  # the scene's are what they were


def test_upright_is_what_leans_by_less_than_a_height_notices() -> None:
    for degrees, upright in ((0.0, True), (0.05, True), (0.2, False)):
        R = Rotation.from_euler("x", degrees, degrees=True).as_matrix()
        assert LineFrame(R, 1.0, np.zeros(3), "m").upright is upright
    assert math.isclose(math.degrees(math.acos(1 - 1e-6)), 0.081, abs_tol=1e-3)


def test_without_a_scene_there_is_no_way_to_one() -> None:
    with pytest.raises(ValueError, match="was not found in a scene"):
        LineFrame.of_cloud(np.ones((1, 3)), None).to_scene(np.ones(3))
