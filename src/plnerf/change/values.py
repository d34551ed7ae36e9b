"""What differs between two surveys of a line: values.  A is the earlier survey, B the later; metres.

A difference is B less A.  Its deviation holds those of both, whose errors are independent.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

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
    to: str
    distance_a_m: Quantity
    distance_b_m: Quantity
    difference_m: Quantity
    by_wire_m: float
    """Of the difference, what the wire's own movement makes: from B's wire to A's object, less the distance
    in A."""
    by_object_m: Quantity
    """The rest: something else is nearer now, or what was nearest is gone."""
    place: Float[np.ndarray, "3"]
    """Where the object is in B, in B's LineFrame."""
    moved_m: float
    """How far apart the nearest objects of both surveys are."""
    standing: Standing


@dataclass(frozen=True)
class Change:
    """All of it."""

    structures: tuple[StructureChange, ...]
    sags: tuple[SagChange, ...]
    clearances: tuple[ClearanceChange, ...]
    only_a: tuple[int, ...]
    """Ids of wires that B does not have."""
    only_b: tuple[int, ...]
    """Ids of wires that A does not have."""
    comparisons: int
    """How many differences were tested."""
    sigmas: float
    """A difference counts beyond so many of its standard deviations: then all differences together are false
    alarms with a chance of 5 %."""
    notes: tuple[str, ...]

    @property
    def different(self) -> int:
        """How many differences neither uncertainty nor temperature explains, wires and structures that one
        survey alone has among them."""
        standings = [one.standing for one in self.structures]
        standings += [one.standing for one in self.sags]
        standings += [one.standing for one in self.clearances]
        return standings.count("different") + len(self.only_a) + len(self.only_b)
