"""Single trees, buildings and other things among the points of a cloud.

Points are grouped by cells in plan.  Every cell of plants leads to the highest of the cells around it, so
that cells form hills; two hills are one crown unless both rise above the saddle between them by a set
prominence.  Buildings and other things are whatever is connected.

Letters: m points, c cells with points, e pairs of neighbouring hills; LineFrame, metres, z up.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import ConvexHull, QhullError, cKDTree

from plnerf.survey.config_encroachments import EncroachmentConfig

LEAST_SIDE_M = 0.25
"""Half the side of the polygon around a thing that has no extent."""
WIRE_LENGTH_M, WIRE_SHARE, WIRE_SLOPE, WIRE_CLEAR_M = 3.0, 0.3, 0.5, 2.0
"""A wire that was not found: its length, its width as a share of that, how steep it is at most (the sine),
and how far beside it no plant stands."""
GROUND_CELL_M = 2.0
GROUND_CELLS = 6
"""Cells of the ground whose plane is its height at a place."""
GROUND_REACH_M = 15.0
"""Where the nearest are farther, the ground is not known."""


def separated(
    xyz: Float[np.ndarray, "m 3"], height_m: Float[np.ndarray, " m"] | None, config: EncroachmentConfig
) -> Int[np.ndarray, " m"]:
    """The number of the object of every point, from 0.  height_m: above the ground, of plants; None: things
    that are connected are one."""
    if not len(xyz):
        return np.zeros(0, np.int64)
    place, cell = np.unique(
        np.floor(xyz[:, :2] / config.cell_m).astype(np.int64), axis=0, return_inverse=True
    )
    cell = cell.reshape(-1)
    top = np.full(len(place), -np.inf)
    np.maximum.at(top, cell, np.zeros(len(xyz)) if height_m is None else height_m)
    near = cKDTree(place).query_pairs(config.reach_cells + 0.5, p=np.inf, output_type="ndarray")
    hill = _hills(top, near)
    least = np.maximum(config.prominence_m, config.prominence_share * top)
    whole = _merged(hill, top, near, np.full(len(top), np.inf) if height_m is None else least)
    return np.unique(whole, return_inverse=True)[1].reshape(-1)[cell]


def _hills(top: Float[np.ndarray, " c"], near: Int[np.ndarray, "p 2"]) -> Int[np.ndarray, " c"]:
    """Of every cell the summit that the way upwards from it leads to; of equally high ones the later cell is
    higher."""
    rank = np.empty(len(top), np.int64)
    rank[np.argsort(top, kind="stable")] = np.arange(len(top))
    best = rank.copy()
    for here, there in (near.T, near.T[::-1]):
        np.maximum.at(best, here, rank[there])
    upwards = np.argsort(top, kind="stable")[best]
    while (upwards[upwards] != upwards).any():
        upwards = upwards[upwards]
    return upwards


def _merged(
    hill: Int[np.ndarray, " c"], top: Float[np.ndarray, " c"], near: Int[np.ndarray, "p 2"],
    prominence: Float[np.ndarray, " c"],
) -> Int[np.ndarray, " c"]:  # fmt: skip
    """Hills whose lower summit does not rise by its prominence above their saddle are one; the highest
    saddles first."""
    pairs = hill[near]
    apart = pairs[:, 0] != pairs[:, 1]
    pairs, saddle = np.sort(pairs[apart], axis=1), top[near[apart]].min(1)
    parent = np.arange(len(top))

    def root(one: int) -> int:
        while parent[one] != one:
            parent[one] = parent[parent[one]]
            one = int(parent[one])
        return one

    order = np.lexsort((-saddle, pairs[:, 1], pairs[:, 0]))
    pairs, saddle = pairs[order], saddle[order]
    first = np.r_[True, (np.diff(pairs, axis=0) != 0).any(1)] if len(pairs) else np.zeros(0, np.bool_)
    pairs, saddle = pairs[first], saddle[first]
    for k in np.argsort(-saddle, kind="stable"):
        one, other = root(int(pairs[k, 0])), root(int(pairs[k, 1]))
        low, high = (one, other) if top[one] <= top[other] else (other, one)
        if low != high and top[low] - saddle[k] < prominence[low]:
            parent[low] = high
    return np.array([root(int(one)) for one in np.unique(hill)])[np.unique(hill, return_inverse=True)[1]]


def members(number: Int[np.ndarray, " m"]) -> list[Int[np.ndarray, " _"]]:
    """The indices of the points of each object, by the objects' numbers."""
    order = np.argsort(number, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(number[order])) + 1) if len(order) else []


