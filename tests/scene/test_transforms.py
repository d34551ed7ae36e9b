"""Frames invert exactly, cameras point where they should, and the scene frame does not depend on the
world's."""

import json

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tests.conftest import look_at

from plnerf.errors import SceneError
from plnerf.scene import orientation
from plnerf.scene.cameras import Cameras, project
from plnerf.scene.orientation import (
    AROUND,
    BELOW,
    estimate_line,
    estimate_up,
    fitted_frames,
    frames_for,
    heading,
    turned,
)
from plnerf.scene.transforms import MAX_DRIFT, Frames, flip_camera_axes, rigid_pose

UTM = np.array([566_123.25, 5_932_456.5, 312.75])


def random_poses(n: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :3, :3] = Rotation.random(n, rng=rng).as_matrix()
    poses[:, :3, 3] = rng.normal(size=(n, 3))
    return poses


def plain(poses: np.ndarray) -> Frames:
    return frames_for(poses, up=None, unit="unscaled", crs=None)


def ring(count: int, arc_rad: float = 2 * np.pi, height: float = 1.0) -> np.ndarray:
    angles = np.arange(count) * arc_rad / count
    return np.stack([look_at(np.array([2 * np.cos(a), 2 * np.sin(a), height]), np.zeros(3)) for a in angles])


def test_opengl_to_opencv_is_its_own_inverse_and_keeps_rotations() -> None:
    poses = random_poses(6, seed=0)
    flipped = flip_camera_axes(poses)
    assert np.array_equal(flip_camera_axes(flipped), poses)
    np.testing.assert_allclose(np.linalg.det(flipped[:, :3, :3]), 1.0)
    np.testing.assert_array_equal(flipped[:, :3, 3], poses[:, :3, 3])
    # OpenGL looks along -z with y up: the same directions must be OpenCV's z and -y.
    np.testing.assert_array_equal(flipped[:, :3, 2], -poses[:, :3, 2])
    np.testing.assert_array_equal(-flipped[:, :3, 1], poses[:, :3, 1])


def test_a_point_in_front_lands_in_the_image_on_the_right_side() -> None:
    opengl = random_poses(4, seed=1)
    poses = flip_camera_axes(opengl)
    cameras = Cameras(
        R_scene_camera=torch.from_numpy(poses[:, :3, :3]).float(),
        centre=torch.from_numpy(poses[:, :3, 3]).float(),
        focal_px=torch.full((4, 2), 50.0),
        principal_px=torch.tensor([[32.0, 24.0]]).repeat(4, 1),
        distortion=torch.zeros(4, 5),
        size_px=torch.tensor([[64, 48]]).repeat(4, 1),
    )
    for i, pose in enumerate(opengl):
        right, up, back = pose[:3, :3].T
        point = pose[:3, 3] - 5 * back + 1.0 * right + 0.5 * up
        pixels, depth = project(cameras, torch.from_numpy(point[None]).float())
        assert depth[i, 0] == pytest.approx(5.0, abs=1e-4)
        x, y = pixels[i, 0].tolist()
        assert x == pytest.approx(32 + 50 * 1.0 / 5, abs=1e-3)  # right of the centre
        assert y == pytest.approx(24 - 50 * 0.5 / 5, abs=1e-3)  # above the centre


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10_000), log_scale=st.floats(-6, 3), far=st.booleans())
def test_to_world_inverts_to_scene_also_at_utm_coordinates(seed: int, log_scale: float, far: bool) -> None:
    rng = np.random.default_rng(seed)
    shift = UTM if far else rng.normal(size=3)
    frames = Frames(Rotation.random(rng=rng).as_matrix(), 10.0**log_scale, shift, "m", "EPSG:25832", "file")
    x_world = shift + rng.normal(size=(2, 5, 3)) * 100
    back = frames.to_world(frames.to_scene(x_world))
    assert np.abs(back - x_world).max() <= 1e-9 * np.abs(x_world).max()
    x_scene = rng.uniform(-1, 1, (5, 3))
    assert np.abs(frames.to_scene(frames.to_world(x_scene)) - x_scene).max() <= 1e-9 * max(
        1.0, frames.scale * float(np.abs(shift).max())
    )


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_json_round_trip_is_exact(seed: int) -> None:
    rng = np.random.default_rng(seed)
    frames = Frames(
        Rotation.random(rng=rng).as_matrix(), float(rng.lognormal()), UTM + rng.normal(size=3), "m", None, "x"
    )
    again = Frames.from_json(json.loads(json.dumps(frames.to_json())))
    assert np.array_equal(again.R_scene_world, frames.R_scene_world)
    assert np.array_equal(again.shift_world, frames.shift_world)
    assert (again.scale, again.unit, again.crs, again.up_source) == (frames.scale, "m", None, "x")


