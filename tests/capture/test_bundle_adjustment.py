"""Bundle adjustment of made tie points: nearer to the truth, no drift, honest deviations, no outliers."""

import numpy as np
import pytest
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from plnerf.capture.bundle_adjustment import Adjusted, adjust
from plnerf.capture.poses_config import AdjustmentConfig
from plnerf.capture.tie_points import TiePoints
from plnerf.errors import ConfigError

FOCAL, VIEWS, POINTS = 800.0, 16, 400
Poses = tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 3"]]


def true_poses() -> Poses:
    """Two tracks that look across a volume of points."""
    k = np.arange(VIEWS)
    side = np.where(k % 2, 1.0, -1.0)
    centre = np.stack([np.linspace(-1, 1, VIEWS), 2.0 * side, 0.3 * side + 0.1 * np.sin(k)], 1)
    turn = Rotation.from_euler("ZX", np.stack([np.where(k % 2, np.pi, 0), np.full(VIEWS, -np.pi / 2)], 1))
    return turn.as_matrix(), centre


def ties(noise_px: float, seed: int = 0, outliers: float = 0.0) -> TiePoints:
    rng = np.random.default_rng(seed)
    R, c = true_poses()
    X = rng.uniform([-1, -0.6, -0.6], [1, 0.6, 0.6], (POINTS, 3))
    P = np.einsum("nji,npj->npi", R, X[None] - c[:, None])
    plane = P[..., :2] / P[..., 2:] + noise_px / FOCAL * rng.standard_normal((VIEWS, POINTS, 2))
    seen = (np.abs(plane) < 0.5).all(-1) & (P[..., 2] > 0) & (rng.uniform(size=(VIEWS, POINTS)) < 0.6)
    point, image = np.nonzero(seen.T)
    at = plane[image, point]
    wrong = rng.uniform(size=len(at)) < outliers
    at[wrong] += rng.uniform(-0.1, 0.1, (wrong.sum(), 2))
    return TiePoints(image, np.unique(point, return_inverse=True)[1], at, np.full(VIEWS, FOCAL))


def off(place: float, turn: float, seed: int = 3) -> Poses:
    """The true poses with normal errors in scene units and radians."""
    rng = np.random.default_rng(seed)
    R, c = true_poses()
    turned = Rotation.from_rotvec(turn * rng.standard_normal((VIEWS, 3))).as_matrix() @ R
    return turned, c + place * rng.standard_normal(c.shape)


def errors(R: Float[np.ndarray, "n 3 3"], c: Float[np.ndarray, "n 3"]) -> tuple[float, float]:
    """Root mean square errors of positions and rotations along an axis."""
    R0, c0 = true_poses()
    turn = Rotation.from_matrix(R @ R0.transpose(0, 2, 1)).as_rotvec()
    return float(np.sqrt(((c - c0) ** 2).mean())), float(np.sqrt((turn**2).mean()))


def off_px(R: Float[np.ndarray, "n 3 3"], c: Float[np.ndarray, "n 3"]) -> float:
    """Root mean square distance between where poses and the true ones see places, some of them new."""
    X = np.random.default_rng(9).uniform(-0.6, 0.6, (50, 3))
    seen = []
    for axes, centre in ((R, c), true_poses()):
        P = np.einsum("nji,npj->npi", axes, X[None] - centre[:, None])
        seen.append(FOCAL * P[..., :2] / P[..., 2:])
    return float(np.sqrt(((seen[0] - seen[1]) ** 2).sum(-1).mean()))


def adjusted(given: Poses, points: TiePoints) -> Adjusted:
    return adjust(*given, points, AdjustmentConfig())


def test_poses_come_nearer_to_the_truth_and_points_to_their_observations() -> None:
    given = off(0.01, 0.002)
    found = adjusted(given, ties(0.2))
    poses = (found.R_scene_camera, found.centre)
    assert errors(*poses)[0] < errors(*given)[0] and errors(*poses)[1] < errors(*given)[1]
    assert off_px(*poses) < 0.5 * off_px(*given)
    assert found.after_px < 0.3 < 1.0 < found.before_px


def test_what_all_poses_have_in_common_stays() -> None:
    given = off(0.01, 0.002)
    found = adjusted(given, ties(0.2))
    common = (found.centre - given[1]).mean(0)
    assert np.abs(common).max() < 0.2 * 0.01
    shift = np.array([5.0, -3.0, 2.0])
    shifted = adjusted((given[0], given[1] + shift), ties(0.2))
    np.testing.assert_allclose(shifted.centre, found.centre + shift, atol=1e-4)


def test_the_accuracy_of_the_given_poses_is_learnt() -> None:
    for place, turn in ((0.01, 0.0005), (0.002, 0.004)):
        found = adjusted(off(place, turn), ties(0.2))
        assert 0.7 < found.sigma[0] / place < 1.4
        assert 0.7 < found.sigma[1] / turn < 1.6


def test_what_is_left_of_the_errors_is_as_great_as_the_covariance_says() -> None:
    """Over forty draws, in all directions together: neighbouring poses are off together, and all of them."""
    place, turn, R0, c0 = 0.01, 0.005, *true_poses()
    squares = []
    for seed in range(40):
        found = adjust(*off(place, turn, seed), ties(0.5, seed), AdjustmentConfig())
        turned = Rotation.from_matrix(R0 @ found.R_scene_camera.transpose(0, 2, 1)).as_rotvec()
        error = np.concatenate([c0 - found.centre, turned], 1).ravel()
        squares.append(error @ np.linalg.solve(found.covariance, error) / error.size)
    assert 0.5 < np.mean(squares) < 1.1


def test_exact_poses_hardly_move() -> None:
    found = adjusted(true_poses(), ties(0.2))
    place, turn = errors(found.R_scene_camera, found.centre)
    assert place < 0.0005 and turn < 0.0002


def test_noise_of_features_is_not_followed_where_poses_are_exact() -> None:
    """Every step is drawn back to the given poses, not only made shorter."""
    found = adjusted(true_poses(), ties(0.8))
    assert errors(found.R_scene_camera, found.centre)[0] < 0.0003
    assert found.sigma[0] < 0.0005


def test_wrong_matches_do_not_count() -> None:
    given = off(0.01, 0.002)
    found = adjusted(given, ties(0.2, outliers=0.1))
    clean = adjusted(given, ties(0.2))
    after = errors(found.R_scene_camera, found.centre)
    assert after[0] < 1.3 * errors(clean.R_scene_camera, clean.centre)[0]


def test_a_camera_that_sees_no_point_stays() -> None:
    given, points = off(0.01, 0.002), ties(0.2)
    kept = points.image != 5
    rest = points._replace(
        image=points.image[kept],
        point=np.unique(points.point[kept], return_inverse=True)[1],
        plane=points.plane[kept],
    )
    found = adjusted(given, rest)
    np.testing.assert_allclose(found.centre[5], given[1][5], atol=1e-9)
    assert errors(found.R_scene_camera, found.centre)[0] < errors(*given)[0]


def test_without_points_all_stay() -> None:
    none = TiePoints(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)), np.full(VIEWS, FOCAL))
    given = off(0.01, 0.002)
    found = adjusted(given, none)
    assert found.points == 0 and np.isnan(found.before_px)
    np.testing.assert_array_equal(found.centre, given[1])


def test_settings_that_mean_nothing_are_refused() -> None:
    for wrong in ({"pose_px": 0.0}, {"steps": 0}, {"outlier_px": -1.0}):
        with pytest.raises(ConfigError, match="bundle adjustment needs"):
            AdjustmentConfig(**wrong)
