"""Where wires may hang: log odds in planes across the span, then a vote of hanging curves, coarse to fine.

Letters: the span runs along +x of the scene frame; planes i at x_i, cells j across (y) and k upwards (z).  A
curve is theta = (y_A, y_B, z_A, z_B, b): offset and height in the first and in the last plane, and the sag b
below the chord; y is linear and z quadratic in x (a parabola is within millimetres of a catenary of the same
sag).  n views; everything in scene units.
"""

from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float, Float32, Int

from plnerf.detect.config import SweepConfig
from plnerf.detect.narrow import curve_point
from plnerf.detect.odds import Odds, column_odds
from plnerf.detect.views import Views
from plnerf.ops.kernel_cache import njit, prange


class Box(NamedTuple):
    """The volume that is searched: planes at x, and cells from `low` (y, z) on."""

    x: Float[np.ndarray, " i"]
    low: tuple[float, float]
    cell: float
    shape: tuple[int, int]  # cells across and upwards


def sweep(views: Views, odds: Odds, box: Box, config: SweepConfig) -> Float32[np.ndarray, "i j k"]:
    """Log odds of a wire in each cell of each plane, limited so that no plane outvotes others."""
    volume = cell_odds(views, odds, box, config.min_views)
    return np.clip(volume, config.min_plane, config.max_plane)


