"""The ground under a wire: a triangulated surface through means of the ground's points.

Letters: n points, m those of the ground, k stations along the wire, c cells, e crossed edges; s along the
wire's base from its first end, v horizontally to the left of the wire, z up; LineFrame, metres.

v is counted from the wire at the same s, so that v = 0 is the line straight below it, swung or not.  Where a
wire runs at an angle to its base or is swung, s and v are not quite square; heights on planes are exact.
"""

import math

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import Delaunay, QhullError, cKDTree

from plnerf.line.wire import Wire
from plnerf.survey.config_ground import PLANE, GroundSectionConfig
from plnerf.survey.obstacles import beside

WITHIN_THREE = 1 / 2
"""Variance of a height inside a triangle of cells, as a share of that of each: the mean over the triangle of
the sum of the squares of the three weights."""


def ground_under(
    wire: Wire,
    at: Float[np.ndarray, " k"],
    xyz: Float[np.ndarray, "n 3"],
    index: Int[np.ndarray, " m"],
    sigma_m: Float[np.ndarray, " n"] | None,
    config: GroundSectionConfig,
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Height of the ground under the wire at the stations `at`, and its standard deviation.

    NaN where no ground lies on both sides, or none within `max_gap_m`.  The variance is the sum of that of
    the nearest cell's points (their mean square, since neighbours share their error; 0 where none is stated),
    what the scatter of the cells around leaves between three of them, or all of it where they are few, and
    what the distance to that cell leaves open.
    """
    cells, variance = _cells(wire, xyz, index, sigma_m, config)
    z, sigma = np.full(len(at), np.nan), np.zeros(len(at))
    s, height = _section(cells)
    if not len(s):
        return z, sigma
    distance, nearest = cKDTree(cells[:, :2]).query(np.stack([at, np.zeros(len(at))], 1))
    z = np.interp(at, s, height, left=np.nan, right=np.nan)
    unseen = config.unseen_slope * np.maximum(distance - config.cell_m, 0.0)
    sigma = np.sqrt(variance[nearest] + _scattered(cells, at, config) + unseen**2)
    return np.where(distance <= config.max_gap_m, z, np.nan), sigma


def _scattered(
    cells: Float[np.ndarray, "c 3"], at: Float[np.ndarray, " k"], config: GroundSectionConfig
) -> Float[np.ndarray, " k"]:
    """Variance of the height at each station by the scatter of the cells about the best plane through those
    around it; 0 where there are too few anywhere for one."""
    variance, stations = np.zeros(len(at)), np.stack([at, np.zeros(len(at))], 1)
    if len(cells) <= PLANE:
        return variance
    tree, enough = cKDTree(cells[:, :2]), min(config.scatter_cells, len(cells))
    within = tree.query_ball_point(stations, config.scatter_radius_m)
    for k, near in enumerate(within):
        few = len(near) < enough
        some = tree.query(stations[k], enough)[1] if few else near
        plane = np.column_stack([cells[some, :2] - stations[k], np.ones(len(some))])
        off = cells[some, 2] - plane @ np.linalg.lstsq(plane, cells[some, 2], rcond=None)[0]
        variance[k] = (1.0 if few else WITHIN_THREE) * (off**2).sum() / (len(some) - PLANE)
    return variance


def _section(cells: Float[np.ndarray, "c 3"]) -> tuple[Float[np.ndarray, " e"], Float[np.ndarray, " e"]]:
    """Where the edges of the surface cross v = 0: s in order, and z.

    Between them the section is straight, so that no triangle need be searched for a point.  Empty where the
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
    wire: Wire,
    xyz: Float[np.ndarray, "n 3"],
    index: Int[np.ndarray, " m"],
    sigma_m: Float[np.ndarray, " n"] | None,
    config: GroundSectionConfig,
) -> tuple[Float[np.ndarray, "c 3"], Float[np.ndarray, " c"]]:
    """Means of s, v and z by cell, and the mean variance, of the cells that hold points."""
    side, cell = config.side_m, config.cell_m
    rows, columns = (math.ceil((length + 2 * side) / cell) + 1 for length in (wire.base.length_m, 0.0))
    sums = np.zeros((5, rows * columns))
    for near, local in beside(wire, xyz, index, side, (side, side)):
        s, y, z = local.T
        v = y - wire.at(s)[:, 0]  # beyond the ends too, so that planes stay planes there
        inside = np.abs(v) <= side
        some, s, v, z = near[inside], s[inside], v[inside], z[inside]
        row, column = (np.floor((place + side) / cell).astype(np.int64) for place in (s, v))
        variance = np.zeros(len(some)) if sigma_m is None else sigma_m[some] ** 2
        for k, values in enumerate((np.ones(len(some)), s, v, z, variance)):
            sums[k] += np.bincount(row * columns + column, values, rows * columns)
    count, *totals = sums[:, sums[0] > 0]
    s, v, z, variance = (total / count for total in totals)
    return np.stack([s, v, z], 1), variance
