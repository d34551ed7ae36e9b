"""What a wire may come near to, and the nearest of it at each place along the wire.

Letters: n points, m those of one group, c of a chunk, k stations along the wire; s along the wire's base from
its first end, y to the left of the base, z up; LineFrame, metres.  Any swing of the wire is allowed.
"""

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from plnerf.line.clearances import GROUPS, Group
from plnerf.line.cloud import (
    BUILDING,
    CONDUCTOR,
    CONNECTOR,
    GROUND,
    HIGH_VEGETATION,
    LOW_VEGETATION,
    NO_WIRE,
    NOT_JUDGED,
    SHIELD,
    TOWER,
    VEGETATION,
    Cloud,
)
from plnerf.line.ends import Attached
from plnerf.line.polylines import onto_segments
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.survey.config_obstacles import ObstacleConfig
from plnerf.survey.crossarm_zone import in_crossarm_zone
from plnerf.survey.floating import floats
from plnerf.survey.green import green_plants, is_green
from plnerf.survey.open_ends import at_open_end, open_ends
from plnerf.survey.single_objects import GroundHeights

WATER, RAIL, ROAD = 9, 10, 11
OWN = (SHIELD, CONDUCTOR, TOWER, CONNECTOR)
NO_THING = (7, 18, 20, 22)
"""Classes of low and high noise, of ignored ground, and of what was there for a time only."""
_NAMED: dict[Group, tuple[int, ...]] = {
    "ground": (GROUND, WATER, RAIL, ROAD),
    "vegetation": (LOW_VEGETATION, VEGETATION, HIGH_VEGETATION),
    "structures": (BUILDING,),
}
_NOT_OTHER = {*OWN, *NO_THING}.union(*_NAMED.values())
CLASSES: dict[Group, tuple[int, ...]] = _NAMED | {
    "other": tuple(code for code in range(256) if code not in _NOT_OTHER)
}
"""The ASPRS classes of LAS 1.4 of each group.  What is unclassified or of an unknown class may be a crane."""
CHUNK = 500_000
"""Points that are in work at a time, which bounds memory."""


