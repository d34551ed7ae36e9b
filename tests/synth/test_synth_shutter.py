"""The open shutter: as long a smear as asked for, around the view as planned."""

import numpy as np
import pytest

from plnerf.synth.capture import View, look, turn, written_views
from plnerf.synth.flight_config import CaptureConfig
from plnerf.synth.shutter import flight_directions, image_motion, open_shutter

CAPTURE = CaptureConfig()
VIEW = View("0000", "right", look(0.3, -0.1, 0.05), np.array([1.0, 2.0, 8.0]))
WIRE = VIEW.centre + (np.array([0.5, 0.3, 6.0]) + np.linspace(-1, 1, 21)[:, None] * [0.2, 0.0, 4.0]) @ (
    VIEW.R_world_camera.T
)
DIRECTION = np.array([0.8, 0.6, 0.0])


def pixels(view: View, points: np.ndarray) -> np.ndarray:
    local = (points - view.centre) @ view.R_world_camera
    return CAPTURE.focal_px * local[:, :2] / local[:, 2:]


def test_turns_are_rotations_and_add_up() -> None:
    rng = np.random.default_rng(0)
    np.testing.assert_array_equal(turn(np.zeros(3)), np.eye(3))
    axis = rng.normal(size=3)
    R = turn(axis)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(R @ R, turn(2 * axis), atol=1e-12)
    np.testing.assert_allclose(R @ axis, axis, atol=1e-12)
    assert np.trace(R) == pytest.approx(1 + 2 * np.cos(np.linalg.norm(axis)))


def test_image_motion_is_the_derivative_of_the_projection() -> None:
    rng = np.random.default_rng(1)
    points = rng.normal(size=(30, 3)) + np.array([0, 0, 7])
    velocity, spin, h = rng.normal(size=3), rng.normal(size=3), 1e-5

    def project(t: float) -> np.ndarray:
        local = (points - velocity * t) @ turn(spin * t)
        return CAPTURE.focal_px * local[:, :2] / local[:, 2:]

    numeric = (project(h) - project(-h)) / (2 * h)
    np.testing.assert_allclose(
        image_motion(points, velocity, spin, CAPTURE.focal_px), numeric, rtol=1e-6, atol=1e-4
    )


def test_without_blur_the_view_is_itself() -> None:
    opened = open_shutter(VIEW, DIRECTION, WIRE, CAPTURE, 0.0, np.random.default_rng(0), 7)
    assert opened == (VIEW,)


@pytest.mark.parametrize("blur_px", [1.0, 6.0])
def test_the_longest_smear_is_as_long_as_asked_for(blur_px: float) -> None:
    """Instants stand in the middle of their share of the time: first to last is (n - 1) / n of all."""
    frames = 50
    opened = open_shutter(VIEW, DIRECTION, WIRE, CAPTURE, blur_px, np.random.default_rng(2), frames)
    assert len(opened) == frames
    moved = np.linalg.norm(pixels(opened[-1], WIRE) - pixels(opened[0], WIRE), axis=1)
    assert moved.max() * frames / (frames - 1) == pytest.approx(blur_px, rel=0.03)
    centre = np.mean([view.centre for view in opened], axis=0)
    np.testing.assert_allclose(centre, VIEW.centre, atol=1e-12)
    middle = (pixels(opened[frames // 2 - 1], WIRE) + pixels(opened[frames // 2], WIRE)) / 2
    np.testing.assert_allclose(middle, pixels(VIEW, WIRE), atol=1e-3 * blur_px)


def test_a_view_without_wires_is_blurred_as_well() -> None:
    behind = VIEW.centre - 5 * VIEW.R_world_camera[:, 2:].T
    opened = open_shutter(VIEW, DIRECTION, behind, CAPTURE, 3.0, np.random.default_rng(2), 4)
    assert len(opened) == 4 and not np.allclose(opened[0].centre, VIEW.centre)


def test_directions_are_unit_vectors_along_each_pass() -> None:
    there = [View(str(i), "a", np.eye(3), np.array([2.0 * i, 0, 5])) for i in range(4)]
    back = [View(str(4 + i), "b", np.eye(3), np.array([8.0 - 2 * i, 3, 5])) for i in range(4)]
    directions = flight_directions([*there, *back])
    np.testing.assert_allclose(directions[:4], [[1, 0, 0]] * 4)
    np.testing.assert_allclose(directions[4:], [[-1, 0, 0]] * 4)


def test_written_poses_are_off_by_the_stated_noise_and_else_the_true_ones() -> None:
    views = [VIEW] * 3000
    assert written_views(views, CAPTURE, 7) == tuple(views)
    noisy = CaptureConfig(pose_noise_m=0.05, pose_noise_deg=0.4)
    written = written_views(views, noisy, 7)
    off = np.array([view.centre for view in written]) - VIEW.centre
    np.testing.assert_allclose(off.std(axis=0), 0.05, rtol=0.07)  # five times the error of 3000 values
    np.testing.assert_allclose(off.mean(axis=0), 0.0, atol=0.005)
    angles = [np.arccos((np.trace(VIEW.R_world_camera.T @ view.R_world_camera) - 1) / 2) for view in written]
    assert np.sqrt(np.mean(np.square(angles)) / 3) == pytest.approx(np.radians(0.4), rel=0.05)
    again = written_views(views, noisy, 7)
    np.testing.assert_array_equal(again[5].centre, written[5].centre)
    assert not np.array_equal(written_views(views, noisy, 8)[5].centre, written[5].centre)
