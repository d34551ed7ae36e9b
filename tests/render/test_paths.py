"""A flight is even, steady, near the cameras, and never leaves its pass."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from plnerf.errors import ConfigError
from plnerf.render.paths import fly_along, in_time_order, longest_pass
from plnerf.scene import memory
from plnerf.scene.cameras import Cameras


def cameras_at(centre: np.ndarray, view: Rotation | None = None) -> Cameras:
    n = len(centre)
    R = np.tile(np.eye(3), (n, 1, 1)) if view is None else view.as_matrix()
    return Cameras(
        R_scene_camera=torch.from_numpy(R).float(),
        centre=torch.from_numpy(centre).float(),
        focal_px=torch.tensor([[50.0, 51.0]]).expand(n, -1),
        principal_px=torch.tensor([[24.0, 16.0]]).expand(n, -1),
        distortion=torch.full((n, 5), 0.01),
        size_px=torch.tensor([[48, 32]]).expand(n, -1),
    )


def straight(n: int, y: float = 0.0, start: float = -1.0, end: float = 1.0) -> np.ndarray:
    return np.stack([np.linspace(start, end, n), np.full(n, y), np.full(n, 0.5)], -1)


def steps(path: Cameras) -> np.ndarray:
    return np.linalg.norm(np.diff(path.centre.numpy(), axis=0), axis=1)


@pytest.mark.parametrize(("n", "frames"), [(2, 5), (3, 2), (12, 40)])
def test_a_straight_even_track_is_kept_from_end_to_end(n: int, frames: int) -> None:
    path = fly_along(cameras_at(straight(n)), frames)
    assert len(path) == frames
    np.testing.assert_allclose(path.centre.numpy(), straight(frames), atol=1e-5)
    np.testing.assert_allclose(path.R_scene_camera.numpy(), np.tile(np.eye(3), (frames, 1, 1)), atol=1e-6)


def test_frames_are_even_along_a_curve_of_uneven_cameras() -> None:
    angle = np.array([0.0, 0.4, 1.6, 1.9, 3.0, 3.2])
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1)
    path = fly_along(cameras_at(ring, Rotation.from_rotvec(angle[:, None] * [0, 0, 1])), 200, smooth=0.0)
    length = steps(path)
    assert length.std() / length.mean() < 1e-3
    np.testing.assert_allclose(np.linalg.norm(path.centre.numpy(), axis=1), 1.0, atol=0.05)


def test_without_smoothing_the_path_passes_through_every_camera() -> None:
    rng = np.random.default_rng(1)
    centre = straight(9) + rng.normal(0, 0.05, (9, 3))
    view = Rotation.from_rotvec(rng.normal(0, 0.2, (9, 3)))
    path = fly_along(cameras_at(centre, view), 3001, smooth=0.0)
    gap = np.linalg.norm(path.centre.numpy()[:, None] - centre, axis=-1)
    nearest = gap.argmin(0)
    assert gap.min(0).max() < 2e-3
    there = Rotation.from_matrix(path.R_scene_camera.double().numpy()[nearest])
    assert (there.inv() * view).magnitude().max() < 0.02


def test_shake_is_steadied_and_the_path_stays_near_the_cameras() -> None:
    rng = np.random.default_rng(2)
    shaken = straight(40) + rng.normal(0, 0.01, (40, 3))
    turned = Rotation.from_rotvec(rng.normal(0, 0.03, (40, 3)))
    rough, steady = (fly_along(cameras_at(shaken, turned), 300, smooth=s) for s in (0.0, 1.0))

    def jolt(path: Cameras) -> float:
        return float(np.linalg.norm(np.diff(path.centre.numpy(), n=2, axis=0), axis=1).max())

    def swing(path: Cameras) -> float:
        R = Rotation.from_matrix(path.R_scene_camera.double().numpy())
        return float((R[:-1].inv() * R[1:]).magnitude().max())

    assert jolt(steady) < 0.3 * jolt(rough) and swing(steady) < 0.5 * swing(rough)
    gap = np.linalg.norm(steady.centre.numpy()[:, None] - straight(1000), axis=-1).min(1)
    assert gap.max() < 0.03


def test_the_path_keeps_to_the_longest_pass() -> None:
    """Three passes; the second has the most cameras.  Nothing of the path lies between two passes."""
    passes = [straight(8, y=-2.0), straight(14, y=0.5, start=1, end=-1), straight(9, y=3.0)]
    cameras = cameras_at(np.concatenate(passes))
    assert longest_pass(cameras) == range(8, 22)
    path = fly_along(cameras, 60)
    np.testing.assert_allclose(path.centre[:, 1].numpy(), 0.5, atol=1e-6)
    assert steps(path).max() < 1.05 * steps(path).mean()


def test_a_camera_that_turns_round_ends_its_pass() -> None:
    """Forth and back over the same place: the positions do not leap, the views do."""
    centre = np.concatenate([straight(10), straight(7, start=1, end=-1)])
    turn = np.array([0.0] * 10 + [np.pi] * 7)
    cameras = cameras_at(centre, Rotation.from_rotvec(turn[:, None] * [0, 0, 1]))
    assert longest_pass(cameras) == range(10)


def test_gaps_of_held_out_images_do_not_end_a_pass() -> None:
    kept = [i for i in range(40) if i % 8]
    assert longest_pass(cameras_at(straight(40)[kept])) == range(len(kept))


def test_hovering_adds_no_frames() -> None:
    """A drone stands still and shakes for some images, then flies on: the path crosses the place evenly."""
    rng = np.random.default_rng(3)
    hover = np.array([0.0, 0.0, 0.5]) + rng.normal(0, 1e-4, (5, 3))
    centre = np.concatenate([straight(9, start=-1, end=-0.1), hover, straight(9, start=0.1, end=1)])
    path = fly_along(cameras_at(centre), 100)
    assert steps(path).max() < 1.1 * steps(path).min()


def test_frames_that_do_not_fit_into_memory_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "available_bytes", lambda: 8e9)
    with pytest.raises(ConfigError, match=r"A path of 1,000,000,000 frames needs at least .* GB of memory"):
        fly_along(cameras_at(straight(5)), 1_000_000_000)


def test_the_lens_is_shared_and_free_of_distortion() -> None:
    path = fly_along(cameras_at(straight(5)), 7)
    assert torch.equal(path.distortion, torch.zeros(7, 5))
    assert (path.focal_px == torch.tensor([50.0, 51.0])).all() and (
        path.size_px == torch.tensor([48, 32])
    ).all()


def test_rotations_are_proper() -> None:
    view = Rotation.random(12, rng=np.random.default_rng(4)).as_rotvec() * 0.2
    R = fly_along(cameras_at(straight(12), Rotation.from_rotvec(view)), 50).R_scene_camera
    torch.testing.assert_close(R @ R.mT, torch.eye(3).expand(50, 3, 3), rtol=0, atol=1e-5)
    torch.testing.assert_close(torch.linalg.det(R), torch.ones(50))


def test_numbers_in_names_count_as_numbers() -> None:
    names = ["b/frame_10.jpg", "b/frame_9.jpg", "a/frame_11.jpg", "a/f2.jpg", "7.jpg"]
    assert [names[i] for i in in_time_order(names, [0, 1, 2, 3, 4])] == [
        "7.jpg",
        "a/f2.jpg",
        "a/frame_11.jpg",
        "b/frame_9.jpg",
        "b/frame_10.jpg",
    ]
    assert in_time_order(names, [0, 1]) == [1, 0]


def test_paths_that_cannot_be_say_why() -> None:
    with pytest.raises(ConfigError, match="at least 2 frames, but 1"):
        fly_along(cameras_at(straight(5)), 1)
    with pytest.raises(ConfigError, match="do not move"):
        fly_along(cameras_at(straight(3, start=0, end=0)), 5)
    with pytest.raises(ConfigError, match="none of the 1 training cameras"):
        fly_along(cameras_at(straight(1)), 5)
    opposite = Rotation.from_rotvec(np.array([[0.0, 0, 0], [0, 0, np.pi]]))
    with pytest.raises(ConfigError, match="none of the 2 training cameras"):
        fly_along(cameras_at(straight(2), opposite), 5)
