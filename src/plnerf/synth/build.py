"""From a configuration to a span that can stand there, and to a flight that can be flown around it.

Order: ground, supports, wires, houses, plants; then what the numbers cannot promise by themselves is checked.
"""

import math
from dataclasses import replace

import numpy as np

from plnerf.line.hang import Point, hang
from plnerf.line.wire import Wire
from plnerf.synth.check import check_wires
from plnerf.synth.config import SpanConfig, WireConfig
from plnerf.synth.houses import place_houses
from plnerf.synth.planting import plant
from plnerf.synth.pole import arm_ahead_m
from plnerf.synth.span import Span, Tower
from plnerf.synth.terrain import Ground


def build_span(config: SpanConfig) -> Span:
    """All geometry of a configuration; the same seed gives the same span.

    Raises ConfigError when a wire hangs into the ground.
    """
    azimuth = math.radians(config.line_azimuth_deg)
    along = (math.cos(azimuth), math.sin(azimuth))
    ground = Ground(config.terrain, along, config.span_length_m)
    half = config.span_length_m / 2
    west, east = _tower("west", config, ground, -half), _tower("east", config, ground, half)
    span = Span(config, ground, (west, east), _hung(config, west, east), along=along)
    check_wires(span)
    span = replace(span, houses=place_houses(span, np.random.default_rng([config.seed, 5])))
    return replace(span, plants=plant(span, np.random.default_rng([config.seed, 1])))


def _hung(config: SpanConfig, west: Tower, east: Tower) -> tuple[Wire, ...]:
    """The wires between the clamps of both towers; bundles are numbered from 1."""
    bundled = [wire.name for wire in config.wires if wire.bundle > 1]
    names = [(wire, name) for wire in config.wires for name, _ in sub_conductors(wire)]
    clamps = zip(names, west.attachments, east.attachments, strict=True)
    return tuple(
        hang(
            a,
            b,
            wire.sag_m,
            id=i,
            kind=wire.kind,
            bundle=bundled.index(wire.name) + 1 if wire.bundle > 1 else None,
            diameter_m=wire.diameter_m,
            name=name,
        )
        for i, ((wire, name), a, b) in enumerate(clamps, 1)
    )


def sub_conductors(wire: WireConfig) -> list[tuple[str, float]]:
    """Name and offset across the line of every conductor of a wire: itself, or its bundle side by side."""
    if wire.bundle == 1:
        return [(wire.name, wire.across_m)]
    first = wire.across_m - wire.bundle_gap_m * (wire.bundle - 1) / 2
    return [(f"{wire.name} {i + 1}", first + i * wire.bundle_gap_m) for i in range(wire.bundle)]


def _tower(name: str, config: SpanConfig, ground: Ground, along_m: float) -> Tower:
    ux, uy = ground.along
    foot = ground.point(ux * along_m, uy * along_m)

    def clamp(wire: WireConfig, across_m: float) -> Point:
        ahead = arm_ahead_m(config) if wire.insulator == "pin" else 0.0
        x, y = foot[0] - uy * across_m + ux * ahead, foot[1] + ux * across_m + uy * ahead
        return x, y, foot[2] + wire.height_m

    clamps = tuple(clamp(wire, y) for wire in config.wires for _, y in sub_conductors(wire))
    return Tower(name, foot, config.support.height_m, clamps)
