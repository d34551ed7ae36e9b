"""A span as airborne LiDAR measures it, drawn at random: what stands there, wind, flight, scanner.

Lengths in metres (_m), angles in degrees (_deg); "along" and "across" as in `config.py`.
"""

from dataclasses import dataclass

import numpy as np

from plnerf.errors import ConfigError
from plnerf.synth.build import stand
from plnerf.synth.config import PlantsConfig, SpanConfig, TerrainConfig
from plnerf.synth.line_config import SupportConfig, WireConfig, require_positive
from plnerf.synth.site import Site

TRIES = 50
"""Of draws whose wires would touch each other or the ground another one is made."""
TOWERS = 4
"""Of the main span and of those before and after it."""
LEAN_DEG = 4.0
"""Standard deviation of the lean of a suspension string along the line."""


@dataclass(frozen=True)
class ScanConfig:
    """A flight of a line scanner, whose strips all lie along the main span."""

    across_m: tuple[float, ...]
    """of each strip's track, from the line"""
    height_m: float
    """of the flight above the origin"""
    pulses_per_m2: float
    """of one strip, on the ground"""
    footprint_m: float
    """radius of the beam: what lies within it returns light, and is placed on the beam's axis"""
    range_sd_m: float
    """noise along the beam"""
    pointing_sd_m: float
    """noise across the beam, on the ground"""
    strip_sd_m: float
    """of the shift of a strip against the others along each axis: what strip adjustment leaves"""
    corridor_m: float = 40.0
    """half the width of what is scanned"""
    beyond_m: float = 18.0
    """how far beyond the main span's structures it is scanned"""

    def __post_init__(self) -> None:
        require_positive(
            scan_height_m=self.height_m, pulses_per_m2=self.pulses_per_m2, footprint_m=self.footprint_m
        )
        if not self.across_m:
            raise ConfigError("synth: a scan needs one strip or more, got none.")


@dataclass(frozen=True)
class WindConfig:
    """What wind does beyond the swing that the wires of a site have already."""

    gust_deg: tuple[float, ...]
    """change of all swings during each strip"""
    uneven: tuple[float, float]
    """wind that is not alike all along a span: amplitudes of sin(2 pi t) and sin(3 pi t), t from 0 to 1 along
    it, as shares of a wire's sideways bow; no plane curve follows them"""


@dataclass(frozen=True)
class Boom:
    """A crane's boom: a level tube.  What carries it is left out: nothing tells a mast from a stem."""

    along_m: float
    across_m: float
    azimuth_deg: float
    height_m: float
    """above the ground"""
    length_m: float = 12.0
    radius_m: float = 0.1


@dataclass(frozen=True)
class LidarScene:
    """All of it."""

    name: str
    span: SpanConfig
    boom: Boom
    wind: WindConfig
    scan: ScanConfig
    lean_deg: tuple[tuple[float, ...], ...]
    """of the strings, along the line: of every tower each wire's.  Spans of unequal length pull unequally"""


def random_lidar_scene(seed: int) -> LidarScene:
    """The first of this seed's draws that can stand: a span of 110 to 260 m on lattice towers, with the next
    spans beyond them.

    Raises ConfigError where none of `TRIES` can.
    """
    for attempt in range(TRIES):
        scene = _draw(seed, np.random.default_rng([seed, 23, attempt]))
        try:
            stand(scene.span)
        except ConfigError:
            continue
        return scene
    raise ConfigError(
        f"synth: none of {TRIES} draws of the LiDAR scene {seed} can stand. Take another seed."
    )


