"""What a wire may come near to, and the nearest of it at each place along the wire.

Letters: n points, m those of one group, c of a chunk, k stations along the wire; s horizontally from the
wire's end A towards B, y to the left of that line, z up; metres, float64.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from plnerf.line.old_catenary import Catenary
from plnerf.line.polylines import onto_segments
from plnerf.survey.model import (
    BUILDING,
    CONDUCTOR,
    CONNECTOR,
    GROUND,
    HIGH_VEGETATION,
    LOW_VEGETATION,
    NO_WIRE,
    SHIELD,
    TOWER,
    VEGETATION,
    Survey,
)
from plnerf.survey.thresholds import GROUPS, Group

WATER, RAIL, ROAD = 9, 10, 11
OWN = (SHIELD, CONDUCTOR, TOWER, CONNECTOR)
NO_THING = (7, 18, 20, 22)
"""Low and high noise, ignored ground, what was there for a time only."""
_NAMED: dict[Group, tuple[int, ...]] = {
    "ground": (GROUND, WATER, RAIL, ROAD),
    "vegetation": (LOW_VEGETATION, VEGETATION, HIGH_VEGETATION),
    "structures": (BUILDING,),
}
_TOLD = {*OWN, *NO_THING}.union(*_NAMED.values())
CLASSES: dict[Group, tuple[int, ...]] = _NAMED | {
    "other": tuple(code for code in range(256) if code not in _TOLD)
}
"""By group, in the ASPRS classes of LAS 1.4.  What is unclassified or of an unknown class may be a crane."""
SUPPORT_M = 8.0
"""Structures and other points this near (horizontally) to a tower's foot or a wire's end are the tower's."""
NEAR_SUPPORT_M = 4.0
"""Likewise vegetation of clouds that state standard deviations, those from images: in them a lattice is as
scattered as a crown."""
LOOSE_M = 1.0
"""Points of a greater standard deviation are no obstacles: of thousands with errors of metres, the nearest to
the wire is always a wrong one."""
OWN_M = 0.5
"""Other points this near to a wire are its own: spacers, dampers, and what was not labelled as wire."""
REACH_M = 50.0
"""Obstacles are looked for within this distance of the wire, horizontally."""
SAMPLE_M = 0.1
"""Between samples d apart a wire is straight to d^2 / 8p, here 0.1 mm for p as small as 12 m."""
CHUNK = 500_000

RULES = {
    "distance": "the least in space from the wire between its supports, of obstacles within "
    f"{REACH_M:g} m of it horizontally",
    "ground": "ground, water, rails and roads (classes 2, 9, 10, 11)",
    "vegetation": "low, medium and high vegetation (classes 3, 4, 5)",
    "structures": f"buildings (class 6), not within {SUPPORT_M:g} m of a tower's foot or a wire's end",
    "other": "unclassified points (class 1) and all further classes, not within "
    f"{SUPPORT_M:g} m of a tower's foot or a wire's end, and not within {OWN_M:g} m of any wire",
    "left out": "wires, towers (of this line and of others), insulators, noise; in clouds that state "
    f"standard deviations points with more than {LOOSE_M:g} m, vegetation within {NEAR_SUPPORT_M:g} m of a "
    "tower's foot or a wire's end, and what is not beside a wire but beyond its ends, which may be a support "
    "that is not seen",
}


@dataclass(frozen=True, eq=False)
class Nearest:
    """The obstacle nearest to the wire among those beside each station."""

    distance_m: Float[np.ndarray, " k"]
    """Infinite where there is none."""
    index: Int[np.ndarray, " k"]
    """Of the cloud's point; -1 where there is none."""
    s_m: Float[np.ndarray, " k"]
    """Where on the wire it is nearest."""


def obstacles(survey: Survey) -> dict[Group, Int[np.ndarray, " _"]]:
    """Indices of the points that count, by group; `RULES` says in words which."""
    cloud = survey.cloud
    curves = [conductor.fit.curve for conductor in survey.conductors]
    places = [tower.foot[:2] for tower in survey.towers]
    places += [np.array(end[:2]) for curve in curves for end in (curve.a, curve.b)]
    supports = cKDTree(np.array(places)) if places else None
    wires = cKDTree(np.concatenate([sampled(curve) for curve in curves])) if curves else None
    found: dict[Group, Int[np.ndarray, " _"]] = {}
    for group in GROUPS:
        counts = np.isin(np.arange(256), CLASSES[group])
        counted = counts[cloud.label] & (cloud.wire == NO_WIRE)
        if cloud.sigma_m is not None:
            counted &= cloud.sigma_m <= LOOSE_M
        index = np.flatnonzero(counted)
        if group == "vegetation" and cloud.sigma_m is not None:
            index = index[~_within(supports, cloud.xyz[:, :2], index, NEAR_SUPPORT_M)]
        if group in {"structures", "other"}:
            index = index[~_within(supports, cloud.xyz[:, :2], index, SUPPORT_M)]
        if group == "other":
            index = index[~_within(wires, cloud.xyz, index, OWN_M)]
        found[group] = index
    return found


