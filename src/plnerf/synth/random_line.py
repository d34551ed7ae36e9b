"""Lines drawn at random: towers or poles, wires, spans before and after, bends, wind, other lines.

Every draw is from a range that lines of low to high voltage have, at the scale of the named scenes.
"""

from dataclasses import dataclass, replace

import numpy as np

from plnerf.synth.line_config import LineConfig, StructureConfig, SupportConfig, WireConfig
from plnerf.synth.route import Route, unit

COLOURS = (
    (1.0, 1.0, 1.01), (1.5, 1.5, 1.52), (0.55, 0.55, 0.57), (0.32, 0.31, 0.30), (0.62, 0.85, 0.72),
)  # fmt: skip
"""Factors on weathered aluminium: as it is, new, old, insulated, copper with its patina."""


@dataclass(frozen=True)
class Drawn:
    """A drawn line's own parts, before it has a course."""

    wires: tuple[WireConfig, ...]
    support: SupportConfig
    length_m: float
    """of its main span"""


def draw_line(rng: np.random.Generator) -> Drawn:
    """Wires and supports of the first line."""
    style = rng.choice(["triangle", "double", "pole"], p=[0.5, 0.2, 0.3])
    return _pole(rng) if style == "pole" else _lattice(rng, double=style == "double")


def draw_spans(
    rng: np.random.Generator, drawn: Drawn
) -> tuple[tuple[float, ...], tuple[float, ...], tuple[StructureConfig, ...], tuple[tuple[float, ...], ...]]:
    """Lengths of the spans before and after the main one, the structures, and the slack of each span.

    A line goes on for a span or two, or is terminal at the main span's own structure.
    """
    before, after = (int(rng.choice([0, 1, 2], p=[0.15, 0.5, 0.35])) for _ in range(2))
    lengths = [drawn.length_m * rng.uniform(0.75, 1.25) for _ in range(before + after)]
    count = before + after + 1
    structures = []
    for k in range(count + 1):
        if k in (0, count):
            at_main = (k == 0 and before == 0) or (k == count and after == 0)
            structures.append(StructureConfig("terminal" if at_main or rng.random() < 0.3 else "suspension"))
        elif rng.random() < 0.35:
            bends = rng.random() < 0.7
            turn = rng.uniform(8.0, 45.0) * rng.choice([-1.0, 1.0]) if bends else rng.uniform(-3.0, 3.0)
            structures.append(StructureConfig("strain", float(turn), float(rng.uniform(0.0, 1.0))))
        else:
            structures.append(
                StructureConfig("suspension", float(rng.uniform(-2.0, 2.0)), float(rng.uniform(0.0, 1.5)))
            )
    slack = []
    for _ in range(count):
        whole = rng.uniform(0.8, 1.25)
        slack.append(tuple(float(whole * rng.uniform(0.95, 1.05)) for _ in drawn.wires))
    return (
        tuple(float(one) for one in lengths[:before]),
        tuple(float(one) for one in lengths[before:]),
        tuple(structures),
        tuple(slack),
    )


def draw_other(rng: np.random.Generator, first: LineConfig) -> LineConfig:
    """A second line: below the first one or above it, or one that ends beside one of its structures."""
    lowest = min(wire.height_m - wire.sag_m for wire in first.wires)
    highest = first.support.height_m
    azimuth = first.azimuth_deg + rng.uniform(35.0, 90.0) * rng.choice([-1.0, 1.0])
    style = str(rng.choice(["below", "above", "tee"], p=[0.45, 0.3, 0.25]))
    if style == "below":
        drawn = _pole(rng, height_m=float(np.clip(lowest - 1.6, 5.5, 9.0)))
    elif style == "above":
        drawn = _lattice(rng, double=False, lowest_m=highest + 2.5)
    else:
        drawn = _pole(rng, height_m=float(rng.uniform(6.0, 8.5)))
    lengths: tuple[float, ...]
    structures: tuple[StructureConfig, ...] = ()
    if style == "tee":
        route = Route.of(first)
        foot = np.array(route.feet[first.main + int(rng.integers(2))])
        away = np.array(unit(azimuth))
        middle = foot + away * (rng.uniform(6.0, 9.0) + drawn.length_m / 2)
        lengths, main = (drawn.length_m, drawn.length_m * 1.1), 0
        structures = (StructureConfig("terminal"), StructureConfig(), StructureConfig())
    else:
        half = first.lengths_m[first.main] / 2
        middle = np.array(unit(first.azimuth_deg)) * rng.uniform(-0.4, 0.4) * half
        middle = middle + np.array(unit(azimuth)) * rng.uniform(-4.0, 4.0)
        lengths, main = (drawn.length_m * 0.9, drawn.length_m, drawn.length_m * 1.1), 1
    return LineConfig(
        drawn.wires, drawn.support, float(azimuth), tuple(float(one) for one in lengths), style, main,
        (float(middle[0]), float(middle[1])), structures,
    )  # fmt: skip