def _draw(seed: int, rng: np.random.Generator) -> LidarScene:
    length, swing = float(rng.uniform(110.0, 260.0)), float(rng.normal(0.0, 8.0))
    wires, support = _wires(rng, length, swing)
    span = SpanConfig(
        seed=seed,
        span_length_m=length,
        line_azimuth_deg=float(rng.uniform(-180.0, 180.0)),
        wires=wires,
        support=support,
        terrain=TerrainConfig(
            waves=float(rng.uniform(0.3, 1.5)), hills=0.0, track="none",
            rise_m=float(rng.uniform(-8.0, 8.0)),
            shift_m=(float(rng.uniform(-300, 300)), float(rng.uniform(-300, 300))),
        ),
        plants=PlantsConfig(
            trees=int(rng.integers(6, 20)), bushes=int(rng.integers(5, 30)), background=0,
            trees_across_m=(9.0, 30.0), tree_height_m=(6.0, 14.0), conifers=float(rng.uniform(0.0, 0.7)),
            near=int(rng.integers(1, 5)), near_clearance_m=(2.0, 6.0), reach_m=0.45 * length,
        ),
        houses=int(rng.integers(1, 4)),
        before_m=(0.8 * length,),
        after_m=(0.9 * length,),
    )
    boom = Boom(
        float(rng.uniform(-0.3, 0.3)) * length,
        float(rng.uniform(10.0, 14.0) * rng.choice([-1.0, 1.0])) + 8.0 * float(np.sign(rng.normal())),
        float(rng.uniform(0.0, 180.0)),
        float(rng.uniform(6.0, 11.0)),
    )
    windy = min(abs(swing) / 8.0, 1.0)
    wind = WindConfig(
        tuple(float(one) for one in rng.normal(0.0, 1.0 * windy, 2)),
        (float(rng.normal(0.0, 0.07)), float(rng.normal(0.0, 0.05))),
    )
    side = float(rng.uniform(10.0, 60.0))
    scan = ScanConfig(
        across_m=(-side, side),
        height_m=float(rng.uniform(150.0, 400.0)),
        pulses_per_m2=float(rng.uniform(5.0, 18.0)),
        footprint_m=float(rng.uniform(0.04, 0.12)),
        range_sd_m=float(rng.uniform(0.01, 0.03)),
        pointing_sd_m=float(rng.uniform(0.01, 0.04)),
        strip_sd_m=float(rng.uniform(0.0, 0.02)),
    )
    lean = rng.normal(0.0, LEAN_DEG, (TOWERS, len(wires)))
    lean_deg = tuple(tuple(float(one) for one in of_tower) for of_tower in lean)
    return LidarScene(f"lidar-{seed}", span, boom, wind, scan, lean_deg)


def _wires(
    rng: np.random.Generator, length_m: float, swing_deg: float
) -> tuple[tuple[WireConfig, ...], SupportConfig]:
    """One circuit in a triangle, or two, under one shield wire or two."""
    double, shields = bool(rng.random() < 0.5), int(rng.integers(1, 3))
    low, step, reach = (
        float(rng.uniform(*bounds)) for bounds in ((18.0, 24.0), (4.0, 5.5), (4.5, 7.0))
    )
    string, p = float(rng.uniform(1.2, 2.2)), float(rng.uniform(900.0, 1700.0))
    sag = length_m**2 / (8 * p)
    if double:
        places = [(side * reach * f, low + i * step) for i, f in enumerate((1, 1.2, 0.9)) for side in (-1, 1)]
    else:
        places = [(-reach, low), (reach, low), (0.9 * reach, low + step)]
    wires = [
        WireConfig(f"phase {'ABCDEF'[i]}", "phase", y, z, sag * float(rng.uniform(0.97, 1.03)), 0.03,
                   swing_deg=swing_deg)
        for i, (y, z) in enumerate(places)
    ]  # fmt: skip
    top = max(z for _, z in places) + string + 4.0
    sides = (0.0,) if shields == 1 else (-2.5, 2.5)
    wires += [
        WireConfig(f"shield {i + 1}", "shield", y, top - 0.5, 0.7 * sag, 0.015, insulator="none",
                   swing_deg=1.5 * swing_deg)
        for i, y in enumerate(sides)
    ]  # fmt: skip
    return tuple(wires), SupportConfig("lattice", top, 6.0, 1.8, 1.4, string)


def boom_middle(site: Site, boom: Boom) -> tuple[float, float, float]:
    """World place of the middle of the boom."""
    x, y = site.at(boom.along_m, boom.across_m)
    return x, y, site.ground.height(x, y) + boom.height_m

