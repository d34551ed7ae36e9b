"""One power-line span as numbers: towers, conductors, ground and plants, from a configuration and its seed.

World frame: metres, x east and roughly along the line, y north, z up; the origin is on the ground, mid-span.
Every length carries _m, every angle _deg.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float

from plnerf.synth.catenary import Catenary, Point, hang
from plnerf.synth.config import SpanConfig


@dataclass(frozen=True)
class Conductor:
    """One wire and the curve of its axis."""

    name: str
    wire: str  # name of its WireConfig; the sub-conductors of a bundle share it
    kind: Literal["phase", "shield", "neutral"]
    diameter_m: float
    curve: Catenary


@dataclass(frozen=True)
class Tower:
    """A lattice tower standing on its foot's centre."""

    name: str
    foot: Point
    height_m: float
    attachments: tuple[Point, ...]  # in the order of the conductors


@dataclass(frozen=True)
class Plant:
    """A tree or a bush inside an upright cylinder of `radius_m` and `height_m` on `foot`."""

    kind: Literal["tree", "bush", "background tree"]
    foot: Point
    radius_m: float
    height_m: float
    seed: int


@dataclass(frozen=True)
class Span:
    """Everything that is there, without a single triangle."""

    config: SpanConfig
    towers: tuple[Tower, Tower]
    conductors: tuple[Conductor, ...]
    plants: tuple[Plant, ...]
    along: tuple[float, float] = field(default=(1.0, 0.0))  # unit vector of the line, horizontal

    def at(self, along_m: float, across_m: float) -> tuple[float, float]:
        """World x, y of a point given along the line (0 at mid-span) and across it (left positive)."""
        ux, uy = self.along
        return ux * along_m - uy * across_m, uy * along_m + ux * across_m


def ground_height(x_m: Float[np.ndarray, "*n"], y_m: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Height of the ground: gentle waves near the line, hills from 150 m on; 0 at the origin."""

    def waves(x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        return (
            0.45 * np.sin(x / 17.0 + y / 31.0 + 0.4)
            + 0.55 * np.sin(y / 14.0 - x / 40.0 + 1.1)
            + 0.10 * np.sin(x / 4.3 - y / 5.1)
        )

    far = np.clip((np.hypot(x_m, y_m) - 120.0) / 450.0, 0.0, 1.0)
    hills = 34.0 + 22.0 * np.sin(x_m / 97.0 + 0.8) * np.cos(y_m / 121.0) + 9.0 * np.sin((x_m - y_m) / 41.0)
    zero = np.zeros(1)
    return waves(x_m, y_m) - waves(zero, zero)[0] + far * far * (3 - 2 * far) * hills


def track_offset(x_m: Float[np.ndarray, "*n"], y_m: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Signed distance (roughly, in metres) from the centre of the dirt track that runs beside the line."""
    return y_m - (-8.5 + 2.2 * np.sin(x_m / 15.0) + 0.03 * x_m)


def ground_point(x_m: float, y_m: float) -> Point:
    """The ground's point above x, y."""
    return x_m, y_m, float(ground_height(np.array([x_m]), np.array([y_m]))[0])


def build_span(config: SpanConfig) -> Span:
    """All geometry of a configuration; the same seed gives the same span."""
    azimuth = math.radians(config.line_azimuth_deg)
    empty = Span(config, _towers(config, azimuth), (), (), (math.cos(azimuth), math.sin(azimuth)))
    west, east = empty.towers
    conductors = [
        Conductor(wire.name, wire.name, wire.kind, wire.diameter_m, hang(a, b, wire.sag_m))
        for wire, a, b in zip(config.wires, west.attachments, east.attachments, strict=True)
    ]
    wired = Span(config, empty.towers, tuple(conductors), (), empty.along)
    rng = np.random.default_rng([config.seed, 1])
    return Span(config, wired.towers, wired.conductors, tuple(_plants(wired, rng)), wired.along)


def _towers(config: SpanConfig, azimuth_rad: float) -> tuple[Tower, Tower]:
    ux, uy = math.cos(azimuth_rad), math.sin(azimuth_rad)
    offsets = [(wire.across_m, wire.height_m) for wire in config.wires]

    def tower(name: str, along_m: float) -> Tower:
        foot = ground_point(ux * along_m, uy * along_m)
        clamps = tuple((foot[0] - uy * y, foot[1] + ux * y, foot[2] + z) for y, z in offsets)
        return Tower(name, foot, config.support.height_m, clamps)

    return tower("west", -config.span_length_m / 2), tower("east", config.span_length_m / 2)


def _plants(span: Span, rng: np.random.Generator) -> Iterator[Plant]:
    """Trees beside the line, one under it, bushes around, a wood further off; none touches another."""
    config = span.config
    taken: list[tuple[float, float, float]] = []  # x, y, radius
    half = config.span_length_m / 2

    def free(x: float, y: float, radius: float) -> bool:
        clear_of_track = abs(float(track_offset(np.array([x]), np.array([y]))[0])) > radius + 1.6
        return clear_of_track and all(math.hypot(x - a, y - b) > 0.85 * (radius + r) for a, b, r in taken)

    def place(
        kind: Literal["tree", "bush", "background tree"],
        along: tuple[float, float],
        across: tuple[float, float],
        radius: tuple[float, float],
        height: tuple[float, float],
    ) -> Plant | None:
        for _ in range(200):
            x, y = span.at(rng.uniform(*along), rng.uniform(*across) * rng.choice([-1.0, 1.0]))
            r, h = rng.uniform(*radius), rng.uniform(*height)
            if kind == "background tree" and math.hypot(x, y) > 170:
                continue
            if free(x, y, r):
                taken.append((x, y, r))
                return Plant(kind, ground_point(x, y), r, h, int(rng.integers(2**31)))
        return None  # the ground is full: fewer plants than asked, as the truth file will say

    taken += [(tower.foot[0], tower.foot[1], 2.5) for tower in span.towers]
    wanted = [place("tree", (0.15 * half, 0.3 * half), (0.4, 1.2), (1.5, 1.6), (4.9, 5.1))]
    wanted += [
        place("tree", (-1.4 * half, 1.4 * half), (10.0, 17.0), (1.7, 2.8), (5.5, 8.8))
        for _ in range(max(0, config.plants.trees - 1))
    ]
    wanted += [
        place("bush", (-1.2 * half, 1.2 * half), (0.5, 13.0), (0.5, 1.1), (0.7, 1.7))
        for _ in range(config.plants.bushes)
    ]
    wanted += [
        place("background tree", (-150.0, 150.0), (22.0, 150.0), (2.4, 4.2), (6.0, 11.0))
        for _ in range(config.plants.background)
    ]
    yield from (plant for plant in wanted if plant is not None)
