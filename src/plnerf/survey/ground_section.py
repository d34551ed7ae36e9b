"""The ground under a wire: a triangulated surface through means of the ground's points.

Letters: n points, m those of the ground, k stations along the wire, c cells, e crossed edges; s, y and z as
in `obstacles.py`.
"""

import math

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import Delaunay, QhullError, cKDTree

from plnerf.line.old_catenary import Catenary
from plnerf.survey.obstacles import beside

SIDE_M = 10.0
"""Ground within this distance of the wire (horizontally) takes part."""
CELL_M = 0.5
"""Points within a square of this side count as their mean: that of points in a plane lies in it."""
AROUND_M, LEAST_AROUND = 2.0, 6
"""How much the ground is scattered about a plane counts within this distance of a station, of so many cells
or more: stems and bushes that were taken for ground show so."""
UNSEEN = 0.1
"""Where the ground is not seen, it may be off by this share of the distance to where it is."""
GAP_M = 10.0
"""Where the nearest ground is farther (horizontally), the ground is not known."""


def ground_under(
    curve: Catenary,
    at: Float[np.ndarray, " k"],
    xyz: Float[np.ndarray, "n 3"],
    index: Int[np.ndarray, " m"],
    sigma_m: Float[np.ndarray, " n"] | None,
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Height of the ground under the wire at the stations `at`, and its standard deviation.

    NaN where no ground lies on both sides, or none within `GAP_M`.  The deviation is that of the points of
    the nearest cell (root mean square: neighbours share their error), 0 where none is stated, the
    scatter of the cells around, and what the distance to that cell leaves open.
    """
    cells, variance = _cells(curve, xyz, index, sigma_m)
    z, sigma = np.full(len(at), np.nan), np.zeros(len(at))
    s, height = _section(cells)
    if not len(s):
        return z, sigma
    distance, nearest = cKDTree(cells[:, :2]).query(np.stack([at, np.zeros(len(at))], 1))
    z = np.interp(at, s, height, left=np.nan, right=np.nan)
    unseen = UNSEEN * np.maximum(distance - CELL_M, 0.0)
    sigma = np.sqrt(variance[nearest] + _scatter(cells, at) ** 2 + unseen**2)
    return np.where(distance <= GAP_M, z, np.nan), sigma


def _scatter(cells: Float[np.ndarray, "c 3"], at: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Standard deviation of the cells' heights about the plane that lies best through those around a station;
    0 where they are few."""
    scatter = np.zeros(len(at))
    near = cKDTree(cells[:, :2]).query_ball_point(np.stack([at, np.zeros(len(at))], 1), AROUND_M)
    for k, some in enumerate(near):
        if len(some) >= LEAST_AROUND:
            plane = np.column_stack([cells[some, :2] - [at[k], 0.0], np.ones(len(some))])
            off = cells[some, 2] - plane @ np.linalg.lstsq(plane, cells[some, 2], rcond=None)[0]
            scatter[k] = np.sqrt((off**2).sum() / (len(some) - 3))
    return scatter


def _section(cells: Float[np.ndarray, "c 3"]) -> tuple[Float[np.ndarray, " e"], Float[np.ndarray, " e"]]:
    """Where the edges of the surface cross the wire's vertical plane y = 0: s in order, and z.

    Between them the section is straight, so that no point need be looked for in a triangle.  Empty where the
    cells make no triangle.
    """
    none = np.empty(0)
    if len(cells) < 3:
        return none, none
    try:
        triangles = Delaunay(cells[:, :2]).simplices
    except QhullError:  # all in one line
        return none, none
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    start, end = cells[edges[:, 0]], cells[edges[:, 1]]
    crosses = (start[:, 1] < 0) != (end[:, 1] < 0)
    start, end = start[crosses], end[crosses]
    share = (start[:, 1] / (start[:, 1] - end[:, 1]))[:, None]
    place = start + share * (end - start)
    order = np.argsort(place[:, 0], kind="stable")
    return place[order, 0], place[order, 2]


def _cells(
    curve: Catenary,
    xyz: Float[np.ndarray, "n 3"],
    index: Int[np.ndarray, " m"],
    sigma_m: Float[np.ndarray, " n"] | None,
) -> tuple[Float[np.ndarray, "c 3"], Float[np.ndarray, " c"]]:
    """Means of s, y and z by cell, and the mean variance; of cells that hold points."""
    rows, columns = (math.ceil((side + 2 * SIDE_M) / CELL_M) + 1 for side in (curve.span_m, 0.0))
    sums = np.zeros((5, rows * columns))
    for some, local in beside(curve, xyz, index, SIDE_M, SIDE_M):
        row, column = np.floor((local[:, :2] + SIDE_M) / CELL_M).astype(np.int64).T
        variance = np.zeros(len(some)) if sigma_m is None else sigma_m[some] ** 2
        for k, values in enumerate((np.ones(len(some)), *local.T, variance)):
            sums[k] += np.bincount(row * columns + column, values, rows * columns)
    count, *totals = sums[:, sums[0] > 0]
    s, y, z, variance = (total / count for total in totals)
    return np.stack([s, y, z], 1), variance
