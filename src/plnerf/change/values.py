"""What differs between two surveys of a line: values.  A is the earlier survey, B the later; metres.

A difference is B less A.  Its deviation holds those of both, whose errors are independent.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from plnerf.line.clearances import Group
from plnerf.line.ends import Quantity

Standing = Literal["within the uncertainties", "explained by temperature", "different", "not known"]


@dataclass(frozen=True, eq=False)
class StructureChange:
    """A structure in both surveys, or in one of them."""

    a: int | None
    """Its id in A; None: it is new."""
    b: int | None
    """Its id in B; None: it is gone."""
    name: str | None
    foot: Float[np.ndarray, "3"]
    """In B's LineFrame."""
    moved_m: Quantity | None
    """Horizontal distance between its feet; None where one survey alone has it."""
    standing: Standing


@dataclass(frozen=True)
class SagChange:
    """A wire in both surveys."""

    a: int
    b: int
    span: int
    """In B."""
    sag_a_m: Quantity | None
    sag_b_m: Quantity | None
    difference_m: Quantity | None
    expected_m: Quantity | None
    """Of the difference, what the temperatures of both surveys explain; None: they or the conductor are not
    known."""
    rest_m: Quantity | None
    """The difference less that."""
    standing: Standing


@dataclass(frozen=True, eq=False)
class ClearanceChange:
    """The least distance of a wire to a group of things, in both surveys."""

    a: int
    b: int
    to: Group
    distance_a_m: Quantity | None
    """None: A has nothing of the group near the wire."""
    distance_b_m: Quantity | None
    difference_m: Quantity | None
    expected_m: Quantity | None
    """Of the difference, what the temperatures of both surveys explain: from A's wire at B's temperature to
    A's obstacle; None: they or the conductor are not known."""
    rest_m: Quantity | None
    """The difference less that."""
    by_object_m: Quantity | None
    """Of the difference, what the wire does not make: from B's wire, the distance to B's obstacle less that
    to A's.  Less than 0: something is nearer (grown, new); greater: what was nearest is gone."""
    place: Float[np.ndarray, "3"]
    """Where the obstacle is in B, else in A; in B's LineFrame."""
    moved_m: float | None
    """How far apart the nearest obstacles of both surveys are."""
    standing: Standing


@dataclass(frozen=True)
class WireAlone:
    """A wire that one survey alone has."""

    a: int | None
    b: int | None
    standing: Standing = "different"


@dataclass(frozen=True)
class Change:
    """All of it."""

    structures: tuple[StructureChange, ...]
    sags: tuple[SagChange, ...]
    clearances: tuple[ClearanceChange, ...]
    wires: tuple[WireAlone, ...]
    """Of one survey alone."""
    comparisons: int
    """How many differences were tested."""
    sigmas: float
    """A difference counts beyond so many of its standard deviations: then all differences together are false
    alarms with a chance of 5 %."""
    notes: tuple[str, ...]

    @property
    def rows(self) -> tuple[StructureChange | SagChange | ClearanceChange | WireAlone, ...]:
        """All that was compared."""
        return (*self.structures, *self.sags, *self.clearances, *self.wires)

    @property
    def different(self) -> int:
        """How many rows neither uncertainty nor temperature explains."""
        return sum(one.standing == "different" for one in self.rows)