@pytest.mark.parametrize(
    "broken",
    [{"scale": 1.0}, {"R_scene_world": 3}, {"scale": "wide"}, {"unit": "feet"}, {"shift_world": [1, 2]}],
)
def test_stored_frames_that_were_edited_are_refused(broken: dict[str, object]) -> None:
    good = plain(ring(8)).to_json()
    data = broken if "scale" in broken and broken["scale"] == 1.0 else {**good, **broken}
    with pytest.raises(SceneError, match="stored frames"):
        Frames.from_json(data)


def test_rigid_pose_removes_rounding_and_nothing_else() -> None:
    pose = random_poses(1, seed=3)[0]
    np.testing.assert_allclose(rigid_pose(pose, "here"), pose, atol=1e-14)
    np.testing.assert_allclose(rigid_pose(pose[:3], "here"), pose, atol=1e-14)
    drifted = pose.copy()
    drifted[:3, :3] *= 1 + 0.9 * MAX_DRIFT
    np.testing.assert_allclose(rigid_pose(drifted, "here"), pose, atol=1e-14)
    drifted[:3, :3] = pose[:3, :3] * (1 + 1.1 * MAX_DRIFT)
    with pytest.raises(SceneError, match="not rigid"):
        rigid_pose(drifted, "here")


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), log_scale=st.floats(-3, 3))
def test_the_scene_does_not_depend_on_the_world_it_came_in(seed: int, log_scale: float) -> None:
    """Any similarity of the world leaves the cameras in the scene frame as they are: a gauge law."""
    rng = np.random.default_rng(seed)
    poses = ring(9, arc_rad=np.pi)
    poses[:, :3, 3] += rng.normal(size=(9, 3)) * 0.05
    turn, shift, scale = Rotation.random(rng=rng).as_matrix(), rng.normal(size=3) * 100, 10.0**log_scale
    moved = poses.copy()
    moved[:, :3, :3] = turn @ poses[:, :3, :3]
    moved[:, :3, 3] = scale * poses[:, :3, 3] @ turn.T + shift
    one, two = plain(poses), plain(moved)
    np.testing.assert_allclose(
        two.to_scene(moved[:, :3, 3]), one.to_scene(poses[:, :3, 3]), atol=1e-7 * max(1.0, 1 / scale)
    )
    np.testing.assert_allclose(
        two.R_scene_world @ moved[:, :3, :3], one.R_scene_world @ poses[:, :3, :3], atol=1e-9
    )


