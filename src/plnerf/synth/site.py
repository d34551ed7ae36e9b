"""What stands and hangs in a synthetic scene, as numbers: lines, ground, houses and plants.

World frame: metres, x east, y north, z up; the origin is on the ground, in the middle of the first line's
main span.  Every length carries _m, every angle _deg.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Literal

import numpy as np
from jaxtyping import Float

from plnerf.line.hang import Point
from plnerf.line.wire import Wire
from plnerf.synth.config import SpanConfig
from plnerf.synth.line_config import LineConfig, StructureConfig, WireConfig
from plnerf.synth.route import Route, unit
from plnerf.synth.terrain import Ground


@dataclass(frozen=True)
class Tower:
    """A lattice tower or a pole standing on its foot's centre."""

    id: int
    """from 1, over all lines"""
    name: str
    foot: Point
    height_m: float
    along: tuple[float, float]
    """unit vector of the line here, horizontal; where the line turns, half-way"""
    design: LineConfig
    """its own wires and support: those of its line, as high and held as they are here"""
    config: StructureConfig
    held: tuple[Point, ...]
    """where its insulators or arms hold each conductor: at a suspension structure the clamps"""
    behind: tuple[Point, ...] = ()
    """where the conductors of the span before it end; empty without one"""
    ahead: tuple[Point, ...] = ()
    """where those of the span after it begin"""

    @property
    def attachments(self) -> tuple[Point, ...]:
        """Where conductors end, in their order; of the span before it first where the places differ."""
        return tuple(dict.fromkeys((*self.behind, *self.ahead)))

    @property
    def axes(self) -> Float[np.ndarray, "3 3"]:
        """Columns: along the line, across it, up."""
        ux, uy = self.along
        return np.array([[ux, -uy, 0.0], [uy, ux, 0.0], [0.0, 0.0, 1.0]])


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
    """The wires between two neighbouring structures of a line."""

    line: LineConfig
    number: int
    """from 1, along the line"""
    towers: tuple[Tower, Tower]
    wires: tuple[Wire, ...]
    """of the line's wires in turn, bundles one by one"""

    @property
    def grouped(self) -> Iterator[tuple[WireConfig, tuple[Wire, ...]]]:
        """Every wire of the configuration with the wires that hang for it: one, or those of its bundle."""
        wires = iter(self.wires)
        return ((config, tuple(islice(wires, config.bundle))) for config in self.line.wires)


@dataclass(frozen=True)
class Line:
    """A chain of towers and spans."""

    number: int
    """from 1"""
    config: LineConfig
    route: Route
    towers: tuple[Tower, ...]
    spans: tuple[Span, ...]

    def beside(self, tower: Tower) -> tuple[tuple[float, Span], ...]:
        """The spans at a tower: -1 and the one before it, 1 and the one after it, as far as there are."""
        k = self.towers.index(tower)
        before = ((-1.0, self.spans[k - 1]),) if k > 0 else ()
        return (*before, (1.0, self.spans[k])) if k < len(self.spans) else before


@dataclass(frozen=True)
class Site:
    """Everything that is there, without a single triangle."""

    config: SpanConfig
    ground: Ground
    lines: tuple[Line, ...]
    """the first one is that which is filmed"""
    plants: tuple[Plant, ...] = ()
    houses: tuple[House, ...] = ()

    @property
    def route(self) -> Route:
        """Of the first line."""
        return self.lines[0].route

    @property
    def along(self) -> tuple[float, float]:
        """Horizontal unit vector of the first line's main span."""
        return unit(self.config.line_azimuth_deg)

    def at(self, along_m: float, across_m: float) -> tuple[float, float]:
        """World x, y of a point given along the first line (0 at mid-span) and across it (left positive)."""
        return self.route.at(along_m, across_m)

    @property
    def spans(self) -> tuple[Span, ...]:
        """Of all lines."""
        return tuple(span for line in self.lines for span in line.spans)

    @property
    def towers(self) -> tuple[Tower, ...]:
        """Of all lines."""
        return tuple(tower for line in self.lines for tower in line.towers)

    @property
    def wires(self) -> tuple[Wire, ...]:
        """Of all spans in turn."""
        return tuple(wire for span in self.spans for wire in span.wires)

    @property
    def grouped(self) -> Iterator[tuple[WireConfig, tuple[Wire, ...]]]:
        """Those of all spans in turn."""
        return (group for span in self.spans for group in span.grouped)


def radius_m(wire: Wire) -> float:
    """Half the diameter, which every wire of a synthetic scene has."""
    assert wire.diameter_m is not None
    return wire.diameter_m / 2
