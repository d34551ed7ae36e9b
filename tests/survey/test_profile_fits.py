"""Fits of many profiles at once, against NumPy's least squares of one after the other."""

import numpy as np
import pytest

from plnerf.survey.refine.profile_fits import least_squares

K, N, C = 6, 25, 7


def test_they_are_those_of_each_profile_alone() -> None:
    rng = np.random.default_rng(0)
    columns = rng.normal(0, 1, (K, N, C))
    profile, wider, blurred = rng.normal(0, 20, (3, K, N))
    step_px = np.full(K, 0.5)
    fits = least_squares(profile, columns, wider, blurred, step_px, 0.1)
    for k in range(K):
        of, (left,), *_ = np.linalg.lstsq(columns[k], profile[k], rcond=None)
        assert fits.of[k] == pytest.approx(of[:3], abs=1e-5)
        noise = left / (0.5 * N - 5) + 0.1 / 0.5
        inverse = np.linalg.inv(columns[k].T @ columns[k])
        assert fits.variance[k] == pytest.approx(noise * inverse[:3, :3], abs=1e-4)
        beside, *_ = np.linalg.lstsq(np.column_stack([columns[k], wider[k]]), profile[k], rcond=None)
        assert fits.wider[k] == pytest.approx(beside[-1], abs=1e-5)
        alone = wider[k] - columns[k] @ np.linalg.lstsq(columns[k], wider[k], rcond=None)[0]
        assert fits.wider_by_blur[k] == pytest.approx(alone @ blurred[k] / (alone @ alone), abs=1e-5)
        assert fits.variance_wider[k] == pytest.approx(noise / (alone @ alone), rel=1e-4)


def test_columns_of_nothing_get_nothing() -> None:
    rng = np.random.default_rng(1)
    columns = np.concatenate([rng.normal(0, 1, (K, N, 5)), np.zeros((K, N, 2))], 2)
    profile, wider, blurred = rng.normal(0, 20, (3, K, N))
    some = (wider, blurred, np.full(K, 0.5), 0.1)
    both = columns, columns[:, :, :5].copy()
    with_nothing, without = (least_squares(profile, one, *some) for one in both)
    assert with_nothing.of == pytest.approx(without.of) and np.isfinite(with_nothing.variance).all()