def candidates(
    volume: Float32[np.ndarray, "i j k"], box: Box, config: SweepConfig
) -> Float[np.ndarray, "c 5"]:
    """The curves of any shape with the highest odds, best first, none within `apart` cells of another."""
    pyramid = [volume]
    for _ in range(config.halvings):
        pyramid.append(halved(pyramid[-1], config.min_plane))
    length = (box.x[-1] - box.x[0]) / box.cell / 2**config.halvings
    sags = np.arange(round(config.max_sag * length) + 1)
    drift = max(1, round(config.max_askew * length)), max(1, round(config.max_slope * length))
    score, sag = vote(pyramid[-1], *drift, sags)
    order = best_of_each_start(score, config.per_start)
    order = order[np.argsort(-score.ravel()[order], kind="stable")[: config.beam]]
    j0, j1, k0, k1 = np.unravel_index(order, score.shape)
    curves = np.stack([j0, j0 + j1 - drift[0], k0, k1, sag.ravel()[order]], 1)
    for finer in pyramid[-2::-1]:
        curves, score = refine(finer, 2 * curves)
        curves, score = best_distinct(curves, score, len(curves) // 4)
    return _scene_units(well_apart(curves, config.apart, config.max_candidates), box)


def best_of_each_start(score: Float32[np.ndarray, "j d k m"], most: int) -> Int[np.ndarray, " n"]:
    """Flat indices of the best curves that begin in each cell.

    A strong line has many neighbours that are nearly as good: they would fill the beam.
    """
    flat = np.arange(score.size).reshape(score.shape).transpose(0, 2, 1, 3).reshape(
        score.shape[0] * score.shape[2], -1
    )  # fmt: skip
    most = min(most, flat.shape[1])
    best = np.argpartition(-score.ravel()[flat], most - 1, axis=1)[:, :most]
    chosen = np.take_along_axis(flat, best, 1).ravel()
    return np.sort(chosen[np.isfinite(score.ravel()[chosen])])


def candidates_like(
    theta: Float[np.ndarray, "5"],
    s: float,
    volume: Float32[np.ndarray, "i j k"],
    box: Box,
    config: SweepConfig,
) -> Float[np.ndarray, "c 5"]:
    """The same for curves of the shape of theta, or nearly: all wires of a span hang much alike.

    s: where along them they must lie in the box; a piece of a curve may leave it elsewhere.
    """
    _, ny, nz = volume.shape
    y, z = curve_point(theta, s)
    shape = np.rint((theta - np.array([y, y, z, z, 0.0])) / box.cell).astype(np.int64)
    j, k = (part.ravel() for part in np.meshgrid(np.arange(ny), np.arange(nz), indexing="ij"))
    curves = shape + np.stack([j, j, k, k, np.zeros_like(j)], 1)
    for most in (config.beam // 4, config.beam // 16):
        curves, score = refine(volume, curves)
        curves, score = best_distinct(curves, score, most)
    return _scene_units(well_apart(curves, config.apart, config.max_candidates), box)


def halved(volume: Float32[np.ndarray, "i j k"], outside: float) -> Float32[np.ndarray, "i J K"]:
    """The largest of 2 x 2 cells: cells twice as wide; `outside` is the value beyond the last cell."""
    i, j, k = volume.shape
    padded = np.full((i, j + j % 2, k + k % 2), outside, np.float32)
    padded[:, :j, :k] = volume
    return padded.reshape(i, (j + 1) // 2, 2, (k + 1) // 2, 2).max((2, 4))


def best_distinct(
    curves: Int[np.ndarray, "c 5"], score: Float[np.ndarray, " c"], most: int
) -> tuple[Int[np.ndarray, "d 5"], Float[np.ndarray, " d"]]:
    """The best of the curves, each once."""
    curves, first = np.unique(curves, axis=0, return_index=True)
    score = score[first]
    order = np.argsort(-score, kind="stable")[:most]
    return curves[order], score[order]


def well_apart(curves: Int[np.ndarray, "c 5"], cells: int, most: int) -> Int[np.ndarray, "d 5"]:
    """The first of all curves that lie within some cells of each other at both ends and in the middle."""
    y_A, y_B, z_A, z_B, b = curves.T
    place = np.stack([y_A, y_B, (y_A + y_B) / 2, z_A, z_B, (z_A + z_B) / 2 - b], 1)
    kept: list[int] = []
    for c in range(len(curves)):
        if not kept or (np.abs(place[kept] - place[c]).max(1) > cells).all():
            kept.append(c)
            if len(kept) == most:
                break
    return curves[kept]


def _scene_units(cells: Int[np.ndarray, "c 5"], box: Box) -> Float[np.ndarray, "c 5"]:
    low = np.array([box.low[0], box.low[0], box.low[1], box.low[1], 0.0])
    return low + box.cell * cells


@njit(cache=True, parallel=True, error_model="numpy")
@no_type_check
def cell_odds(views, odds, box, min_views):
    """Log odds of each cell (i, j, k): the sum over the views that see it; 0 where too few do."""
    x, low, cell, (ny, nz) = box.x, box.low, box.cell, box.shape
    out = np.zeros((len(x), ny, nz), np.float32)
    for ij in prange(len(x) * ny):
        i, j = ij // ny, ij % ny
        total, seen, finest = np.zeros(nz), np.zeros(nz, np.int64), np.zeros(nz)
        foot = (x[i], low[0] + j * cell, low[1])
        column_odds(views, odds, foot, cell, 0.5 * cell, total, seen, finest)
        for k in range(nz):
            if seen[k] >= min_views:
                out[i, j, k] = total[k]
    return out


@njit(cache=True, parallel=True)
@no_type_check
def vote(volume, drift_y, drift_z, sags):
    """Mean odds of the best sag for each pair of ends, and that sag.

    volume (i, j, k).  Ends drift by at most so many cells across and upwards; the result is indexed by first
    j, its drift + drift_y, first k and last k.
    """
    planes, ny, nz = volume.shape
    score = np.full((ny, 2 * drift_y + 1, nz, nz), -np.inf, np.float32)
    winner = np.zeros(score.shape, np.int16)
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
                            k = int(np.floor(k0 + (k1 - k0) * s[i] - 4 * sags[b] * s[i] * (1 - s[i]) + 0.5))
                            if k >= 0:
                                total += sheet[i, k]
                        if total > score[j0, j1 - j0 + drift_y, k0, k1] * planes:
                            score[j0, j1 - j0 + drift_y, k0, k1] = total / planes
                            winner[j0, j1 - j0 + drift_y, k0, k1] = sags[b]
    return score, winner


@njit(cache=True, parallel=True)
@no_type_check
def refine(volume, curves):
    """Each curve (c, 5), in cells, moved by up to a cell in each of its five numbers; and its mean odds."""
    planes, ny, nz = volume.shape
    best = np.full(len(curves), -np.inf, np.float32)
    out = curves.copy()
    s = np.arange(planes) / (planes - 1)
    for c in prange(len(curves)):
        sheet = np.empty((planes, nz), np.float32)
        for ends in range(9):
            j0, j1 = curves[c, 0] + ends // 3 - 1, curves[c, 1] + ends % 3 - 1
            if min(j0, j1) < 0 or max(j0, j1) >= ny:
                continue
            for i in range(planes):
                sheet[i] = volume[i, int(j0 + (j1 - j0) * s[i] + 0.5)]
            for move in range(27):
                k0, k1 = curves[c, 2] + move // 9 - 1, curves[c, 3] + move // 3 % 3 - 1
                b = curves[c, 4] + move % 3 - 1
                total = 0.0
                for i in range(planes):
                    k = int(np.floor(k0 + (k1 - k0) * s[i] - 4 * b * s[i] * (1 - s[i]) + 0.5))
                    if 0 <= k < nz:
                        total += sheet[i, k]
                if total > best[c] * planes:
                    best[c] = total / planes
                    out[c, 0], out[c, 1], out[c, 2], out[c, 3], out[c, 4] = j0, j1, k0, k1, b
    return out, best
