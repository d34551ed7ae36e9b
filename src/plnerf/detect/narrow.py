"""The sweep's vote again, around single curves, in ever smaller cells.

Exhaustive in each step: coordinate by coordinate, curves get stuck halfway, because the height of an end and
the sag trade against each other.  Letters as in `sweep.py`.
"""

from collections.abc import Sequence
from typing import no_type_check

import numpy as np
from jaxtyping import Float

from plnerf.detect.config import DetectConfig
from plnerf.detect.odds import Odds, column_odds
from plnerf.detect.views import Views
from plnerf.ops.kernel_cache import njit, prange


@njit(cache=True)
@no_type_check
def curve_point(theta, s):
    """y, z of a curve at s in [0, 1] along it."""
    y = theta[0] + (theta[1] - theta[0]) * s
    return y, theta[2] + (theta[3] - theta[2]) * s - 4 * theta[4] * s * (1 - s)


def narrow(
    views: Views,
    odds: Odds,
    curves: Float[np.ndarray, "c 5"],
    x: Float[np.ndarray, " i"],
    widths: Sequence[float],
    config: DetectConfig,
) -> Float[np.ndarray, "c 5"]:
    """The best curves near the given ones, in cells of finer and finer widths (units of the sweep's cell)."""
    moves = config.narrow.reach, config.narrow.sags, config.narrow.move_cost
    for width in widths:
        curves = narrowed(views, odds, curves, x, config.sweep.cell * width, moves, config.sweep.min_views)
    return curves


@njit(cache=True, parallel=True, error_model="numpy")
@no_type_check
def narrowed(views, odds, curves, x, cell, moves, min_views):
    """Each curve (c, 5) at its best within `reach` cells.

    moves: the cells to each side by which ends are moved, and sags, and the cost of a cell in nats.
    """
    reach, sags, move_cost = moves
    planes, side = len(x), 2 * reach + 1
    s = np.arange(planes) / (planes - 1)
    out = curves.copy()
    for c in prange(len(curves)):
        near = np.zeros((planes, side, side), np.float32)
        total, seen, finest = np.zeros(side), np.zeros(side, np.int64), np.zeros(side)
        for i in range(planes):
            y, z = curve_point(curves[c], s[i])
            low = z - reach * cell
            for j in range(side):
                column_odds(
                    views, odds, (x[i], y + (j - reach) * cell, low), cell, 0.5 * cell, total, seen, finest
                )  # fmt: skip
                for k in range(side):
                    if seen[k] >= min_views:
                        near[i, j, k] = total[k]
        best = -np.inf
        move = np.zeros(5)
        sheet = np.empty((planes, side), np.float32)
        for ends in range(side * side):
            a, b = ends // side - reach, ends % side - reach
            for i in range(planes):
                sheet[i] = near[i, int(np.floor(a + (b - a) * s[i] + 0.5)) + reach]
            for heights in range(side * side):
                d, e = heights // side - reach, heights % side - reach
                for f in range(-sags, sags + 1):
                    gain = -move_cost * (abs(a) + abs(b) + abs(d) + abs(e) + abs(f))
                    for i in range(planes):
                        k = int(np.floor(d + (e - d) * s[i] - 4 * f * s[i] * (1 - s[i]) + 0.5)) + reach
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
    """Log odds of each curve in each plane, and the number of views that see it there: (c, i, 2)."""
    out = np.zeros((len(curves), len(x), 2))
    for c in prange(len(curves)):
        total, seen, finest = np.zeros(1), np.zeros(1, np.int64), np.zeros(1)
        for i in range(len(x)):
            y, z = curve_point(curves[c], i / (len(x) - 1))
            column_odds(views, odds, (x[i], y, z), 0.0, reach, total, seen, finest)
            out[c, i, 0], out[c, i, 1] = total[0], seen[0]
    return out
