"""From a configuration to a site that can stand there.

Order: ground, structures, wires, houses, plants; then what the numbers cannot promise by
themselves is checked.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count, pairwise

import numpy as np

from plnerf.line.ends import Attached
from plnerf.line.hang import Point, hang
from plnerf.line.wire import Wire
from plnerf.synth.check import check_wires
from plnerf.synth.config import SpanConfig
from plnerf.synth.houses import place_houses
from plnerf.synth.line_config import LineConfig, StructureConfig, WireConfig
from plnerf.synth.planting import plant
from plnerf.synth.pole import arm_ahead_m
from plnerf.synth.route import Route, unit
from plnerf.synth.site import Line, Site, Span, Tower
from plnerf.synth.terrain import Ground


@dataclass(frozen=True)
class _Numbers:
    """Ids that go on from line to line."""

    towers: Iterator[int]
    wires: Iterator[int]
    bundles: Iterator[int]


def build_site(config: SpanConfig) -> Site:
    """All geometry of a configuration; the same seed gives the same site.

    Raises ConfigError when a wire hangs into the ground or near a wire of another line.
    """
    return furnish(stand(config))


def stand(config: SpanConfig) -> Site:
    """The lines on the bare ground.  Raises ConfigError as `build_site` does."""
    ground = Ground(config.terrain, unit(config.line_azimuth_deg), config.span_length_m)
    numbers = _Numbers(count(1), count(1), count(1))
    lines = tuple(_line(line, i, ground, numbers) for i, line in enumerate(config.lines, 1))
    site = Site(config, ground, lines)
    check_wires(site)
    return site


def furnish(site: Site) -> Site:
    """The same lines among houses and plants."""
    seed = site.config.seed
    site = replace(site, houses=place_houses(site, np.random.default_rng([seed, 5])))
    return replace(site, plants=plant(site, np.random.default_rng([seed, 1])))


def sub_conductors(wire: WireConfig) -> list[tuple[str, float]]:
    """Name and offset across the line of every conductor of a wire: itself, or its bundle side by side."""
    if wire.bundle == 1:
        return [(wire.name, wire.across_m)]
    first = wire.across_m - wire.bundle_gap_m * (wire.bundle - 1) / 2
    return [(f"{wire.name} {i + 1}", first + i * wire.bundle_gap_m) for i in range(wire.bundle)]


def _line(config: LineConfig, number: int, ground: Ground, numbers: _Numbers) -> Line:
    route = Route.of(config)
    towers = tuple(_tower(config, k, route, ground, numbers) for k in range(len(route.feet)))
    spans = tuple(
        Span(config, k + 1, pair, _hung(config, k, pair, numbers)) for k, pair in enumerate(pairwise(towers))
    )
    return Line(number, config, route, towers, spans)


def _hung(config: LineConfig, k: int, towers: tuple[Tower, Tower], numbers: _Numbers) -> tuple[Wire, ...]:
    """The wires between two towers, swung by the wind."""
    first, last = towers
    ends = iter(zip(first.ahead, last.behind, strict=True))
    hung = []
    for i, wire in enumerate(config.wires):
        bundle = next(numbers.bundles) if wire.bundle > 1 else None
        for name, _ in sub_conductors(wire):
            a, b = next(ends)
            upright = hang(
                a,
                b,
                config.sag_m(k, i),
                id=next(numbers.wires),
                ends=(Attached(first.id, np.array(a), 0.0), Attached(last.id, np.array(b), 0.0)),
                kind=wire.kind,
                bundle=bundle,
                diameter_m=wire.diameter_m,
                name=_named(config, name, k),
            )
            hung.append(_swung(upright, wire.swing_deg) if wire.swing_deg else upright)
    return tuple(hung)


def _named(config: LineConfig, wire: str, k: int) -> str:
    """A name of its own for each conductor of the scene."""
    name = f"{config.name}: {wire}" if config.name else wire
    return name if len(config.lengths_m) == 1 else f"{name}, span {k + 1}"


def _swung(wire: Wire, swing_deg: float) -> Wire:
    """The same curve in a plane turned to the left about its chord's direction: wind on a wire, whose
    insulators stay as they are."""
    theta = wire.theta.copy()
    theta[5] = math.radians(swing_deg)
    return replace(wire, theta=theta)


def _tower(config: LineConfig, k: int, route: Route, ground: Ground, numbers: _Numbers) -> Tower:
    structure = config.structure(k)
    last = len(config.lengths_m)
    foot = ground.point(*route.feet[k])
    before = route.azimuths_deg[k - 1] if k > 0 else route.azimuths_deg[0]
    after = route.azimuths_deg[k] if k < last else before
    along = unit(before if before == after else (before + after) / 2)
    design = _design(config, structure)
    ux, uy = along

    def clamp(wire: WireConfig, across_m: float) -> Point:
        ahead = arm_ahead_m(design) if wire.insulator == "pin" else 0.0
        x, y = foot[0] - uy * across_m + ux * ahead, foot[1] + ux * across_m + uy * ahead
        return x, y, foot[2] + wire.height_m

    def rise_m(other: int) -> float:
        far = ground.point(*route.feet[other])[2] + config.structure(other).raised_m
        return far - foot[2] - structure.raised_m

    held = [(wire, clamp(wire, y)) for wire in design.wires for _, y in sub_conductors(wire)]
    return Tower(
        next(numbers.towers),
        _tower_name(config, k),
        foot,
        design.support.height_m,
        along,
        design,
        structure,
        tuple(point for _, point in held),
        _pulled(held, config, k - 1, (before + 180.0), rise_m(k - 1)) if k > 0 else (),
        _pulled(held, config, k, after, rise_m(k + 1)) if k < last else (),
    )


def _design(config: LineConfig, structure: StructureConfig) -> LineConfig:
    """The line's wires and support as they are at one structure."""
    strained = structure.kind != "suspension"
    if not strained and not structure.raised_m:
        return config
    wires = tuple(
        replace(
            wire,
            height_m=wire.height_m + structure.raised_m,
            insulator="tension" if strained and wire.insulator in ("string", "vee") else wire.insulator,
        )
        for wire in config.wires
    )
    support = replace(config.support, height_m=config.support.height_m + structure.raised_m)
    return replace(config, wires=wires, support=support)


def _pulled(
    held: Sequence[tuple[WireConfig, Point]], config: LineConfig, k: int, azimuth_deg: float, rise_m: float
) -> tuple[Point, ...]:
    """Where the conductors of span k end: at the clamps, or a tension string's length out along the span.

    Such a string points down as steeply as its wire does, which is taken as a parabola between the clamps.
    rise_m: how much higher than here the span's other structure holds its wires.
    """
    dx, dy = unit(azimuth_deg)
    index = {wire.name: i for i, wire in enumerate(config.wires)}
    ends = []
    for wire, (x, y, z) in held:
        if wire.insulator != "tension":
            ends.append((x, y, z))
            continue
        length = config.support.string_length_m
        slope = math.atan((4 * config.sag_m(k, index[wire.name]) - rise_m) / config.lengths_m[k])
        out = length * math.cos(slope)
        ends.append((x + dx * out, y + dy * out, z - length * math.sin(slope)))
    return tuple(ends)


def _tower_name(config: LineConfig, k: int) -> str:
    if not config.name and len(config.lengths_m) == 1:
        return ("west", "east")[k]
    return f"{config.name} {k + 1}" if config.name else f"tower {k + 1}"
