"""What views know of a wire: laws of the viewing geometry, and a check by moving a wire."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.conftest import look_at

from plnerf.doctor.observability import Observability, observe_wire
from plnerf.scene.cameras import Cameras, project

FOCAL, WIDTH, HEIGHT = 440.0, 480, 320
ORIGIN, ALONG = np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0]])


def cameras_at(*centres: tuple[float, ...], towards: tuple[float, ...] | None = (0.0, 0.0, 0.0)) -> Cameras:
    """Cameras that look at one point, or (None) each at the wire y = z = 0 right beside it."""
    poses = [
        look_at(np.array(c), np.array(towards if towards is not None else (c[0], 0, 0))) for c in centres
    ]
    n = len(poses)
    return Cameras(
        R_scene_camera=torch.tensor(np.array([pose[:3, :3] for pose in poses])).float(),
        centre=torch.tensor(np.array([pose[:3, 3] for pose in poses])).float(),
        focal_px=torch.full((n, 2), FOCAL),
        principal_px=torch.tensor([[WIDTH / 2, HEIGHT / 2]]).repeat(n, 1),
        distortion=torch.zeros(n, 5),
        size_px=torch.tensor([[WIDTH, HEIGHT]]).repeat(n, 1),
    )


def at_origin(cameras: Cameras, **options: float) -> Observability:
    return observe_wire(cameras, ORIGIN, ALONG, **options)  # type: ignore[arg-type]


def test_two_views_at_right_angles_know_both_directions_alike() -> None:
    known = at_origin(cameras_at((0, 8, 0), (0, 0.001, -8)), sigma_px=0.5)
    assert known.worst[0] == pytest.approx(0.5 * 8 / FOCAL, rel=1e-3)
    assert known.best[0] == pytest.approx(0.5 * 8 / FOCAL, rel=1e-3)
    assert known.spread_deg[0] == pytest.approx(90, abs=0.02) and known.views[0] == 2
    assert known.distance[0] == pytest.approx(8) and known.px_per_length[0] == pytest.approx(FOCAL / 8)


def test_moving_along_the_wire_knows_nothing_towards_it() -> None:
    """However many views, and though the best direction is known ever better."""
    track = np.linspace(-6, 6, 25)
    one = at_origin(cameras_at((0, 6, 3)))
    many = at_origin(cameras_at(*((x, 6.0, 3.0) for x in track), towards=None))
    assert many.worst[0] == one.worst[0] == np.inf and many.spread_deg[0] < 1e-3
    assert many.views[0] > 5 and many.best[0] < one.best[0] / 2
    assert abs(many.worst_direction[0] @ np.array([0, 6, 3]) / np.hypot(6, 3)) == pytest.approx(1, abs=1e-5)
    both = at_origin(
        cameras_at(*((x, 6.0, 3.0) for x in track), *((x, -6.0, 3.0) for x in track), towards=None)
    )
    assert both.worst[0] < 0.02 and both.spread_deg[0] == pytest.approx(
        2 * np.degrees(np.arctan2(3, 6)), abs=0.1
    )


def test_opposite_sides_in_one_plane_with_the_wire_do_not_help() -> None:
    assert at_origin(cameras_at((0, 6, 2), (1, -6, -2), (2, -3, -1))).worst[0] == np.inf


def test_no_view_knows_nothing() -> None:
    behind = cameras_at((0, 6, 0), towards=(0.0, 12.0, 0.0))
    aside = cameras_at((0, 6, 0), towards=(6.0, 6.1, 0.0))
    along = cameras_at((-5, 0, 0))  # the wire is a point in the image
    for cameras in (behind, aside, along):
        known = at_origin(cameras)
        assert known.views[0] == 0 and known.best[0] == known.worst[0] == np.inf and known.spread_deg[0] == 0


def somewhere(seed: int, n: int) -> Cameras:
    rng = np.random.default_rng(seed)
    return cameras_at(*(tuple(c) for c in rng.normal(0, 1, (n, 3)) * [4, 6, 3] + [0, 0, 4]))


@given(st.integers(0, 999), st.integers(1, 8), st.floats(0, 0.3))
@settings(max_examples=40, deadline=None)
def test_a_view_more_never_makes_it_worse(seed: int, n: int, pose_sigma: float) -> None:
    cameras = somewhere(seed, n + 1)
    less, more = (at_origin(cameras[:k], pose_sigma=pose_sigma) for k in (n, n + 1))
    assert more.worst[0] <= less.worst[0] * (1 + 1e-9) and more.best[0] <= less.best[0] * (1 + 1e-9)
    assert more.spread_deg[0] >= less.spread_deg[0]


@given(st.integers(0, 999), st.floats(0.01, 100))
@settings(max_examples=20, deadline=None)
def test_sigma_grows_with_the_world_and_with_the_pixels_error(seed: int, factor: float) -> None:
    cameras = somewhere(seed, 5)
    known = at_origin(cameras)
    larger = at_origin(replace(cameras, centre=cameras.centre * factor))
    blurred = at_origin(cameras, sigma_px=0.5 * factor)
    for other in (larger, blurred):
        assert other.worst[0] == pytest.approx(known.worst[0] * factor, rel=1e-4)
        assert other.best[0] == pytest.approx(known.best[0] * factor, rel=1e-4)
        assert other.spread_deg[0] == pytest.approx(known.spread_deg[0], abs=1e-3)


def test_it_is_what_moving_a_wire_in_the_images_says() -> None:
    """The covariance from numerical derivatives of the distance of the projected wire from where it was."""
    cameras = somewhere(3, 6)
    u = np.array([0.9, 0.3, -0.2]) / np.linalg.norm([0.9, 0.3, -0.2])
    point = np.array([0.2, -0.1, 0.3])
    known = observe_wire(cameras, point[None], u[None])
    double = replace(
        cameras,
        **{
            name: getattr(cameras, name).double()
            for name in ("R_scene_camera", "centre", "focal_px", "principal_px", "distortion")
        },
    )

    def pixels(x: np.ndarray) -> np.ndarray:
        return project(double, torch.from_numpy(x[None]))[0][:, 0].numpy()

    h = 1e-5
    line = (pixels(point + h * u) - pixels(point - h * u)) / (2 * h)
    normal = np.stack([-line[:, 1], line[:, 0]], 1) / np.linalg.norm(line, axis=1, keepdims=True)
    steps = np.stack([(pixels(point + h * e) - pixels(point - h * e)) / (2 * h) for e in np.eye(3)], 2)
    gradient = np.einsum("ni,nij->nj", normal, steps)
    assert np.abs(gradient @ u).max() < 1e-4 * np.abs(gradient).max(), "along the wire nothing moves"
    information = gradient.T @ gradient / 0.5**2
    values, vectors = np.linalg.eigh(information)
    assert known.worst[0] == pytest.approx(values[1] ** -0.5, rel=1e-4)
    assert known.best[0] == pytest.approx(values[2] ** -0.5, rel=1e-4)
    assert abs(known.worst_direction[0] @ vectors[:, 1]) == pytest.approx(1, abs=1e-6)


def test_uncertain_poses_blur_what_is_near_more_than_what_is_far() -> None:
    """A camera's error moves the wire by as much: 5 cm each are the least that one view leaves."""
    for distance in (0.5, 5.0, 50.0):
        known = at_origin(cameras_at((0, distance, 0), (0, 1e-4 * distance, -distance)), pose_sigma=0.05)
        assert known.worst[0] == pytest.approx(np.hypot(0.05, 0.5 * distance / FOCAL), rel=1e-3)


def test_views_that_magnify_too_little_do_not_count() -> None:
    cameras = cameras_at((0, 5, 0), (0, 0.001, -20), (0, 8, 0.1), (0, 7, 7))
    strong = at_origin(cameras, least_px_per_length=FOCAL / 12)
    assert strong.views[0] == 3 and strong.worst[0] == pytest.approx(at_origin(cameras[[0, 2, 3]]).worst[0])
