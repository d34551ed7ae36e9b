"""Clearances by rule: which distance a row of a standard's matrix requires, and whether each state keeps it.

A row is for one class of objects, one direction and some kinds of states.  Values; LineFrame, metres.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from plnerf.line.clearances import VERDICTS, Verdict
from plnerf.line.ends import Quantity

RuleObject = Literal["ground", "road", "rail", "water", "building", "vegetation", "line", "other"]
"""What a clearance is to; `line`: the wires of another line that cross."""
OBJECTS: tuple[RuleObject, ...] = get_args(RuleObject)
Direction = Literal["vertical", "horizontal", "radial"]
"""Straight down or up; in plan, whatever the height; in space."""
DIRECTIONS: tuple[Direction, ...] = get_args(Direction)
StateKind = Literal["still", "wind", "ice"]
"""Of a load: neither wind nor ice; wind; ice.  One with wind and ice is both of the latter."""
STATE_KINDS: tuple[StateKind, ...] = get_args(StateKind)


@dataclass(frozen=True)
class Rule:
    """A row of a matrix, at the line's voltage."""

    number: int
    """From 1, in the order of the file."""
    object: RuleObject
    direction: Direction
    states: tuple[StateKind, ...]
    required_m: float
    made_of: str
    """How that came about, in words: "5 m + 1.7 m (D_el)"."""
    read_in: str
    """Where the numbers were read."""
    verified: bool
    """Whether all of them were compared with the standard itself."""
    note: str = ""

    @property
    def name(self) -> str:
        """Its number, object and direction."""
        return _name(self.number, self.object, self.direction)


@dataclass(frozen=True, eq=False)
class Judged:
    """The least clearance of the wires of one span in one state, by one rule."""

    rule: int
    """Its number."""
    state: str
    line: int
    span: int
    wire: int
    distance: Quantity
    on_wire: Float[np.ndarray, "3"]
    on_object: Float[np.ndarray, "3"]
    verdict: Verdict
    at_most: bool = False
    """Whether a plant may stand nearer to one of the span's wires, where images do not see."""


@dataclass(frozen=True)
class NotJudged:
    """A rule that could not be applied, or not in the states that it is for."""

    rule: int
    """Its number."""
    object: RuleObject
    direction: Direction
    why: str

    @property
    def name(self) -> str:
        """Its number, object and direction."""
        return _name(self.rule, self.object, self.direction)


@dataclass(frozen=True, eq=False)
class RuleReport:
    """What was required and what was found."""

    name: str
    source: str
    date: str
    voltage_kv: float
    caveats: tuple[str, ...]
    rules: tuple[Rule, ...]
    judged: tuple[Judged, ...]
    """By rule, then in the order of the states, the least margin first."""
    not_judged: tuple[NotJudged, ...] = ()
    objects: tuple[tuple[str, int], ...] = ()
    """Of the user's maps: how many there are of each class near the line."""

    def rule(self, number: int) -> Rule:
        """By its number."""
        return next(one for one in self.rules if one.number == number)

    def margin(self, one: Judged) -> Quantity:
        """Distance less what is required."""
        return Quantity(one.distance.value - self.rule(one.rule).required_m, one.distance.sigma)

    def worst(self) -> tuple[Judged, ...]:
        """The most urgent verdict of each rule in each state, and of several such the least margin."""
        found: dict[tuple[int, str], Judged] = {}
        for one in sorted(self.judged, key=lambda one: (VERDICTS.index(one.verdict), one.distance.value)):
            found.setdefault((one.rule, one.state), one)
        return tuple(found.values())


def _name(number: int, of: RuleObject, direction: Direction) -> str:
    return f"{number}: {of}, {direction}"
