"""Encroachments: every tree, building, other thing or crossing wire that comes too near to a wire.  Values.

One record is one object (of a crossing: one pair of wires), with every way in which the two come too near.
LineFrame, metres.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from plnerf.line.clearances import Verdict
from plnerf.line.ends import Quantity
from plnerf.line.rules import Direction, RuleObject

Way = Literal["as surveyed", "sag", "blow-out", "fall-in", "grow-in"]
"""How the two come too near: as they were; in a state without wind; in one with wind; where the tree falls;
where it grows."""
WAYS: tuple[Way, ...] = get_args(Way)
URGENCY: dict[Way, int] = {"as surveyed": 1, "sag": 2, "blow-out": 2, "fall-in": 3, "grow-in": 4}
POSSIBLE = 5
"""Priority of what is within its uncertainty in every way."""
IN_WORDS: dict[int, str] = {
    1: "too near as surveyed",
    2: "too near in another state",
    3: "too near when falling",
    4: "too near after growth",
    5: "within the uncertainty",
}


@dataclass(frozen=True, eq=False)
class Approach:
    """One way in which a wire and an object come too near."""

    way: Way
    state: str
    """Of the line: "as surveyed", or the name of the state."""
    wire: int
    """Id of the wire that comes nearest in it."""
    direction: Direction
    distance: Quantity
    """In that state, after that fall or growth; below 0 where a falling tree reaches beyond the wire."""
    required_m: float
    required_by: str
    """The rule or the requirement, in words."""
    verdict: Verdict
    on_wire: Float[np.ndarray, "3"]
    on_object: Float[np.ndarray, "3"]
    """Of a fall the tree's foot."""
    years: Quantity | None = None
    """Of growth: from the survey until the distance is the required one."""

    @property
    def margin_m(self) -> float:
        """Distance less what is required."""
        return self.distance.value - self.required_m


@dataclass(frozen=True, eq=False)
class Encroachment:
    """One object that comes too near."""

    id: int
    """From 1, by priority."""
    priority: int
    """Of `IN_WORDS`, 1 the most urgent."""
    object: RuleObject
    line: int
    span: int
    wire: int
    """Id of the wire that the object is nearest to as surveyed."""
    other_wire: int | None
    """Of a crossing: id of the wire of the other line."""
    station_m: float
    """Along the line, of the place on the wire."""
    outline: Float[np.ndarray, "n 2"]
    """The polygon around the object in plan, counterclockwise; of a crossing without points."""
    highest: Float[np.ndarray, "3"]
    height_m: float | None
    """Of its highest point above the ground at its foot; None: no ground is known there, or it is a wire."""
    radial: Quantity
    """Distances as surveyed, between `on_wire` and `on_object`."""
    vertical: Quantity
    """By how much the wire is higher."""
    horizontal: Quantity
    on_wire: Float[np.ndarray, "3"]
    on_object: Float[np.ndarray, "3"]
    approaches: tuple[Approach, ...]
    """The most urgent first."""

    @property
    def first(self) -> Approach:
        """The most urgent."""
        return self.approaches[0]

    @property
    def ways(self) -> tuple[Way, ...]:
        """Every way, the most urgent first."""
        return tuple(dict.fromkeys(one.way for one in self.approaches))


@dataclass(frozen=True, eq=False)
class Encroachments:
    """All of a survey, by priority, and what could not be examined."""

    records: tuple[Encroachment, ...]
    required: tuple[str, ...]
    """What was required, in words."""
    not_examined: tuple[str, ...] = ()
    """Ways that were left out, and why, in sentences."""


def priority_of(approaches: tuple[Approach, ...]) -> int:
    """The most urgent of those that are certain; `POSSIBLE` where none is."""
    certain = (URGENCY[one.way] for one in approaches if one.verdict == "closer than required")
    return min(certain, default=POSSIBLE)
