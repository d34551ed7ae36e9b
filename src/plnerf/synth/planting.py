"""Where plants stand: off the track, off the supports, off the houses, and clear of every conductor.

Lengths in metres; `along` and `across` the line as everywhere in synth.  A plant is an upright cylinder here;
its leaves stay inside of it, so a clearance of the cylinder is one of the leaves.
"""

import math
from collections.abc import Iterator
from typing import Literal

import numpy as np
from jaxtyping import Float

from plnerf.synth.site import Plant, Site, radius_m
from plnerf.synth.terrain import ROAD_HALF_M

Range = tuple[float, float]
Kind = Literal["tree", "conifer", "bush", "background tree"]
TRIES = 200


def plant(site: Site, rng: np.random.Generator) -> tuple[Plant, ...]:
    """Trees beside the line, one under it, others up to a set clearance, bushes, and a wood further off.

    Where the ground is full there are fewer plants than asked, as the truth file will say.
    """
    return tuple(_Planting(site, rng).everything())


def clearance_m(
    wires: Float[np.ndarray, "n 3"], foot: tuple[float, float, float], radius_m: float, height_m: float
) -> float:
    """Least distance from points on the wires to the cylinder."""
    beside = np.maximum(np.hypot(wires[:, 0] - foot[0], wires[:, 1] - foot[1]) - radius_m, 0.0)
    above = np.maximum(wires[:, 2] - foot[2] - height_m, 0.0)
    return float(np.hypot(beside, above).min())


class _Planting:
    def __init__(self, site: Site, rng: np.random.Generator) -> None:
        self.site, self.rng = site, rng
        self.config = site.config.plants
        thickest = max(radius_m(wire) for wire in site.wires)
        self.slack = thickest + 0.06  # the points are 25 cm apart: at 1.5 m they miss 5 mm of closeness
        self.wires = np.concatenate([wire.polyline(0.25) for wire in site.wires])
        self.taken = [  # x, y, radius
            (tower.foot[0], tower.foot[1], max(2.5, 0.75 * tower.design.support.foot_m))
            for tower in site.towers
        ]
        for house in site.houses:
            self.taken.append((
                house.foot[0],
                house.foot[1],
                0.75 * math.hypot(house.length_m, house.width_m),
            ))

    def everything(self) -> Iterator[Plant]:
        config, half, middle = (
            self.config,
            self.site.config.span_length_m / 2,
            self.site.config.terrain.centre_m,
        )
        half = min(half, 60.0) if config.reach_m is None else config.reach_m  # only a stretch is filmed
        wanted: list[Plant | None] = []
        if config.trees:
            under = (middle + 0.15 * half, middle + 0.3 * half)
            wanted.append(self.place("tree", under, (0.4, 1.2), (1.5, 1.6), (4.9, 5.1)))
        wanted += [self.near(middle, half) for _ in range(config.near)]
        beside = (middle - 1.4 * half, middle + 1.4 * half)
        for _ in range(max(0, config.trees - 1)):
            wanted.append(self.place("tree", beside, config.trees_across_m, (1.7, 2.8), config.tree_height_m))
        around = (middle - 1.2 * half, middle + 1.2 * half)
        wanted += [
            self.place("bush", around, (0.5, 13.0), (0.5, 1.1), (0.7, 1.7)) for _ in range(config.bushes)
        ]
        wide = (middle - 150.0, middle + 150.0)
        wanted += [
            self.place("background tree", wide, (22.0, 150.0), (2.4, 4.2), (6.0, 11.0))
            for _ in range(config.background)
        ]
        yield from (plant for plant in wanted if plant is not None)

    def place(self, kind: Kind, along: Range, across: Range, radius: Range, height: Range) -> Plant | None:
        """A plant drawn from these ranges, to either side of the line; None when no free place is found."""
        rng, centre = self.rng, self.site.at(self.site.config.terrain.centre_m, 0.0)
        if kind == "tree" and self.config.conifers > 0 and rng.random() < self.config.conifers:
            kind = "conifer"
        for _ in range(TRIES):
            x, y = self.site.at(rng.uniform(*along), rng.uniform(*across) * rng.choice([-1.0, 1.0]))
            r, h = rng.uniform(*radius), rng.uniform(*height)
            if kind == "background tree" and math.hypot(x - centre[0], y - centre[1]) > 170:
                continue
            if self.free(x, y, r):
                foot = self.site.ground.point(x, y)
                if self.clearance(foot, r, h) < self.config.clearance_m:
                    continue
                self.taken.append((x, y, r))
                return Plant(kind, foot, r, h, int(rng.integers(2**31)))
        return None

    def near(self, middle: float, half: float) -> Plant | None:
        """A tree whose crown comes as close to the wires as a drawn clearance."""
        rng = self.rng
        for _ in range(TRIES):
            along = middle + rng.uniform(-0.9, 0.9) * half
            x, y = self.site.at(along, rng.uniform(*self.config.near_across_m) * rng.choice([-1.0, 1.0]))
            r, wanted = rng.uniform(1.3, 2.2), rng.uniform(*self.config.near_clearance_m)
            foot = self.site.ground.point(x, y)
            if not self.free(x, y, r):
                continue
            low, high = 1.0, 25.0
            if self.clearance(foot, r, low) < wanted or self.clearance(foot, r, high) > wanted:
                continue
            while high - low > 1e-4:  # the clearance falls as the tree grows
                h = (low + high) / 2
                low, high = (h, high) if self.clearance(foot, r, h) > wanted else (low, h)
            if low < 2.5:
                continue
            self.taken.append((x, y, r))
            kind: Kind = "conifer" if rng.random() < self.config.conifers else "tree"
            return Plant(kind, foot, r, low, int(rng.integers(2**31)))
        return None

    def clearance(self, foot: tuple[float, float, float], radius_m: float, height_m: float) -> float:
        return clearance_m(self.wires, foot, radius_m, height_m) - self.slack

    def free(self, x: float, y: float, radius: float) -> bool:
        """Off the track, and no more than brushing what stands there."""
        offset = float(self.site.ground.track_offset(np.array([x]), np.array([y]))[0])
        margin = 1.6 if self.site.config.terrain.track == "dirt" else ROAD_HALF_M + 0.6
        return abs(offset) > radius + margin and all(
            math.hypot(x - a, y - b) > 0.85 * (radius + r) for a, b, r in self.taken
        )
