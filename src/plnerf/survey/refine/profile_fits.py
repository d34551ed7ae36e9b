"""Least-squares fits of many short profiles at once, each with columns of its own.

Letters: k profiles of n samples, c columns.
"""

from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Float

from plnerf.ops.kernel_cache import INNER, njit


@dataclass(frozen=True, eq=False)
class Fits:
    """The fits of k profiles."""

    of: Float[np.ndarray, "k 3"]
    """A, B and C."""
    variance: Float[np.ndarray, "k 3 3"]
    wider: Float[np.ndarray, " k"]
    wider_by_blur: Float[np.ndarray, " k"]
    variance_wider: Float[np.ndarray, " k"]


def least_squares(
    profile: Float[np.ndarray, "k n"],
    columns: Float[np.ndarray, "k n c"],
    wider: Float[np.ndarray, "k n"],
    blurred: Float[np.ndarray, "k n"],
    step_px: Float[np.ndarray, " k"],
    quantum: float,
) -> Fits:
    """The first three coefficients of each profile; that of `wider` beside all columns, and in `blurred`.

    columns: of each profile; step_px: from sample to sample; quantum: variance of a grey level's rounding.
    """
    k, _, c = columns.shape
    of, inverse, rest = np.empty((k, c)), np.empty((k, 3, 3)), np.empty((k, 4))
    _solve(profile, columns, wider, blurred, of, inverse, rest)
    left, along, by_blur, strength = rest.T
    # Neighbours half a pixel apart share their noise: a pixel's counts once.
    freedom = profile.shape[1] * step_px - 5
    noise = (left / freedom * step_px + quantum) / step_px
    return Fits(
        of[:, :3], noise[:, None, None] * inverse, along / strength, by_blur / strength, noise / strength
    )


@njit(cache=True, error_model="numpy")
@no_type_check
def _solve(profile, columns, wider, blurred, of, inverse, rest):
    """Into of (k, c): coefficients; inverse (k, 3, 3): that of the normal matrix, for the first three; rest
    (k, 4): the squares of what is left, and of what all columns leave of `wider` (Frisch, Waugh and Lovell)
    the products with what is left, with `blurred` and with itself."""
    samples, c = columns.shape[1:]
    normal, right, unit = np.empty((c, c)), np.empty((c, 2)), np.zeros((c, 3))
    for i in range(3):
        unit[i, i] = 1.0
    for k in range(len(profile)):
        normal[:], right[:] = 0.0, 0.0
        for n in range(samples):
            for a in range(c):
                one = columns[k, n, a]
                right[a, 0] += one * profile[k, n]
                right[a, 1] += one * wider[k, n]
                for b in range(a + 1):
                    normal[a, b] += one * columns[k, n, b]
        _factor(normal)
        both, first = _substituted(normal, right), _substituted(normal, unit)
        of[k], inverse[k] = both[:, 0], first[:3]
        left_2, along, by_blur, strength = 0.0, 0.0, 0.0, 1e-6
        for n in range(samples):
            left, alone = profile[k, n], wider[k, n]
            for a in range(c):
                left -= columns[k, n, a] * both[a, 0]
                alone -= columns[k, n, a] * both[a, 1]
            left_2 += left * left
            along += alone * left
            by_blur += alone * blurred[k, n]
            strength += alone * alone
        rest[k, 0], rest[k, 1], rest[k, 2], rest[k, 3] = left_2, along, by_blur, strength


@njit(cache=True, error_model="numpy", **INNER)
@no_type_check
def _factor(normal):
    """Cholesky's factor, in place of the lower triangle of a symmetric matrix and a little on its diagonal,
    so that columns of nothing get nothing."""
    for a in range(len(normal)):
        for b in range(a + 1):
            total = normal[a, b] + (1e-6 if a == b else 0.0)
            for j in range(b):
                total -= normal[a, j] * normal[b, j]
            normal[a, b] = np.sqrt(total) if a == b else total / normal[b, b]


@njit(cache=True, error_model="numpy", **INNER)
@no_type_check
def _substituted(factor, right):
    """The solution (c, r) for some right-hand sides (c, r)."""
    out = right.copy()
    c = len(factor)
    for r in range(right.shape[1]):
        for a in range(c):
            for j in range(a):
                out[a, r] -= factor[a, j] * out[j, r]
            out[a, r] /= factor[a, a]
        for a in range(c - 1, -1, -1):
            for j in range(a + 1, c):
                out[a, r] -= factor[j, a] * out[j, r]
            out[a, r] /= factor[a, a]
    return out
