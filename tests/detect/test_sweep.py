"""The vote finds curves that are planted in a volume of odds, at every size of cells."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plnerf.detect.config import SweepConfig
from plnerf.detect.sweep import (
    Box,
    best_distinct,
    candidates,
    candidates_like,
    halved,
    refine,
    vote,
    well_apart,
)

PLANES, NY, NZ = 24, 40, 36
CONFIG = SweepConfig()
BOX = Box(np.linspace(-0.9, 0.9, PLANES), (-0.2, -0.3), 0.02, (NY, NZ))


def cells_of(q: np.ndarray, planes: int = PLANES) -> tuple[np.ndarray, np.ndarray]:
    """The cells of a curve in cells, plane by plane, as the vote rounds them."""
    s = np.arange(planes) / (planes - 1)
    y = (q[0] + (q[1] - q[0]) * s + 0.5).astype(int)
    return y, np.floor(q[2] + (q[3] - q[2]) * s - 4 * q[4] * s * (1 - s) + 0.5).astype(int)


def planted(*curves: tuple[int, ...], seed: int = 0) -> np.ndarray:
    """Odds around -1 everywhere but 3 on the curves; a third of them is hidden."""
    rng = np.random.default_rng(seed)
    volume = rng.normal(-1, 0.5, (PLANES, NY, NZ)).astype(np.float32)
    for q in curves:
        shown = rng.random(PLANES) < 2 / 3
        j, k = cells_of(np.array(q))
        volume[np.arange(PLANES)[shown], j[shown], k[shown]] = 3
    return volume


def in_cells(q: np.ndarray) -> np.ndarray:
    return (q - np.array([BOX.low[0], BOX.low[0], BOX.low[1], BOX.low[1], 0])) / BOX.cell


@pytest.mark.parametrize("q", [(5, 6, 20, 25, 3), (30, 30, 33, 12, 5), (17, 19, 9, 9, 0)])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_planted_curve_comes_first(q: tuple[int, ...], seed: int) -> None:
    found = candidates(planted(q, seed=seed), BOX, CONFIG)
    assert np.abs(in_cells(found[0]) - q).max() < 1.01
    one = in_cells(found[0])
    assert abs((one[2] + one[3] - q[2] - q[3]) / 2 - one[4] + q[4]) < 1.01  # in the middle


def test_curves_of_the_same_shape_are_found_from_the_shape() -> None:
    true = [(5, 6, 20, 25, 3), (12, 13, 20, 25, 3), (12, 13, 24, 29, 4)]
    shape = np.array([0, BOX.cell, 0, 5 * BOX.cell, 3 * BOX.cell])
    found = in_cells(candidates_like(shape, 0.5, planted(*true), BOX, CONFIG))
    first = found[:12]
    for q in true:
        assert np.abs(first - q).max(1).min() < 1.01


def test_candidates_lie_apart_and_come_in_order() -> None:
    found = in_cells(candidates(planted((5, 6, 20, 25, 3)), BOX, CONFIG))
    place = np.stack([found[:, 0], found[:, 1], found[:, 2], found[:, 3]], 1)
    middle = (found[:, 2] + found[:, 3]) / 2 - found[:, 4]
    for a, b in itertools.combinations(range(min(60, len(found))), 2):
        assert max(np.abs(place[a] - place[b]).max(), abs(middle[a] - middle[b])) > 1 - 1e-9


def test_wider_cells_hold_the_largest_of_their_four() -> None:
    volume = np.random.default_rng(0).normal(size=(3, 5, 4)).astype(np.float32)
    wide = halved(volume, -5.0)
    assert wide.shape == (3, 3, 2)
    for j, k in itertools.product(range(3), range(2)):
        expected = volume[:, 2 * j : 2 * j + 2, 2 * k : 2 * k + 2].max((1, 2))
        np.testing.assert_array_equal(wide[:, j, k], np.maximum(expected, -5.0 if j == 2 else -np.inf))


def test_the_vote_is_the_best_sag_of_every_pair_of_ends() -> None:
    volume = np.random.default_rng(3).normal(size=(6, 5, 7)).astype(np.float32)
    sags = np.arange(3)
    score, winner = vote(volume, 1, 3, sags)
    assert score.shape == (5, 3, 7, 7)
    for j0, drift, k0, k1 in itertools.product(range(5), range(3), range(7), range(7)):
        j1 = j0 + drift - 1
        if not 0 <= j1 < 5 or abs(k1 - k0) > 3:
            assert score[j0, drift, k0, k1] == -np.inf
            continue
        means = [mean_odds(volume, np.array([j0, j1, k0, k1, b])) for b in sags]
        assert score[j0, drift, k0, k1] == pytest.approx(max(means), abs=1e-5)
        assert means[winner[j0, drift, k0, k1]] == pytest.approx(max(means), abs=1e-5)


def mean_odds(volume: np.ndarray, q: np.ndarray) -> float:
    j, k = cells_of(q, len(volume))
    inside = (k >= 0) & (k < volume.shape[2])
    return float(volume[np.arange(len(volume))[inside], j[inside], k[inside]].sum() / len(volume))


def test_refining_is_the_best_of_all_moves_by_a_cell() -> None:
    volume = np.random.default_rng(4).normal(size=(6, 6, 6)).astype(np.float32)
    curves = np.array([[2, 3, 2, 3, 1], [0, 0, 5, 5, 0]])
    found, score = refine(volume, curves)
    for q, best, value in zip(curves, found, score, strict=True):
        moved = [q + np.array(move) for move in itertools.product((-1, 0, 1), repeat=5)]
        odds = [mean_odds(volume, one) for one in moved if min(one[:2]) >= 0 and max(one[:2]) < 6]
        assert value == pytest.approx(max(odds), abs=1e-5)
        assert mean_odds(volume, best) == pytest.approx(value, abs=1e-5)


@given(st.lists(st.tuples(*[st.integers(0, 3)] * 5), min_size=1, max_size=20), st.integers(1, 10))
@settings(max_examples=50, deadline=None)
def test_the_best_are_each_kept_once(curves: list[tuple[int, ...]], most: int) -> None:
    score = np.array([hash(q) % 97 for q in curves], float)
    kept, values = best_distinct(np.array(curves), score, most)
    assert len({tuple(q) for q in kept.tolist()}) == len(kept) == min(most, len(set(curves)))
    assert (np.diff(values) <= 0).all() and values[0] == score.max()
    far = well_apart(kept, 1, 100)
    assert (far[0] == kept[0]).all()
    np.testing.assert_array_equal(well_apart(kept, 1, 1), far[:1])
