"""The normal equations of a curve's fit, against all unknowns solved for at once."""

import numpy as np
import pytest

from plnerf.detect.refit_sums import design_matrix, left_by_views, rests, sums_of_views

PLANES, VIEWS, VIEW_PX = 12, 5, 0.3


def drawn_rows(seed: int) -> np.ndarray:
    """Ridges of views that each show a stretch of the planes; the last view shows none."""
    rng = np.random.default_rng(seed)
    places = [(i, n) for i in range(PLANES) for n in range(VIEWS - 1) if n <= i <= n + 7]
    values = rng.normal(0, 1, (len(places), 4))
    rows = zip(places, values, strict=True)
    return np.array([(i, e, abs(c) + 0.1, y, z, n) for (i, n), (e, c, y, z) in rows])


@pytest.mark.parametrize("seed", range(3))
def test_a_views_own_shift_and_turn_are_taken_out_as_if_solved_for(seed: int) -> None:
    rows = drawn_rows(seed)
    J, weight, view = design_matrix(rows, VIEWS, PLANES), rows[:, 2].copy(), rows[:, 5].astype(np.int64)
    sums = sums_of_views(J, weight, view, VIEWS)
    left = left_by_views(sums, VIEW_PX)
    calm = np.eye(6)
    step = np.linalg.solve(left[:, :6] + calm, left[:, 9])
    own = np.zeros((len(rows), 2 * VIEWS))
    for k, n in enumerate(view):
        own[k, 2 * n : 2 * n + 2] = J[k, 7:9]
    A = np.hstack([J[:, :6], own])
    prior = np.diag([1.0] * 6 + [VIEW_PX**-2] * 2 * VIEWS)
    every = np.linalg.solve(A.T @ (A * weight[:, None]) + prior, A.T @ (weight * J[:, 9]))
    assert step == pytest.approx(every[:6], rel=1e-9)
    moved = sums[:, 7:9, 9] - sums[:, 7:9, :6] @ step
    assert rests(J, view, moved, sums, step, VIEW_PX) == pytest.approx(J[:, 9] - A @ every, abs=1e-9)


def test_the_columns_are_the_derivatives_of_a_distance() -> None:
    rows = drawn_rows(3)
    J = design_matrix(rows, VIEWS, PLANES)
    s, by_y, by_z = rows[:, 0] / (PLANES - 1), rows[:, 3], rows[:, 4]
    theta = np.array([0.3, -0.2, 0.5, 0.1, 0.4, -0.6])
    hump = 4 * s * (1 - s)
    y = theta[0] + (theta[1] - theta[0]) * s + theta[5] * hump
    z = theta[2] + (theta[3] - theta[2]) * s - theta[4] * hump
    assert J[:, :6] @ theta == pytest.approx(by_y * y + by_z * z)
    assert (J[:, 7] == 1).all() and (J[:, 9] == rows[:, 1]).all()
    for n in range(VIEWS - 1):
        turn = J[rows[:, 5] == n, 8]
        assert turn[0] == pytest.approx(-1) and turn[-1] == pytest.approx(1) and (np.diff(turn) > 0).all()
