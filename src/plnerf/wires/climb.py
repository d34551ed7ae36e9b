"""Moving curves uphill on the images' evidence, in steps from a cell's size down to a pixel's.

Letters as in `sweep.py`.
"""

from typing import no_type_check

import numpy as np
from numba import njit, prange

from plnerf.wires.sweep import level_of
from plnerf.wires.views import look_at


@njit(cache=True)
@no_type_check
def curve_point(q, s):
    """y, z of a curve at s in [0, 1] along it."""
    return q[0] + (q[1] - q[0]) * s, q[2] + (q[3] - q[2]) * s - 4 * q[4] * s * (1 - s)


@njit(cache=True, error_model="numpy")
@no_type_check
def curve_score(views, maps, reach, q, x, fewest):
    """Mean over the planes of the mean response within `reach` of the curve, views weighed by 1/depth."""
    total, planes = 0.0, 0
    for i in range(len(x)):
        y, z = curve_point(q, i / (len(x) - 1))
        found, weight, seen = 0.0, 0.0, 0
        for n in range(len(views.R)):
            u, v, depth = look_at(views, n, x[i], y, z)
            if depth < 0:
                continue
            level = level_of(reach * views.focal[n, 0] / depth, len(maps))
            found += maps[level, views.starts[n] + int(v) * views.sizes[n, 0] + int(u)] / depth
            weight += 1 / depth
            seen += 1
        if seen >= fewest:
            total += found / weight
            planes += 1
    return total / max(planes, len(x) // 2)


@njit(cache=True, parallel=True)
@no_type_check
def climb(views, maps, steps, curves, x, fewest):
    """Curves (c, 5) moved coordinate by coordinate, also as a whole; returns them and their scores."""
    moves = np.zeros((7, 5))
    for k in range(5):
        moves[k, k] = 1.0
    moves[5, 0] = moves[5, 1] = 1.0
    moves[6, 2] = moves[6, 3] = 1.0
    scores = np.empty(len(curves))
    climbed = np.empty_like(curves)
    for c in prange(len(curves)):
        q = curves[c].copy()
        for step in steps:
            best = curve_score(views, maps, step, q, x, fewest)
            for _ in range(6):
                moved = False
                for k in range(14):
                    trial = q + (step if k % 2 else -step) * moves[k // 2]
                    value = curve_score(views, maps, step, trial, x, fewest)
                    if value > best + 1e-4:
                        best, q, moved = value, trial, True
                if not moved:
                    break
        climbed[c] = q
        scores[c] = curve_score(views, maps, steps[-1], q, x, fewest)
    return climbed, scores
