"""The objects that a wire may come near to, one by one, and how near it comes to each.

Letters: m points, o objects; s along a wire's base; LineFrame, metres, z up.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from plnerf.line.cloud import Cloud
from plnerf.line.ends import Quantity
from plnerf.line.rules import Direction, RuleObject
from plnerf.line.wire import Wire
from plnerf.survey.config_encroachments import EncroachmentConfig
from plnerf.survey.config_ground import SamplingConfig
from plnerf.survey.crossings import variance_towards
from plnerf.survey.obstacles import beside, onto_wire
from plnerf.survey.sampling import end_sigma_m
from plnerf.survey.single_objects import (
    GroundHeights,
    dense_groups,
    members,
    outline_of,
    separated,
    wire_like,
)

TIP_POINTS, TIP_SHARE, TIP_SIGMA = 5, 0.7, 0.6
"""No beam meets the very tip of a tree.  Of a cone, in which the number of points grows with the square of
the depth below the tip, the tip lies beyond the farthest point by 0.7 of the depth between that and the
fifth, with a deviation of 0.6 of it; of a round crown by less."""


@dataclass(frozen=True, eq=False)
class Tree:
    """How a tree stands, for its fall about its foot."""

    foot: Float[np.ndarray, "3"]
    foot_sigma_m: float
    """Of the foot's height."""
    farthest: int
    """Index of the crown's point that is farthest from the foot."""
    reach_m: float
    """From the foot to the tip, which lies beyond that point."""
    tip_sigma_m: float


@dataclass(frozen=True, eq=False)
class Thing:
    """One object."""

    kind: RuleObject
    points: Int[np.ndarray, " _"]
    """Indices of the cloud's points."""
    outline: Float[np.ndarray, "n 2"]
    highest: int
    """Index of its highest point."""
    height_m: float | None
    """Above the ground at its foot; None: none is known there."""
    tree: Tree | None
    """Of plants above known ground."""


@dataclass(frozen=True, eq=False)
class Near:
    """The point of every object that is nearest to a wire, in one direction; infinite where none is near."""

    distance_m: Float[np.ndarray, " o"]
    s_m: Float[np.ndarray, " o"]
    point: Int[np.ndarray, " o"]
    """Index of the cloud's point."""


class ThingsNear:
    """All objects, and their points in one array."""

    def __init__(
        self, cloud: Cloud, classes: Mapping[RuleObject, Int[np.ndarray, " _"]],
        ground: Int[np.ndarray, " _"], config: EncroachmentConfig,
    ) -> None:  # fmt: skip
        """classes: indices of the points of each class of objects; ground: those of the ground."""
        self.cloud, heights = cloud, GroundHeights.of(cloud.xyz[ground])
        self.things: list[Thing] = []
        self.scattered = self.wires = 0
        """Groups of points that are left out, since wrong matches are as sparse, and since they are wires."""
        some: list[np.ndarray] = [np.zeros(0, np.int64)]
        owner: list[np.ndarray] = [np.zeros(0, np.int64)]
        for kind, index in classes.items():
            xyz, above = cloud.xyz[index], None
            if kind == "vegetation":
                z = heights.at(xyz[:, :2])
                above = np.where(np.isfinite(z), xyz[:, 2] - z, 0.0)
            number = separated(xyz, above, config)
            parts = [index[some] for some in members(number)]
            if above is not None and cloud.seen is not None:
                dense = dense_groups(xyz, number, heights.spacing_m, config)
                wires = dense & wire_like(xyz, above, number)
                parts = [part for part, one in zip(parts, dense & ~wires, strict=True) if one]
                self.scattered += int((~dense).sum())
                self.wires += int(wires.sum())
            for part in parts:
                some.append(part)
                owner.append(np.full(len(part), len(self.things)))
                self.things.append(_thing(kind, part, cloud, heights))
        self.index, self.owner = np.concatenate(some), np.concatenate(owner)

    def radial(self, wire: Wire, reach_m: float, beyond_m: tuple[float, float]) -> Near:
        """In space, up to `beyond_m` beyond the wire's ends too, within `reach_m` in plan.

        As in `obstacles.nearest_along`, only points that could be the nearest are compared exactly.
        """
        length, g = wire.base.length_m, wire.stretch
        least, kept = np.full(len(self.things), np.inf), []
        for some, local in beside(wire, self.cloud.xyz[self.index], self._all, reach_m, beyond_m):
            s = np.clip(local[:, 0], 0.0, length)
            e, d = local[:, 0] - s, np.linalg.norm(local[:, 1:] - wire.at(s), axis=1)
            np.minimum.at(least, self.owner[some], np.hypot(e, d))
            bound = np.hypot(e, d / g)
            may = bound <= least[self.owner[some]]
            kept.append((some[may], bound[may]))
        some, bound = (np.concatenate(column) for column in zip(*kept, strict=True)) if kept else (
            np.zeros(0, np.int64), np.zeros(0)
        )  # fmt: skip
        some = some[bound <= least[self.owner[some]]]
        if not len(some):
            return self._least(np.zeros(0), np.zeros(0), some)
        return self._least(*onto_wire(wire, self.cloud.xyz[self.index[some]]), some)

    def across(
        self, wire: Wire, direction: Direction, reach_m: float, under_m: float,
        lower_m: Float[np.ndarray, " o"],
    ) -> Near:  # fmt: skip
        """Straight down or up to what is within `under_m` of there, or in plan to what is not lower than the
        wire by `lower_m` of its object."""
        found = []
        for some, local in beside(wire, self.cloud.xyz[self.index], self._all, reach_m, (0.0, 0.0)):
            aside, above = (wire.at(local[:, 0]) - local[:, 1:]).T
            if direction == "vertical":
                value, counts = np.abs(above), np.abs(aside) <= under_m
            else:
                value, counts = np.abs(aside), above < lower_m[self.owner[some]]
            found.append((value[counts], local[counts, 0], some[counts]))
        if not found:
            return self._least(np.zeros(0), np.zeros(0), np.zeros(0, np.int64))
        value, s, some = (np.concatenate(column) for column in zip(*found, strict=True))
        return self._least(value, s, some)

    @property
    def _all(self) -> Int[np.ndarray, " m"]:
        return np.arange(len(self.index))

    def _least(
        self, value: Float[np.ndarray, " k"], s: Float[np.ndarray, " k"], some: Int[np.ndarray, " k"]
    ) -> Near:
        """The least of each object."""
        count = len(self.things)
        found = Near(np.full(count, np.inf), np.full(count, np.nan), np.full(count, -1))
        order = np.lexsort((some, value, self.owner[some]))
        reached, first = np.unique(self.owner[some][order], return_index=True)
        best = order[first]
        found.distance_m[reached], found.s_m[reached] = value[best], s[best]
        found.point[reached] = self.index[some[best]]
        return found