def test_scene_frames_are_rotations_and_fill_the_cube() -> None:
    poses = random_poses(20, seed=4)
    frames = plain(poses)
    np.testing.assert_allclose(frames.R_scene_world @ frames.R_scene_world.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(frames.R_scene_world) == pytest.approx(1.0)
    centres = frames.to_scene(poses[:, :3, 3])
    np.testing.assert_allclose(centres.mean(0), 0, atol=1e-12)
    assert np.abs(centres).max() == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("azimuth_deg", "world"), [(0.0, [0, 1, 0]), (90.0, [1, 0, 0]), (225.0, [-1, -1, 0])]
)
def test_azimuths_are_clockwise_from_north(azimuth_deg: float, world: list[float]) -> None:
    poses = random_poses(4, 5)
    frames = frames_for(poses, up=np.array([0.0, 0, 2]), unit="m", crs="EPSG:25832")
    assert frames.up_source == "file"
    np.testing.assert_allclose(frames.R_scene_world @ [0, 0, 1], [0, 0, 1], atol=1e-15)
    found = heading(frames, azimuth_deg)
    along = np.array(world) / np.linalg.norm(world)
    np.testing.assert_allclose(found @ frames.R_scene_world, along, atol=1e-12)
    after = turned(frames, found)
    np.testing.assert_allclose(after.R_scene_world @ along, [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(after.R_scene_world @ after.R_scene_world.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(after.R_scene_world) == pytest.approx(1.0) and after.scale == frames.scale


def test_a_world_whose_north_is_vertical_has_no_azimuths() -> None:
    frames = frames_for(random_poses(4, 5), up=np.array([0.0, 1, 0.1]), unit="unscaled", crs=None)
    with pytest.raises(SceneError, match="stands for north, is vertical"):
        heading(frames, 30.0)


@pytest.mark.parametrize("elevation", [-60.0, -20.0, 0.0, 20.0, 60.0])
def test_up_is_found_whether_cameras_look_up_or_down(elevation: float) -> None:
    height = 2 * np.tan(np.deg2rad(elevation))
    poses = ring(10, arc_rad=np.pi, height=height)
    up, source = estimate_up(poses[:, :3, :3], poses[:, :3, 3])
    np.testing.assert_allclose(up, [0, 0, 1], atol=1e-9)
    assert source == orientation.FROM_X_AXES


def nadir(yaw_rad: np.ndarray, centres: np.ndarray) -> np.ndarray:
    poses = np.tile(np.eye(4), (len(yaw_rad), 1, 1))
    x = np.stack([np.cos(yaw_rad), np.sin(yaw_rad), 0 * yaw_rad], -1)
    z = np.tile([0.0, 0.0, -1.0], (len(yaw_rad), 1))
    poses[:, :3, :3] = np.stack([x, np.cross(z, x), z], -1)
    poses[:, :3, 3] = centres
    return poses


def test_cameras_that_look_straight_down_have_up_behind_them() -> None:
    spread = np.random.default_rng(0).uniform(-50, 50, (12, 3)) * [1, 1, 0.02]
    poses = nadir(np.linspace(0, 2, 12), spread)
    up, source = estimate_up(poses[:, :3, :3], poses[:, :3, 3])
    np.testing.assert_allclose(up, [0, 0, 1], atol=1e-9)
    assert source == orientation.FROM_X_AXES


@pytest.mark.parametrize("to_and_fro", [False, True])
def test_nadir_strips_do_not_stand_on_their_edge(to_and_fro: bool) -> None:
    """All x axes parallel, the hard case: travel along camera up says that camera up is not up."""
    yaw = np.where(np.arange(12) >= 6, np.pi, 0.0) if to_and_fro else np.zeros(12)
    centres = np.stack([np.repeat([0.0, 20.0], 6), np.tile(np.arange(6) * 10.0, 2), np.full(12, 40.0)], -1)
    poses = nadir(yaw, centres)
    up, source = estimate_up(poses[:, :3, :3], poses[:, :3, 3])
    np.testing.assert_allclose(up, [0, 0, 1], atol=1e-9)
    assert source == orientation.FROM_FORWARD


def test_parallel_level_cameras_take_their_own_up_and_say_so() -> None:
    poses = np.stack([look_at(np.array([x, -5.0, 2.0]), np.array([x, 0.0, 2.0])) for x in np.arange(6.0)])
    up, source = estimate_up(poses[:, :3, :3], poses[:, :3, 3])
    np.testing.assert_allclose(up, [0, 0, 1], atol=1e-12)
    assert source == orientation.FROM_MEAN_UP


def test_line_follows_an_elongated_track_from_first_to_last() -> None:
    track = np.linspace(0, 1, 15)[:, None] * [-30.0, 40.0, 6.0]
    poses = np.stack([look_at(c, c + np.array([1.0, 0.2, 0.0])) for c in track])
    along = estimate_line(poses[:, :3, :3], track, np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(along, [-0.6, 0.8, 0.0], atol=1e-9)


def test_line_of_an_orbit_is_some_horizontal_direction() -> None:
    poses = ring(12)
    up = np.array([0.0, 0.0, 1.0])
    along = estimate_line(poses[:, :3, :3], poses[:, :3, 3], up)
    assert np.linalg.norm(along) > 0.5 and along @ up == pytest.approx(0)


def test_cameras_in_one_place_are_refused() -> None:
    poses = ring(8)
    poses[:, :3, 3] = UTM
    with pytest.raises(SceneError, match="same point"):
        plain(poses)


@given(st.floats(0, 180), st.booleans())
@settings(deadline=None, max_examples=30)
def test_frames_are_fitted_to_wires_of_any_azimuth(azimuth_deg: float, metric: bool) -> None:
    """Two wires of 40 m, 5 m apart, and one of 10 m across them: x along the two, their extent in [-1, 1]."""
    frames = frames_for(UTM_POSES, up=np.array([0.0, 0, 1]), unit="m" if metric else "unscaled", crs=None)
    angle = np.deg2rad(90 - azimuth_deg)
    u, n = np.array([np.cos(angle), np.sin(angle), 0]), np.array([-np.sin(angle), np.cos(angle), 0])
    s, up = np.linspace(-20, 20, 50)[:, None], np.array([0.0, 0.0, 1.0])
    hanging = [UTM + s * u + y * n + (10 + 0.004 * s**2) * up for y in (0.0, 5.0)]
    across = UTM + s / 8 * n + 12 * up
    found, box = fitted_frames(frames, [frames.to_scene(line) for line in (*hanging, across)])
    np.testing.assert_allclose(np.abs(found.R_scene_world[0] @ u), 1, atol=1e-9)
    np.testing.assert_allclose(found.R_scene_world[2], up, atol=1e-12)
    assert found.R_scene_world[0] @ frames.R_scene_world[0] >= -1e-9  # not turned round
    inside = found.to_scene(np.concatenate([*hanging, across]))
    np.testing.assert_allclose([inside[:, 0].min(), inside[:, 0].max()], [-1, 1], atol=1e-6)
    assert found.scale == pytest.approx(1 / 20) and found.unit == frames.unit
    room = 40 * AROUND / 20
    np.testing.assert_allclose(box[1] - inside.max(0), room, atol=1e-6)
    np.testing.assert_allclose(inside.min(0) - box[0], room + np.array([0, 0, 40 * BELOW / 20]), atol=1e-6)
    np.testing.assert_allclose((box[0] + box[1])[:2], 0, atol=1e-6)


UTM_POSES = random_poses(6, 8)
UTM_POSES[:, :3, 3] = UTM + 30 * UTM_POSES[:, :3, 3]


def test_a_wire_longer_upwards_and_sideways_than_along_still_fits() -> None:
    frames = plain(random_poses(6, 8))
    lines = [np.array([[0.0, y, 0.2], [0.4, y, 0.3]]) for y in (-0.7, 0.9)]
    found, _ = fitted_frames(frames, lines)
    inside = found.to_scene(frames.to_world(np.concatenate(lines)))
    np.testing.assert_allclose([inside[:, 1].min(), inside[:, 1].max()], [-1, 1], atol=1e-9)


@given(st.integers(0, 50))
@settings(deadline=None, max_examples=20)
def test_one_frame_from_another_is_the_way_over_the_world(seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, two = (plain(random_poses(6, int(k))) for k in rng.integers(0, 1000, 2))
    scale, R, shift = two.from_frames(one)
    points = rng.normal(size=(20, 3))
    there = two.to_scene(one.to_world(points))
    np.testing.assert_allclose(scale * points @ R.T + shift, there, atol=1e-9)
