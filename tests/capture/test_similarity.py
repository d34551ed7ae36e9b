"""Similarities are recovered, in spite of outliers, and say when a line of positions leaves them open."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from plnerf.capture.similarity import (
    Similarity,
    fit_similarity,
    fit_upright,
    robust_similarity,
    upright_rotation,
)
from plnerf.errors import CaptureError


def a_similarity(random: np.random.Generator) -> Similarity:
    R = Rotation.random(random_state=int(random.integers(1 << 31))).as_matrix()
    return Similarity(float(np.exp(random.normal())) * 10, R, 1e4 * random.normal(size=3))


def some_points(random: np.random.Generator, n: int = 30) -> np.ndarray:
    return random.normal(size=(n, 3)) * [5.0, 1.0, 0.5] + random.normal(size=3)


def apart(a: Similarity, b: Similarity, x: np.ndarray) -> float:
    return float(np.abs(a(x) - b(x)).max())


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 1 << 30))
def test_exact_positions_give_the_exact_similarity(seed: int) -> None:
    random = np.random.default_rng(seed)
    truth, x = a_similarity(random), some_points(random)
    for found in (
        fit_similarity(x, truth(x)),
        fit_similarity(x, truth(x), random.random(len(x)) + 0.1),
        robust_similarity(x, truth(x), np.full_like(x, 0.1)).similarity,
    ):
        assert apart(found, truth, x) < 1e-6 and np.linalg.det(found.R) == pytest.approx(1)
        assert found.scale == pytest.approx(truth.scale, rel=1e-9)


def test_a_mirrored_cloud_is_not_mirrored() -> None:
    random = np.random.default_rng(0)
    x = some_points(random)
    assert np.linalg.det(fit_similarity(x, x * [1, 1, -1]).R) == pytest.approx(1)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 1 << 30))
def test_nearly_a_third_of_gross_outliers_is_survived(seed: int) -> None:
    random = np.random.default_rng(seed)
    truth, x = a_similarity(random), some_points(random, 40)
    sigma = np.tile([0.02, 0.02, 0.05], (40, 1))
    y = truth(x) + sigma * random.normal(size=x.shape)
    wrong = random.permutation(40) < 12
    y[wrong] += 200 * random.normal(size=(12, 3)) + 50
    found = robust_similarity(x, y, sigma)
    assert not found.inlier[wrong].any() and found.inlier[~wrong].mean() > 0.95
    alone = robust_similarity(x[~wrong], y[~wrong], sigma[~wrong])  # how near that is, chance decides
    np.testing.assert_allclose(found.similarity(x), alone.similarity(x), rtol=0, atol=1e-6)
    assert found.residual == pytest.approx(found.similarity(x) - y)


def test_heights_that_are_worse_than_sides_count_for_less() -> None:
    """Against heights that are 8 m off, sides to a centimetre hold everything but height."""
    random = np.random.default_rng(3)
    truth, x = a_similarity(random), some_points(random, 60) * [1, 5, 1]
    sigma = np.tile([0.01, 0.01, 8.0], (60, 1))
    y = truth(x) + sigma * random.normal(size=x.shape)
    off = robust_similarity(x, y, sigma).similarity(x) - truth(x)
    alike = fit_similarity(x, y)(x) - truth(x)
    assert np.abs(off[:, :2]).max() < 0.1 < np.abs(alike[:, :2]).max()


def test_a_track_on_a_line_is_known_as_one_and_gravity_holds_it() -> None:
    random = np.random.default_rng(4)
    heading = Rotation.from_euler("z", 70, degrees=True).as_matrix()
    level = upright_rotation(np.array([0.3, -0.2, 0.9]) / np.linalg.norm([0.3, -0.2, 0.9]))
    truth = Similarity(3.0, heading @ level, np.array([5.0, 6.0, 7.0]))
    along = np.linspace(0, 20, 25)[:, None] * (level.T @ np.array([1.0, 0.2, 0.05]))
    sigma = np.full((25, 3), 0.03)
    y = truth(along) + sigma * random.normal(size=(25, 3))
    alone = robust_similarity(along, y, sigma)
    assert alone.roll_sigma_deg > 5
    upright = robust_similarity(along, y, sigma, up=level.T @ np.array([0, 0, 1.0]))
    assert pytest.approx(truth.R, abs=2e-3) == upright.similarity.R
    beside = along + level.T @ np.array([0.0, 4.0, 0.0])  # what hangs beside the track is in its place
    assert np.abs(upright.similarity(beside) - truth(beside)).max() < 0.1
    exact = robust_similarity(along, truth(along), sigma)
    assert exact.roll_sigma_deg == np.inf


@pytest.mark.slow
def test_the_roll_is_as_uncertain_as_it_says() -> None:
    """Over many draws, the turn about the track scatters by the stated standard deviation."""
    random, turns = np.random.default_rng(5), []
    x = np.stack([np.linspace(-20, 20, 40), np.tile([-1.0, 1.0], 20), np.zeros(40)], 1)
    sigma = np.full((40, 3), 0.1)
    for _ in range(60):
        found = robust_similarity(x, x + sigma * random.normal(size=x.shape), sigma)
        turns.append(np.degrees(Rotation.from_matrix(found.similarity.R).as_rotvec()[0]))
    assert np.std(turns) == pytest.approx(found.roll_sigma_deg, rel=0.35)
    assert found.roll_sigma_deg == pytest.approx(np.degrees(0.1 / np.sqrt(40)), rel=0.1)


def test_upright_fits_keep_gravity_whatever_the_positions_say() -> None:
    random = np.random.default_rng(6)
    x = some_points(random)
    up = np.array([0.1, 0.2, 0.97]) / np.linalg.norm([0.1, 0.2, 0.97])
    tilted = Similarity(2.0, Rotation.from_euler("x", 20, degrees=True).as_matrix(), np.ones(3))(x)
    for found in (
        fit_upright(x, tilted, up),
        robust_similarity(x, tilted, np.full_like(x, 9.0), up).similarity,
    ):
        assert found.R @ up == pytest.approx([0, 0, 1])


def test_too_few_and_disagreeing_positions_are_told() -> None:
    random = np.random.default_rng(7)
    x = some_points(random, 12)
    with pytest.raises(CaptureError, match="2 images have both a pose and a position"):
        robust_similarity(x[:2], x[:2], np.ones((2, 3)))
    with pytest.raises(CaptureError, match=r"Of 12 positions not 4 agree .*stated coordinate"):
        robust_similarity(x, 1e4 * random.normal(size=x.shape), np.full_like(x, 0.01))