def _thing(kind: RuleObject, index: Int[np.ndarray, " k"], cloud: Cloud, ground: GroundHeights) -> Thing:
    xyz = cloud.xyz[index]
    highest, middle = int(index[xyz[:, 2].argmax()]), xyz[:, :2].mean(0)
    z, sigma = ground.plane(middle)
    height_m, tree = None, None
    if np.isfinite(z):
        height_m = float(cloud.xyz[highest, 2] - z)
    if np.isfinite(z) and kind == "vegetation":
        foot = np.array([*middle, z])
        away = np.linalg.norm(xyz - foot, axis=1)
        gap = float(np.sort(away)[-min(TIP_POINTS, len(away))])
        beyond = float(away.max()) - gap
        tree = Tree(
            foot, sigma, int(index[away.argmax()]), float(away.max()) + TIP_SHARE * beyond,
            TIP_SIGMA * beyond,
        )  # fmt: skip
    return Thing(kind, index, outline_of(xyz), highest, height_m, tree)


def sigma_towards(
    wire: Wire, s: float, cloud: Cloud, thing: Thing, point: int, towards: Float[np.ndarray, "3"],
    sampling: SamplingConfig,
) -> float:  # fmt: skip
    """Standard deviation of a distance between a wire and an object's point along a direction."""
    of_point = end_sigma_m(
        cloud, thing.points, point, sampling,
        group="structures" if thing.kind == "building" else thing.kind, towards=towards,
    )  # fmt: skip
    return float(np.hypot(np.sqrt(variance_towards(wire, s, towards)), of_point))


def falls(
    wire: Wire, cloud: Cloud, things: Sequence[Thing], limit_m: float, stem_sigma_m: float,
    sampling: SamplingConfig,
) -> list[tuple[int, Quantity, Float[np.ndarray, "3"]]]:  # fmt: skip
    """How near trees come to a wire where they fall straight at it, tilting about their feet: the distance of
    the wire from the foot less the tree's reach.

    Of those that come nearer than `limit_m`: the index among `things`, that distance, the place on the wire.
    """
    trees = [(k, thing, thing.tree) for k, thing in enumerate(things) if thing.tree is not None]
    if not trees:
        return []
    distance, s = onto_wire(wire, np.array([tree.foot for _, _, tree in trees]))
    on_wire, found = wire.points(s), []
    for (k, thing, one), far, at, place in zip(trees, distance, s, on_wire, strict=True):
        if far - one.reach_m > limit_m:
            continue
        towards = (place - one.foot) / max(float(far), 1e-9)
        outwards = (cloud.xyz[one.farthest] - one.foot) / max(one.reach_m, 1e-9)
        top = end_sigma_m(
            cloud, thing.points, one.farthest, sampling, group="vegetation", towards=outwards
        )  # fmt: skip
        # A foot that is higher is nearer to the wire, but the tree is shorter, too.
        by_foot = one.foot_sigma_m * float(outwards[2] - towards[2])
        by_stem = stem_sigma_m * float(np.hypot(*towards[:2]))
        variance = variance_towards(wire, float(at), towards) + max(top, one.tip_sigma_m) ** 2
        variance += by_foot**2 + by_stem**2
        found.append((k, Quantity(float(far - one.reach_m), float(np.sqrt(variance))), place))
    return found
