"""Where conductors may hang: evidence in planes across the span, then a vote of hanging curves.

Letters: the span runs along +x of the scene frame; planes i at x_i, cells j across (y) and k upwards (z).  A
curve is q = (y0, y1, z0, z1, b): offset and height in the first and in the last plane, and the sag b below
the chord; y is linear and z quadratic in x (a parabola is within millimetres of a catenary of the same sag).
n views; everything in scene units.
"""

from typing import NamedTuple, no_type_check

import cv2
import numpy as np
from jaxtyping import Float
from numba import njit, prange
from scipy.ndimage import maximum_filter

from plnerf.wires.views import Views, look_at

FEWEST_VIEWS = 3
COARSE = 3
"""Cells that become one, in each direction, before the vote."""
STEEPEST = 0.25
"""Largest slope of a chord upwards: 14 degrees."""
ASKEW = 0.05
"""Largest slope of a chord across the axis: 3 degrees."""
DEEPEST = 0.06
"""Largest sag, as a share of the length."""
CANDIDATES = 150


class Box(NamedTuple):
    """Where conductors are looked for: planes at x, and cells from `low` (y, z) on."""

    x: Float[np.ndarray, " i"]
    low: tuple[float, float]
    cell: float
    shape: tuple[int, int]  # cells across and upwards


def pool(values: Float[np.ndarray, " p"], views: Views, levels: int) -> Float[np.ndarray, "l p"]:
    """Maxima of the maps over discs of radius 1, 2, 4 ... pixels."""
    out = np.empty((levels, len(values)), np.float32)
    for (w, h), start in zip(views.sizes, views.starts, strict=True):
        part = slice(start, start + w * h)
        for level in range(levels):
            size = 1 + 2 * (1 << level)
            disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
            out[level, part] = cv2.dilate(values[part].reshape(h, w), disc).ravel()
    return out


def candidates(views: Views, pooled: Float[np.ndarray, "l p"], box: Box) -> Float[np.ndarray, "c 5"]:
    """The curves with most evidence, best first, at most one for each place of the first plane."""
    volume = cell_evidence(views, pooled, box.x, box.low, box.cell, box.shape, FEWEST_VIEWS)
    middle = COARSE // 2
    coarse = maximum_filter(volume, (1, COARSE, COARSE))[:, middle::COARSE, middle::COARSE].copy()
    cell = COARSE * box.cell
    length = box.x[-1] - box.x[0]
    sags = np.arange(0.0, DEEPEST * length + cell, cell) / cell
    score, ends = vote(coarse, round(ASKEW * length / cell), round(STEEPEST * length / cell), sags)
    best = np.argwhere((score == maximum_filter(score, 3)) & (score > 0))
    best = best[np.argsort(-score[best[:, 0], best[:, 1]], kind="stable")][:CANDIDATES]
    j0, k0 = best.T
    j1, k1, b = ends[j0, k0].T
    y, z = (low + box.cell * (middle + COARSE * np.arange(max(coarse.shape))) for low in box.low)
    return np.stack([y[j0], y[j1], z[k0], z[k1], sags[b] * cell], 1)


@njit(cache=True, parallel=True, error_model="numpy")
@no_type_check
def cell_evidence(views, pooled, x, low, cell, shape, fewest):
    """Mean response of each cell over the views that see it; 0 where fewer than `fewest` do."""
    ny, nz = shape
    out = np.zeros((len(x), ny, nz), np.float32)
    for ij in prange(len(x) * ny):
        i, j = ij // ny, ij % ny
        y = low[0] + j * cell
        for k in range(nz):
            z = low[1] + k * cell
            total, seen = 0.0, 0
            for n in range(len(views.R)):
                u, v, depth = look_at(views, n, x[i], y, z)
                if depth < 0:
                    continue
                total += pooled[
                    level_of(0.33 * cell * views.focal[n, 0] / depth, len(pooled)),
                    views.starts[n] + int(v) * views.sizes[n, 0] + int(u),
                ]
                seen += 1
            if seen >= fewest:
                out[i, j, k] = total / seen
    return out


@njit(cache=True)
@no_type_check
def level_of(radius_px, levels):
    """The pooled map whose discs are about as large."""
    level = 0
    while level + 1 < levels and (1 << level) < radius_px:
        level += 1
    return level


@njit(cache=True, parallel=True)
@no_type_check
def vote(volume, drift_y, drift_z, sags):
    """Best mean evidence of the curves that begin in each cell of the first plane, and which they are.

    volume (i, j, k).  Ends drift by at most so many cells across and upwards; sags in cells.  Returns score
    (j, k) and the winners' last j, last k and sag index (j, k, 3).
    """
    planes, ny, nz = volume.shape
    score = np.zeros((ny, nz), np.float32)
    winner = np.zeros((ny, nz, 3), np.int64)
    s = np.arange(planes) / (planes - 1)
    for j0 in prange(ny):
        sheet = np.empty((planes, nz), np.float32)
        for j1 in range(max(0, j0 - drift_y), min(ny, j0 + drift_y + 1)):
            for i in range(planes):
                sheet[i] = volume[i, int(j0 + (j1 - j0) * s[i] + 0.5)]
            for k0 in range(nz):
                for k1 in range(max(0, k0 - drift_z), min(nz, k0 + drift_z + 1)):
                    for b in range(len(sags)):
                        total = 0.0
                        for i in range(planes):
                            k = int(k0 + (k1 - k0) * s[i] - 4 * sags[b] * s[i] * (1 - s[i]) + 0.5)
                            if k >= 0:
                                total += sheet[i, k]
                        if total > score[j0, k0] * planes:
                            score[j0, k0] = total / planes
                            winner[j0, k0, 0], winner[j0, k0, 1], winner[j0, k0, 2] = j1, k1, b
    return score, winner