def dense_groups(
    xyz: Float[np.ndarray, "m 3"], number: Int[np.ndarray, " m"], spacing_m: float, config: EncroachmentConfig
) -> Bool[np.ndarray, " o"]:
    """Of each object, whether half of its points have enough others of the same around them: a few wrong
    matches beside a crown are no plant.

    spacing_m: distance between the ground's points, which tells how dense this cloud is.
    """
    if not len(xyz):
        return np.zeros(0, np.bool_)
    reach_m = max(config.around_m, config.around_spacings * spacing_m)
    apart = np.column_stack([xyz, 2 * reach_m * number])  # objects are out of each other's reach
    others = cKDTree(apart).query_ball_point(apart, reach_m, return_length=True, workers=-1) - 1
    order = np.lexsort((others, number))
    _, first, count = np.unique(number[order], return_index=True, return_counts=True)
    dense: Bool[np.ndarray, " o"] = others[order][first + count // 2] >= config.min_around
    return dense


def wire_like(
    xyz: Float[np.ndarray, "m 3"], height_m: Float[np.ndarray, " m"], number: Int[np.ndarray, " m"]
) -> Bool[np.ndarray, " o"]:
    """Of each object of plants, whether it is a wire that was not found rather than one: level, narrow, and
    with nothing of any plant in the lower half of the space below.

    height_m: of each point above the ground.
    """
    parts = members(number)
    found = np.zeros(len(parts), np.bool_)
    tree = cKDTree(xyz[:, :2])
    for k, part in enumerate(parts):
        off = xyz[part] - xyz[part].mean(0)
        spread, axes = np.linalg.eigh(off.T @ off)
        level = abs(axes[2, 2]) <= WIRE_SLOPE and spread[1] <= WIRE_SHARE**2 * spread[2]
        if level and np.ptp(off @ axes[:, 2]) >= WIRE_LENGTH_M:
            below = np.concatenate(tree.query_ball_point(xyz[part, :2], WIRE_CLEAR_M)).astype(int)
            found[k] = height_m[below].min() > height_m[part].max() / 2 > 0
    return found


def outline_of(xyz: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "n 2"]:
    """The convex polygon around points in plan, counterclockwise, its first corner not repeated."""
    flat = xyz[:, :2]
    try:
        found: Float[np.ndarray, "n 2"] = flat[ConvexHull(flat).vertices]
    except (QhullError, ValueError):  # fewer than three points, or all in one line
        low, high = flat.min(0) - LEAST_SIDE_M, flat.max(0) + LEAST_SIDE_M
        found = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    return found


@dataclass(frozen=True, eq=False)
class GroundHeights:
    """The ground as means of cells."""

    cells: Float[np.ndarray, "c 3"]
    tree: cKDTree | None
    spacing_m: float = 0.0
    """Median distance between the ground's points."""

    @classmethod
    def of(cls, xyz: Float[np.ndarray, "m 3"]) -> "GroundHeights":
        """Of the ground's points."""
        if not len(xyz):
            return cls(np.zeros((0, 3)), None)
        place, cell = np.unique(
            np.floor(xyz[:, :2] / GROUND_CELL_M).astype(np.int64), axis=0, return_inverse=True
        )
        count = np.bincount(cell.reshape(-1), minlength=len(place))
        sums = [np.bincount(cell.reshape(-1), xyz[:, axis], len(place)) for axis in range(3)]
        cells = np.stack(sums, 1) / count[:, None]
        return cls(cells, cKDTree(cells[:, :2]), GROUND_CELL_M / float(np.sqrt(np.median(count))))

    def at(self, xy: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, " m"]:
        """Height of the nearest cell, precise enough to separate objects; NaN where none is near."""
        if self.tree is None:
            return np.full(len(xy), np.nan)
        distance, nearest = self.tree.query(xy, distance_upper_bound=GROUND_REACH_M, workers=-1)
        known: Bool[np.ndarray, " m"] = np.isfinite(distance)
        z = np.full(len(xy), np.nan)
        z[known] = self.cells[nearest[known], 2]
        return z

    def plane(self, xy: Float[np.ndarray, "2"]) -> tuple[float, float]:
        """Height and its standard deviation by the plane through the cells around a place; NaN where none are
        near."""
        if self.tree is None or len(self.cells) < GROUND_CELLS:
            return np.nan, np.nan
        distance, nearest = self.tree.query(xy, GROUND_CELLS)
        if distance[0] > GROUND_REACH_M:
            return np.nan, np.nan
        some = self.cells[nearest]
        plane = np.column_stack([some[:, :2] - xy, np.ones(len(some))])
        found, *_ = np.linalg.lstsq(plane, some[:, 2], rcond=None)
        off = some[:, 2] - plane @ found
        scatter = float(np.sqrt((off**2).sum() / (len(some) - 3)))
        return float(found[2]), float(np.hypot(scatter, 0.1 * max(0.0, distance[0] - GROUND_CELL_M)))
