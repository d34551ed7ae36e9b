"""Elementary functions in kernels: within their stated accuracy, over the whole float range."""

import numpy as np
import pytest
from numba import njit

from plnerf.ops.cpu_arrays import FAST
from plnerf.ops.cpu_math import exp_and_expm1_neg, power, sin_cos

DTYPES = pytest.mark.parametrize("dtype", [np.float32, np.float64])


@njit(fastmath=FAST)
def exponentials(x, exp_neg, alpha):  # type: ignore[no-untyped-def]
    for i in range(len(x)):
        exp_neg[i], alpha[i] = exp_and_expm1_neg(x[i])


@njit(fastmath=FAST)
def circle(x, sine, cosine):  # type: ignore[no-untyped-def]
    for i in range(len(x)):
        sine[i], cosine[i] = sin_cos(x[i])


@njit(fastmath=FAST)
def powers(x, exponent, out):  # type: ignore[no-untyped-def]
    for i in range(len(x)):
        out[i] = power(x[i], exponent)


@DTYPES
def test_exponentials_is_accurate_relatively(dtype: type) -> None:
    x = np.concatenate([[0], np.logspace(-37, 1.9, 40_001), np.linspace(0, 87, 40_001)]).astype(dtype)
    exp_neg, alpha = np.empty_like(x), np.empty_like(x)
    exponentials(x, exp_neg, alpha)
    np.testing.assert_allclose(exp_neg, np.exp(-x.astype(np.float64)), rtol=1.5e-7)
    np.testing.assert_allclose(alpha, -np.expm1(-x.astype(np.float64)), rtol=1.5e-7)
    assert (exp_neg[0], alpha[0]) == (1, 0)


@DTYPES
def test_exponentials_ends_and_nan_stays(dtype: type) -> None:
    x = np.array([87.01, 1e3, 1e30, np.inf, np.nan], dtype)
    exp_neg, alpha = np.empty_like(x), np.empty_like(x)
    exponentials(x, exp_neg, alpha)
    np.testing.assert_allclose(exp_neg[:4], 0, atol=1.7e-38)
    assert alpha[:4].tolist() == [1, 1, 1, 1]
    assert exp_neg[2] == exp_neg[3] == 0
    assert np.isnan(exp_neg[4])
    assert np.isnan(alpha[4])


@DTYPES
def test_sine_and_cosine_are_accurate(dtype: type) -> None:
    rng = np.random.default_rng(0)
    x = np.concatenate([[0], *(rng.uniform(-size, size, 50_000) for size in (1, 100, 8192))]).astype(dtype)
    sine, cosine = np.empty_like(x), np.empty_like(x)
    circle(x, sine, cosine)
    np.testing.assert_allclose(sine, np.sin(x.astype(np.float64)), atol=2e-7)
    np.testing.assert_allclose(cosine, np.cos(x.astype(np.float64)), atol=2e-7)
    assert (sine[0], cosine[0]) == (0, 1)


@DTYPES
@pytest.mark.parametrize("exponent", [0.05, 0.5, 0.97])
def test_power_is_accurate_for_denormal_numbers_too(dtype: type, exponent: float) -> None:
    x = np.concatenate([[0, 1e-45], np.logspace(-44, 0, 40_001), np.linspace(0, 1, 40_001)]).astype(dtype)
    found = np.empty_like(x)
    powers(x, dtype(exponent), found)
    truth = x.astype(np.float64) ** float(dtype(exponent))
    normal = truth > 2e-38
    np.testing.assert_allclose(found[normal], truth[normal], rtol=1e-5)
    np.testing.assert_allclose(found[~normal], truth[~normal], atol=2e-38)
    assert found[0] == 0
