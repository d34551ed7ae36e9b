"""Cells of a hash grid's level and the rows of their corners, for use inside of Numba kernels.

Letters as in `reference.py`: N cells an axis, cell (i, j, k), fractions (u, v, w) of the point in its cell.
Corner c of a cell is its vertex (i + (c & 1), j + (c >> 1 & 1), k + (c >> 2)).  Per axis: weight s(u) of the
upper vertex, its slope s'(u) and its curvature s''(u), each per cell and not per unit of x.

Whole numbers are uint32, whose products wrap around: that leaves the low bits of a hash as they are, and
sixteen of them fit into a vector register.  Arithmetic is done in the type of the points, `real`: to Numba
an integer times a float32 is a float64.  What Numba compiles is marked no_type_check: a wrapper that checks
annotations cannot be compiled.
"""

from typing import no_type_check

import numpy as np

from plnerf.ops.cpu_arrays import FAST
from plnerf.ops.grid import HASH_PRIMES
from plnerf.ops.kernel_cache import INNER, inlined, njit

BLOCK = 128
"""Points whose corners are found at once.  64 to 256 do equally well: the scratch arrays stay in cache."""

_PRIME_Y, _PRIME_Z = np.uint32(HASH_PRIMES[1]), np.uint32(HASH_PRIMES[2])


@inlined(fastmath=FAST)
@no_type_check
def weight(u, cubic, real):
    return u * u * (real(3) - real(2) * u) if cubic else u


@inlined(fastmath=FAST)
@no_type_check
def slope(u, cubic, real):
    return real(6) * u * (real(1) - u) if cubic else real(1)


@inlined(fastmath=FAST)
@no_type_check
def curvature(u, cubic, real):
    return real(6) - real(12) * u if cubic else real(0)


@inlined(fastmath=FAST)
@no_type_check
def locate(value, n, real):
    """Cell and fraction of a coordinate.  Beyond the cube, and for NaN, a border cell: rows in bounds."""
    scaled = value * real(n)
    inside = scaled if scaled > real(0) else real(0)
    inside = inside if inside < real(n - 1) else real(n - 1)
    cell = np.int32(inside)
    return np.uint32(cell), scaled - real(cell)


@inlined(fastmath=FAST)
@no_type_check
def dense_row(i, j, k, n):
    """Row of a vertex within its level, where that is an array of all (N + 1)^3 vertices."""
    side = np.uint32(n + 1)
    return np.uint32(i + side * np.uint32(j + np.uint32(side * k)))


@inlined(fastmath=FAST)
@no_type_check
def hashed_row(i, j, k, mask):
    """Row of a vertex within its level of T = mask + 1 rows.  Instant-NGP eq. 4."""
    return np.uint32((i ^ np.uint32(j * _PRIME_Y) ^ np.uint32(k * _PRIME_Z)) & np.uint32(mask))


@inlined(fastmath=FAST)
@no_type_check
def vertex_row(i, j, k, n, dense, mask):
    return dense_row(i, j, k, n) if dense else hashed_row(i, j, k, mask)


@inlined(fastmath=FAST)
@no_type_check
def _fill(x, first, count, n, dense, mask, cubic, rows, shares):  # noqa: PLR0913 (a kernel's arrays, one by one)
    real = x.dtype.type
    one = real(1)
    for p in range(count):
        q = np.uint64(3 * (first + p))
        i, u = locate(x[q], n, real)
        j, v = locate(x[q + np.uint64(1)], n, real)
        k, w = locate(x[q + np.uint64(2)], n, real)
        u, v, w = weight(u, cubic, real), weight(v, cubic, real), weight(w, cubic, real)
        for c in range(8):
            a, b, d = np.uint32(c & 1), np.uint32(c >> 1 & 1), np.uint32(c >> 2)
            corner = np.uint64(c * BLOCK + p)
            rows[corner] = vertex_row(np.uint32(i + a), np.uint32(j + b), np.uint32(k + d), n, dense, mask)
            side = (v if b else one - v) * (w if d else one - w)
            shares[corner] = (u if a else one - u) * side


@njit(fastmath=FAST, **INNER)
@no_type_check
def fill_corners(x, first, count, n, dense, mask, cubic, rows, shares):  # noqa: PLR0913 (as above)
    """Rows within the level, and weights, of the eight corners around the points first .. first + count - 1.

    x is flat, (3 n); corner c of the block's point p is written to rows[c BLOCK + p] and shares[c BLOCK + p],
    uint32 and real, 8 BLOCK long.  LLVM vectorises this: 0.7 ns a point and level, so that nothing would be
    gained by keeping rows and weights for the backward pass.
    """
    if dense:  # decided here and not at every point: the loop has no branches
        _fill(x, first, count, n, True, mask, cubic, rows, shares)
    else:
        _fill(x, first, count, n, False, mask, cubic, rows, shares)