def draw_wind(rng: np.random.Generator, wires: tuple[WireConfig, ...]) -> tuple[WireConfig, ...]:
    """In half of all scenes still air; else phases swing, and thinner wires a little more."""
    if rng.random() < 0.5:
        return wires
    swing = float(rng.uniform(-14.0, 14.0))
    thick = max(wire.diameter_m for wire in wires)
    return tuple(replace(wire, swing_deg=swing * (1 + 0.4 * (1 - wire.diameter_m / thick))) for wire in wires)


def _lattice(rng: np.random.Generator, *, double: bool, lowest_m: float | None = None) -> Drawn:
    """Three phases in a triangle, or two circuits of three above each other; often with a shield wire."""
    length, string = float(rng.uniform(34.0, 58.0)), float(rng.uniform(0.7, 1.2))
    low = float(rng.uniform(8.5, 12.5)) if lowest_m is None else lowest_m + 0.04 * length
    step, reach = float(rng.uniform(1.5, 2.6)), float(rng.uniform(1.8, 3.0))
    sag, thick = length * float(rng.uniform(0.018, 0.038)), float(rng.uniform(0.018, 0.038))
    bundle = 2 if rng.random() < 0.2 else 1
    gap, colour = float(rng.uniform(0.3, 0.45)), _colour(rng)
    if double:
        places = [
            (side * reach * f, low + i * step) for i, f in enumerate((1.0, 0.95, 0.85)) for side in (-1, 1)
        ]
    else:
        side = float(rng.choice([-1.0, 1.0]))
        places = [(-reach, low), (reach, low), (0.85 * side * reach, low + step)]
    wires = [
        WireConfig(f"phase {'ABCDEF'[i]}", "phase", y, z, sag, thick, bundle, gap, "string", 0.0, colour)
        for i, (y, z) in enumerate(places)
    ]
    top = max(z for _, z in places) + string + 0.9
    if double or rng.random() < 0.75:
        wires.append(_shield(rng, top - 0.12, sag, length))
    wide = float(rng.uniform(0.6, 0.9))
    support = SupportConfig("lattice", top, float(rng.uniform(1.9, 2.9)), wide, 0.83 * wide, string)
    return Drawn(tuple(wires), support, length)


def _shield(rng: np.random.Generator, height_m: float, sag_m: float, length_m: float) -> WireConfig:
    sag = min(sag_m * float(rng.uniform(0.6, 0.85)), 0.03 * length_m)
    thick, colour = float(rng.uniform(0.009, 0.02)), _colour(rng)
    return WireConfig("shield", "shield", 0.0, height_m, sag, thick, insulator="none", colour=colour)


def _pole(rng: np.random.Generator, height_m: float | None = None) -> Drawn:
    """Two to four wires on pins of one crossarm, and often a neutral below."""
    length = float(rng.uniform(30.0, 50.0))
    top = float(rng.uniform(8.5, 11.0)) if height_m is None else height_m
    sag, thick = length * float(rng.uniform(0.012, 0.022)), float(rng.uniform(0.012, 0.022))
    sag = min(sag, 0.12 * top)
    count, colour = int(rng.integers(2, 5)), _colour(rng)
    reach = float(rng.uniform(0.9, 1.4))
    places = np.linspace(-reach, reach, count)
    places[1:-1] += 0.3 * float(rng.choice([-1.0, 1.0]))  # none in line with the pole
    wires = [
        WireConfig(
            f"phase {'ABCD'[i]}", "phase", float(y), top - 0.2, sag, thick, insulator="pin", colour=colour
        )
        for i, y in enumerate(places)
    ]
    if rng.random() < 0.6:
        wires.append(
            WireConfig(
                "neutral", "neutral", float(rng.choice([-0.24, 0.24])), top - float(rng.uniform(1.6, 2.2)),
                1.1 * sag, 0.9 * thick, insulator="spool", colour=_colour(rng),
            )
        )  # fmt: skip
    return Drawn(tuple(wires), SupportConfig("pole", top, 0.32, 0.21), length)


def _colour(rng: np.random.Generator) -> tuple[float, float, float]:
    return COLOURS[int(rng.choice(len(COLOURS), p=[0.4, 0.2, 0.2, 0.1, 0.1]))]
