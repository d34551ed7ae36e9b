"""One power-line span as numbers: supports, wires, ground, houses and plants.

World frame: metres, x east and roughly along the line, y north, z up; the origin is on the ground, mid-span.
Every length carries _m, every angle _deg.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from typing import Literal

from plnerf.line.hang import Point
from plnerf.line.wire import Wire
from plnerf.synth.config import SpanConfig, WireConfig
from plnerf.synth.terrain import Ground


@dataclass(frozen=True)
class Tower:
    """A lattice tower or a pole standing on its foot's centre."""

    name: str
    foot: Point
    height_m: float
    attachments: tuple[Point, ...]  # in the order of the wires


@dataclass(frozen=True)
class Plant:
    """A tree or a bush inside an upright cylinder of `radius_m` and `height_m` on `foot`."""

    kind: Literal["tree", "conifer", "bush", "background tree"]
    foot: Point
    radius_m: float
    height_m: float
    seed: int


@dataclass(frozen=True)
class House:
    """A gabled house on `foot`, the middle of its floor."""

    name: str
    foot: Point
    azimuth_deg: float  # of the ridge, from +x to +y
    length_m: float  # along the ridge
    width_m: float
    eaves_m: float  # height of the walls
    ridge_m: float
    seed: int


@dataclass(frozen=True)
class Span:
    """Everything that is there, without a single triangle."""

    config: SpanConfig
    ground: Ground
    towers: tuple[Tower, Tower]
    wires: tuple[Wire, ...]  # of the configuration's wires in turn, bundles one by one
    plants: tuple[Plant, ...] = ()
    houses: tuple[House, ...] = ()
    along: tuple[float, float] = field(default=(1.0, 0.0))  # unit vector of the line, horizontal

    def at(self, along_m: float, across_m: float) -> tuple[float, float]:
        """World x, y of a point given along the line (0 at mid-span) and across it (left positive)."""
        ux, uy = self.along
        return ux * along_m - uy * across_m, uy * along_m + ux * across_m

    @property
    def grouped(self) -> Iterator[tuple[WireConfig, tuple[Wire, ...]]]:
        """Every wire of the configuration with the wires that hang for it: one, or those of its bundle."""
        wires = iter(self.wires)
        return ((config, tuple(islice(wires, config.bundle))) for config in self.config.wires)


def radius_m(wire: Wire) -> float:
    """Half the diameter, which every wire of a synthetic span has."""
    assert wire.diameter_m is not None
    return wire.diameter_m / 2