def sampled(curve: Catenary) -> Float[np.ndarray, "v 3"]:
    """Points of a wire from A to B, `SAMPLE_M` apart horizontally or closer."""
    count = max(1, math.ceil(curve.span_m / SAMPLE_M))
    return curve.points(np.linspace(0.0, curve.span_m, count + 1))


def stations(curve: Catenary, step_m: float) -> Float[np.ndarray, " k"]:
    """s of places along the wire, evenly spaced from A to B and at most `step_m` apart."""
    return np.linspace(0.0, curve.span_m, max(1, math.ceil(curve.span_m / step_m - 1e-9)) + 1)


def beside(
    curve: Catenary,
    xyz: Float[np.ndarray, "n 3"],
    index: Int[np.ndarray, " m"],
    reach_m: float,
    beyond_m: float,
) -> Iterator[tuple[Int[np.ndarray, " c"], Float[np.ndarray, "c 3"]]]:
    """By chunks, indices and s, y, z of the points within `reach_m` across the wire and `beyond_m` beyond its
    ends, horizontally."""
    ux, uy = curve.direction
    ends = np.array([curve.a[:2], curve.b[:2]])
    low, high = ends.min(0) - math.sqrt(2) * reach_m, ends.max(0) + math.sqrt(2) * reach_m
    for first in range(0, len(index), CHUNK):
        some = index[first : first + CHUNK]
        x, y, z = xyz[some].T
        near = (x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1])  # of a long line, few are
        some, x, y = some[near], x[near] - ends[0, 0], y[near] - ends[0, 1]
        local = np.stack([ux * x + uy * y, ux * y - uy * x, z[near]], 1)
        near = (local[:, 0] >= -beyond_m) & (local[:, 0] <= curve.span_m + beyond_m)
        near &= np.abs(local[:, 1]) <= reach_m
        yield some[near], local[near]


def nearest_along(
    curve: Catenary,
    at: Float[np.ndarray, " k"],
    xyz: Float[np.ndarray, "n 3"],
    index: Int[np.ndarray, " m"],
    beyond_m: float = REACH_M,
) -> Nearest:
    """Of the points beside each station, the nearest to the wire; those beyond an end, up to `beyond_m`, are
    at its station.

    A wire whose slope is nowhere greater than g is no nearer to a point that is dz above or below it than
    dz / sqrt(1 + g^2), so that only points are compared exactly which could be the nearest of their station.
    """
    length = curve.span_m
    steep = math.hypot(1.0, math.sinh(max(abs(curve.s0_m), abs(length - curve.s0_m)) / curve.p_m))
    least = np.full(len(at), np.inf)
    kept: list[tuple[Int[np.ndarray, " c"], Int[np.ndarray, " c"], Float[np.ndarray, " c"]]] = []
    for some, local in beside(curve, xyz, index, REACH_M, beyond_m):
        s = np.clip(local[:, 0], 0.0, length)
        along, up = np.abs(local[:, 0] - s), np.abs(local[:, 2] - curve.heights(s))
        station = np.rint(s / length * (len(at) - 1)).astype(np.int64)
        np.minimum.at(least, station, np.sqrt(along**2 + local[:, 1] ** 2 + up**2))
        bound = np.hypot(local[:, 1], np.maximum(along, up / steep))
        may = bound <= least[station]
        kept.append((some[may], station[may], bound[may]))
    found = Nearest(np.full(len(at), np.inf), np.full(len(at), -1), np.full(len(at), np.nan))
    if not kept:
        return found
    some, station, bound = (np.concatenate(column) for column in zip(*kept, strict=True))
    may = bound <= least[station]
    some, station = some[may], station[may]
    distance, s = onto_wire(curve, xyz[some])
    order = np.lexsort((some, distance, station))
    reached, first = np.unique(station[order], return_index=True)
    best = order[first]
    found.distance_m[reached], found.index[reached], found.s_m[reached] = distance[best], some[best], s[best]
    return found


def onto_wire(
    curve: Catenary, points: Float[np.ndarray, "c 3"]
) -> tuple[Float[np.ndarray, " c"], Float[np.ndarray, " c"]]:
    """Distance of each point from the wire, and the s where the wire is nearest to it."""
    line = sampled(curve)
    _, nearest = cKDTree(line).query(points, workers=-1)
    best = np.full(len(points), np.inf)
    s = np.zeros(len(points))
    for first in (np.maximum(nearest - 1, 0), np.minimum(nearest, len(line) - 2)):
        start, end = line[first], line[first + 1]
        share = onto_segments(points, start, end)
        distance = np.linalg.norm(points - start - share[:, None] * (end - start), axis=1)
        closer = distance < best
        best[closer] = distance[closer]
        s[closer] = ((first + share) * curve.span_m / (len(line) - 1))[closer]
    return best, s


def _within(
    tree: cKDTree | None, points: Float[np.ndarray, "n d"], index: Int[np.ndarray, " m"], radius_m: float
) -> Bool[np.ndarray, " m"]:
    """Which of some points are so near to one of the tree's."""
    near = np.zeros(len(index), np.bool_)
    if tree is not None:
        for first in range(0, len(index), CHUNK):
            part = slice(first, first + CHUNK)
            distance, _ = tree.query(points[index[part]], distance_upper_bound=radius_m, workers=-1)
            near[part] = np.isfinite(distance)
    return near
