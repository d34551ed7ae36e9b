"""A survey: what was found of the lines in a scene or a cloud, with all that a reader needs to judge it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Int, UInt8

from plnerf.findings import Finding
from plnerf.line.clearances import Clearances
from plnerf.line.cloud import Cloud
from plnerf.line.coverage import Coverage
from plnerf.line.encroachments import Encroachments
from plnerf.line.frame import LineFrame
from plnerf.line.line import Line, Span, Structure
from plnerf.line.phases import InsulatorString
from plnerf.line.rules import RuleReport
from plnerf.line.states import States
from plnerf.line.wire import Wire


@dataclass(frozen=True, eq=False)
class Picture:
    """A photo with the wires' places in it."""

    name: str
    rgb: UInt8[np.ndarray, "h w 3"]
    wires: tuple[Float[np.ndarray, "_ 2"], ...]
    """Pixels of every wire of the survey, in its order; NaN behind the camera."""


@dataclass(frozen=True, eq=False)
class Crop:
    """The part of a photo around a possible obstacle."""

    of: int
    """Index of the obstacle in `Clearances.possible`, or in `Encroachments.records`."""
    name: str
    rgb: UInt8[np.ndarray, "h w 3"]
    at: Float[np.ndarray, "2"]
    """Pixels of the obstacle in it."""
    wire: Float[np.ndarray, "2"]
    """Pixels of the wire where the obstacle is nearest to it."""


@dataclass(frozen=True, eq=False)
class WirePoints:
    """n points on wires that a trained field shows, whatever the curves are; LineFrame."""

    xyz: Float[np.ndarray, "n 3"]
    view: Int[np.ndarray, " n"]
    """Index of the image that saw each."""
    solid: Float[np.ndarray, " n"]
    """Share of the ray's light that comes from the point."""
    tried: int
    """Wire pixels that were rendered."""


@dataclass(frozen=True, eq=False)
class Survey:
    """All of it; everything with coordinates is in `frame`."""

    frame: LineFrame
    lines: tuple[Line, ...]
    cloud: Cloud
    source: str
    """The run folder, scene folder or cloud file."""
    made: Mapping[str, str] = field(default_factory=dict)
    """What it was made from, in words: input, preset, versions."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Every setting that decided it, as plain JSON values."""
    clearances: Clearances | None = None
    """None: without scale, or without wires, there are none."""
    coverage: tuple[Coverage, ...] = ()
    """Of every span that has wires; none without scale."""
    findings: tuple[Finding, ...] = ()
    report_units: Literal["metres", "feet"] = "metres"
    """Of the lengths in a report's tables and cards."""
    temperature_c: float | None = None
    """Of the conductors when they were surveyed, if it is known."""
    states: States | None = None
    """The line at other temperatures and loads; None: none was asked for, or what is needed is missing."""
    rules: RuleReport | None = None
    """Verdicts by a matrix of rules; None: none was given."""
    strings: tuple[InsulatorString, ...] = ()
    encroachments: Encroachments | None = None
    """Every object that comes too near; None: nothing is required."""
    detected: tuple[Wire, ...] = ()
    """The wires as they were detected, before they were refitted, with the same ids; none of clouds."""
    wire_points: WirePoints | None = None
    """None: there is no field."""
    pictures: tuple[Picture, ...] = ()
    crops: tuple[Crop, ...] = ()
    """Of possible obstacles."""
    encroachment_crops: tuple[Crop, ...] = ()
    from_images: bool = False
    """Whether the cloud's points come from images rather than a laser."""

    @property
    def wires(self) -> tuple[Wire, ...]:
        """Of all lines, span by span."""
        return tuple(wire for line in self.lines for wire in line.wires)

    @property
    def structures(self) -> tuple[Structure, ...]:
        """Of all lines."""
        return tuple(structure for line in self.lines for structure in line.structures)

    @property
    def spans(self) -> tuple[Span, ...]:
        """Of all lines."""
        return tuple(span for line in self.lines for span in line.spans)

    def span_of(self, wire: int) -> Span:
        """The span of a wire, by the wire's id."""
        return next(span for span in self.spans if any(one.id == wire for one in span.wires))