def rules(config: ObstacleConfig) -> dict[str, str]:
    """What is measured, what counts as an obstacle of each group, and what does not, in words."""
    at_support = f"within {config.support_m:g} m of a structure's foot or a wire's end"
    return {
        "distance": "the least distance in space from the wire between its ends, to obstacles within "
        f"{config.reach_m:g} m of it horizontally",
        "ground": "ground, water, rails and roads (classes 2, 9, 10, 11)",
        "vegetation": "low, medium and high vegetation (classes 3, 4, 5)",
        "structures": f"buildings (class 6), but not {at_support}",
        "other": f"unclassified points (class 1) and all further classes, but not {at_support}, and not "
        f"within {config.own_m:g} m of any wire",
        "left out": "wires, towers (of this line and of others), insulators, noise; in clouds that state "
        f"standard deviations also points of more than {config.max_sigma_m:g} m, low and medium vegetation "
        f"within {config.above_sigmas:g} standard deviations of the ground, vegetation within "
        f"{config.plant_support_m:g} m of a structure's foot or a wire's end on it, unless it is green "
        f"(excess of {config.green.least:g} or more) and either so many images see it as below, or "
        f"{config.green.least_below_m:g} m of it are seen further down, and what lies beyond the "
        "ends of a wire rather than beside it, which may be a structure that is not seen, but not where the "
        "line goes on in another span; in clouds from images also what fewer than "
        f"{config.min_seen} images see, or no more than see past it, vegetation within "
        f"{config.plant_support_m:g} m, unless it is green {config.support_m:g} m, of where a wire with an "
        "open end is seen last, unless half of the wires of its span are seen to go on for "
        f"{config.passes_m:g} m, or it is low or medium with nothing high within "
        f"{config.bush_m:g} m, vegetation beside a structure within {config.arm_m:g} m of a wire's end on it "
        f"and at most {config.arm_below_m:g} m below that, and vegetation in the air within "
        f"{config.floating.thin_m:g} m of a straight line that is no steeper than "
        f"{config.floating.upright_deg:g} degrees, but for bits within {config.floating.bit_m:g} m of a "
        "plant: all of it is listed as possible, unless no more images see past it than see it, it is green "
        f"(excess of {config.green.least:g} or more) and {config.green.least_below_m:g} m or more of it are "
        "seen below",
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


def is_shown(cloud: Cloud, config: ObstacleConfig) -> Bool[np.ndarray, " n"]:
    """Which points enough images see; all where a cloud does not come from images."""
    if cloud.seen is None or cloud.past is None:
        return np.ones(len(cloud.xyz), np.bool_)
    enough: Bool[np.ndarray, " n"] = (cloud.seen >= config.min_seen) & (cloud.seen > cloud.past)
    return enough | (cloud.seen == NOT_JUDGED)


def obstacles(
    survey: Survey, config: ObstacleConfig, *, possible: bool = False
) -> dict[Group, Int[np.ndarray, " _"]]:
    """Indices of the points that count, by group; `rules` describes them in words.

    possible: in their place those that only too few images see, plants at open ends of wires and where
    crossarms may be, and what is too thin to be a plant in the air.
    """
    cloud, all_wires = survey.cloud, survey.wires
    held, loose = _held_ends(survey), [one.place for one in open_ends(survey)]
    every = cKDTree(np.array(held + loose)) if held or loose else None
    wires = cKDTree(np.concatenate([wire.polyline() for wire in all_wires])) if all_wires else None
    found: dict[Group, Int[np.ndarray, " _"]] = {}
    for group in GROUPS:
        counts = np.isin(np.arange(256), CLASSES[group])
        counted = counts[cloud.label] & (cloud.wire == NO_WIRE)
        if cloud.sigma_m is not None:
            counted &= cloud.sigma_m <= config.max_sigma_m
        index = np.flatnonzero(counted)
        sure = is_shown(cloud, config)[index]
        if group == "vegetation" and cloud.sigma_m is not None:
            stands = ~_scatters(cloud, index, config)
            index, sure = index[stands], sure[stands]
            of_structure = _within(_tree(held), cloud.xyz[:, :2], index, config.plant_support_m)
            near = index[of_structure]
            plants = is_green(cloud, near, config.green) & sure[of_structure]
            of_structure[of_structure] = ~(plants | green_plants(cloud, near, config.green))
            index, sure = index[~of_structure], sure[~of_structure]
            sure &= ~at_open_end(survey, index, config) & ~in_crossarm_zone(survey, index, config)
            sure[sure] = ~floats(cloud, index[sure], config.floating)
            sure[~sure] = green_plants(cloud, index[~sure], config.green)
        if group in {"structures", "other"}:
            of_structure = _within(every, cloud.xyz[:, :2], index, config.support_m)
            index, sure = index[~of_structure], sure[~of_structure]
        if group == "other":
            of_wire = _within(wires, cloud.xyz, index, config.own_m)
            index, sure = index[~of_wire], sure[~of_wire]
        found[group] = index[sure != possible]
    return found


def doubted_plants(
    survey: Survey, possible: Int[np.ndarray, " m"], config: ObstacleConfig
) -> Int[np.ndarray, " _"]:
    """Indices of what may be plants as well as not: low ones that may be the ground's scatter, and of the
    possible ones those that are green and that more images see than see past.  None of clouds that state no
    standard deviations."""
    cloud = survey.cloud
    if cloud.sigma_m is None:
        return np.zeros(0, np.int64)
    low = np.isin(cloud.label, (LOW_VEGETATION, VEGETATION)) & (cloud.sigma_m <= config.max_sigma_m)
    index = np.flatnonzero(low & is_shown(cloud, config))
    index = index[_scatters(cloud, index, config)]
    if cloud.seen is None or cloud.past is None:
        return index
    green = possible[is_green(cloud, possible, config.green) & (cloud.seen[possible] > cloud.past[possible])]
    return np.concatenate([index, green])


def _scatters(cloud: Cloud, index: Int[np.ndarray, " m"], config: ObstacleConfig) -> Bool[np.ndarray, " m"]:
    """Which points of plants are not told from points of the ground; none where no ground is near."""
    assert cloud.sigma_m is not None
    ground = GroundHeights.of(cloud.xyz[cloud.label == GROUND])
    above = cloud.xyz[index, 2] - ground.at(cloud.xyz[index, :2])
    low: Bool[np.ndarray, " m"] = above < config.above_sigmas * cloud.sigma_m[index]
    return low & (cloud.label[index] != HIGH_VEGETATION)


def _held_ends(survey: Survey) -> list[Float[np.ndarray, "2"]]:
    """Feet of structures, and the ends of wires that they hold."""
    held = [one.foot[:2] for one in survey.structures]
    for wire in survey.wires:
        curve = wire.points(np.array([0.0, wire.base.length_m]))
        held += [at[:2] for end, at in zip(wire.ends, curve, strict=True) if isinstance(end, Attached)]
    return held


def _tree(places: list[Float[np.ndarray, "2"]]) -> cKDTree | None:
    return cKDTree(np.array(places)) if places else None


def stations(wire: Wire, step_m: float) -> Float[np.ndarray, " k"]:
    """s of places along the wire, evenly spaced from end to end and at most `step_m` apart."""
    length = wire.base.length_m
    return np.linspace(0.0, length, max(1, math.ceil(length / step_m - 1e-9)) + 1)


def shared_structures(survey: Survey) -> set[int]:
    """Ids of the structures at which a line goes on in another span."""
    ids = [id_ for line in survey.lines for span in line.spans for id_ in span.structures if id_ is not None]
    return {id_ for id_ in ids if ids.count(id_) > 1}


def beyond_ends_m(wire: Wire, cloud: Cloud, shared: Collection[int], reach_m: float) -> tuple[float, float]:
    """How far beyond its first and its last end obstacles are a wire's.

    shared: structures outside of whose bends things may be beside no wire, but beyond the ends of two.
    """
    first, last = (
        reach_m if cloud.sigma_m is None or (isinstance(end, Attached) and end.structure in shared) else 0.0
        for end in wire.ends
    )
    return first, last


def near_polyline(
    line: Float[np.ndarray, "p 3"],
    xyz: Float[np.ndarray, "n 3"],
    index: Int[np.ndarray, " m"],
    reach_m: float,
) -> Int[np.ndarray, " c"]:
    """Those of the indices whose points lie within the box about a polyline in plan, and around it: all that
    lie within `reach_m` across it and beyond its ends, whatever its direction, and more."""
    low = line[:, :2].min(0) - math.sqrt(2) * reach_m - 1.0
    high = line[:, :2].max(0) + math.sqrt(2) * reach_m + 1.0
    flat = xyz[index, :2]
    return index[((flat >= low) & (flat <= high)).all(1)]


def beside(
    wire: Wire,
    xyz: Float[np.ndarray, "n 3"],
    index: Int[np.ndarray, " m"],
    reach_m: float,
    beyond_m: tuple[float, float],
) -> Iterator[tuple[Int[np.ndarray, " c"], Float[np.ndarray, "c 3"]]]:
    """By chunks, indices and s, y, z of the points within `reach_m` across the wire and `beyond_m` beyond its
    first and its last end, horizontally."""
    length, line = wire.base.length_m, wire.polyline(1.0)
    for first in range(0, len(index), CHUNK):
        some = near_polyline(line, xyz, index[first : first + CHUNK], reach_m)  # of a long line's, few are
        local = wire.base.local(xyz[some])
        near = (local[:, 0] >= -beyond_m[0]) & (local[:, 0] <= length + beyond_m[1])
        some, local = some[near], local[near]
        across = local[:, 1] - wire.at(np.clip(local[:, 0], 0.0, length))[:, 0]
        near = np.abs(across) <= reach_m
        yield some[near], local[near]


def nearest_along(
    wire: Wire,
    at: Float[np.ndarray, " k"],
    xyz: Float[np.ndarray, "n 3"],
    index: Int[np.ndarray, " m"],
    reach_m: float,
    beyond_m: tuple[float, float],
) -> Nearest:
    """The obstacle nearest to the wire among the points beside each station, within `reach_m` horizontally;
    points beyond an end, up to its `beyond_m`, are beside the end's station.

    Let d be a point's distance from the wire's point at the same s, e how far it is beyond an end, and g the
    greatest length of wire per length of base.  Since the wire moves across the base by sqrt(g^2 - 1) per
    length of base at most, it is nowhere nearer to the point than sqrt(e^2 + (d / g)^2).  So only points that
    could be the nearest of their station are compared exactly.
    """
    length, g = wire.base.length_m, wire.stretch
    least = np.full(len(at), np.inf)
    kept: list[tuple[Int[np.ndarray, " c"], Int[np.ndarray, " c"], Float[np.ndarray, " c"]]] = []
    for some, local in beside(wire, xyz, index, reach_m, beyond_m):
        s = np.clip(local[:, 0], 0.0, length)
        e, d = local[:, 0] - s, np.linalg.norm(local[:, 1:] - wire.at(s), axis=1)
        station = np.rint(s / length * (len(at) - 1)).astype(np.int64)
        np.minimum.at(least, station, np.hypot(e, d))
        bound = np.hypot(e, d / g)
        may = bound <= least[station]
        kept.append((some[may], station[may], bound[may]))
    found = Nearest(np.full(len(at), np.inf), np.full(len(at), -1), np.full(len(at), np.nan))
    if not kept:
        return found
    some, station, bound = (np.concatenate(column) for column in zip(*kept, strict=True))
    may = bound <= least[station]
    some, station = some[may], station[may]
    distance, s = onto_wire(wire, xyz[some])
    order = np.lexsort((some, distance, station))
    reached, first = np.unique(station[order], return_index=True)
    best = order[first]
    found.distance_m[reached], found.index[reached], found.s_m[reached] = distance[best], some[best], s[best]
    return found


def onto_wire(
    wire: Wire, points: Float[np.ndarray, "c 3"]
) -> tuple[Float[np.ndarray, " c"], Float[np.ndarray, " c"]]:
    """Distance of each point from the wire, and the s where the wire is nearest to it."""
    line = wire.polyline()
    _, nearest = cKDTree(line).query(points, workers=-1)
    best = np.full(len(points), np.inf)
    s = np.zeros(len(points))
    for first in (np.maximum(nearest - 1, 0), np.minimum(nearest, len(line) - 2)):
        start, end = line[first], line[first + 1]
        share = onto_segments(points, start, end)
        distance = np.linalg.norm(points - start - share[:, None] * (end - start), axis=1)
        closer = distance < best
        best[closer] = distance[closer]
        s[closer] = ((first + share) * wire.base.length_m / (len(line) - 1))[closer]
    return best, s


def _within(
    tree: cKDTree | None, points: Float[np.ndarray, "n d"], index: Int[np.ndarray, " m"], radius_m: float
) -> Bool[np.ndarray, " m"]:
    """Which of the indexed points lie within the radius of one of the tree's."""
    near = np.zeros(len(index), np.bool_)
    if tree is not None:
        for first in range(0, len(index), CHUNK):
            part = slice(first, first + CHUNK)
            distance, _ = tree.query(points[index[part]], distance_upper_bound=radius_m, workers=-1)
            near[part] = np.isfinite(distance)
    return near
