"""Narrowing a curve down: the sweep's vote again, around the curve, in cells ever smaller.

Exhaustive in each step: coordinate by coordinate, curves get stuck halfway, because the height of an end and
the sag trade against each other.  Letters as in `sweep.py`.
"""

from typing import no_type_check

import numpy as np
from jaxtyping import Float
from numba import njit, prange

from plnerf.detect.odds import Odds, column_odds
from plnerf.detect.sweep import FEWEST_VIEWS
from plnerf.detect.views import Views

REACH, SAGS = 2, 2
"""Cells to each side that ends and sags are moved by."""
DEAR = 1e-3
"""Of a nat, for each cell moved: of equals the nearest to where it was."""


@njit(cache=True)
@no_type_check
def curve_point(q, s):
    """y, z of a curve at s in [0, 1] along it."""
    return q[0] + (q[1] - q[0]) * s, q[2] + (q[3] - q[2]) * s - 4 * q[4] * s * (1 - s)


def narrow(
    views: Views,
    odds: Odds,
    curves: Float[np.ndarray, "c 5"],
    x: Float[np.ndarray, " i"],
    cells: tuple[float, ...],
) -> Float[np.ndarray, "c 5"]:
    """The best curves near the given ones, in cells of the given widths one after another."""
    for cell in cells:
        curves = narrowed(views, odds, curves, x, cell)
    return curves


@njit(cache=True, parallel=True, error_model="numpy")
@no_type_check
def narrowed(views, odds, curves, x, cell):
    """Each curve (c, 5) at its best within `REACH` cells."""
    planes, side = len(x), 2 * REACH + 1
    s = np.arange(planes) / (planes - 1)
    out = curves.copy()
    for c in prange(len(curves)):
        near = np.zeros((planes, side, side), np.float32)
        total, seen = np.zeros(side), np.zeros(side, np.int64)
        for i in range(planes):
            y, z = curve_point(curves[c], s[i])
            low = z - REACH * cell
            for j in range(side):
                column_odds(
                    views, odds, (x[i], y + (j - REACH) * cell, low), cell, 0.5 * cell, total, seen
                )  # fmt: skip
                for k in range(side):
                    if seen[k] >= FEWEST_VIEWS:
                        near[i, j, k] = total[k]
        best = -np.inf
        move = np.zeros(5)
        sheet = np.empty((planes, side), np.float32)
        for ends in range(side * side):
            a, b = ends // side - REACH, ends % side - REACH
            for i in range(planes):
                sheet[i] = near[i, int(np.floor(a + (b - a) * s[i] + 0.5)) + REACH]
            for heights in range(side * side):
                d, e = heights // side - REACH, heights % side - REACH
                for f in range(-SAGS, SAGS + 1):
                    gain = -DEAR * (abs(a) + abs(b) + abs(d) + abs(e) + abs(f))
                    for i in range(planes):
                        k = int(np.floor(d + (e - d) * s[i] - 4 * f * s[i] * (1 - s[i]) + 0.5)) + REACH
                        if 0 <= k < side:
                            gain += sheet[i, k]
                    if gain > best:
                        best = gain
                        move[0], move[1], move[2], move[3], move[4] = a, b, d, e, f
        out[c] = curves[c] + cell * move
    return out


@njit(cache=True, parallel=True, error_model="numpy")
@no_type_check
def curve_odds(views, odds, curves, x, reach):
    """Odds of each curve in each plane, and how many views see it there: (c, i, 2)."""
    out = np.zeros((len(curves), len(x), 2))
    for c in prange(len(curves)):
        total, seen = np.zeros(1), np.zeros(1, np.int64)
        for i in range(len(x)):
            y, z = curve_point(curves[c], i / (len(x) - 1))
            column_odds(views, odds, (x[i], y, z), 0.0, reach, total, seen)
            out[c, i, 0], out[c, i, 1] = total[0], seen[0]
    return out
