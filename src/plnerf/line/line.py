"""A line: structures, and between them spans with their wires, in the order of its stations.  LineFrame."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from plnerf.errors import SurveyError
from plnerf.line.wire import Wire

StructureKind = Literal["suspension", "strain", "terminal", "unknown"]


@dataclass(frozen=True, eq=False)
class Structure:
    """A tower or pole, where spans meet or end."""

    id: int
    """From 1, along the line."""
    foot: Float[np.ndarray, "3"]
    height_m: float
    sigma_m: float
    """Standard deviation of its place along the line."""
    evidence: str
    """What shows it, in words."""
    kind: StructureKind = "unknown"
    name: str | None = None
    line_angle_deg: float | None = None
    """By how much the line turns here; None: it is not known."""

    @property
    def top(self) -> Float[np.ndarray, "3"]:
        """Its highest point, above its foot."""
        return self.foot + np.array([0.0, 0.0, self.height_m])


@dataclass(frozen=True, eq=False)
class Span:
    """The wires between two structures, or between one and where it is no longer known."""

    id: int
    """From 1, along the line."""
    structures: tuple[int | None, int | None]
    """Ids of what holds its first and its last end; None: no structure is seen there."""
    wires: tuple[Wire, ...]

    def __post_init__(self) -> None:
        """Raises SurveyError where one structure is named as what holds both ends."""
        first, last = self.structures
        if first is not None and first == last:
            raise SurveyError(f"Span {self.id} begins and ends at structure {first}, but needs two of them.")


@dataclass(frozen=True, eq=False)
class Line:
    """Structures and spans in order of station."""

    id: int
    structures: tuple[Structure, ...]
    spans: tuple[Span, ...]
    name: str | None = None
    circuits: int | None = None
    voltage_kv: float | None = None
    """Nominal."""
    from_m: float = 0.0
    """Station of its first structure: above 0 where it is a part of a longer line."""

    @property
    def wires(self) -> Iterator[Wire]:
        """All of them, span by span."""
        return (wire for span in self.spans for wire in span.wires)
