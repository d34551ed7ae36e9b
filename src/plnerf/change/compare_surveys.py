"""What differs between two surveys of one line, and what explains it.

Of sags and clearances, what the conductors' temperatures explain (`warmed.py`) is taken out where it is
known, and the rest is tested.  Of a clearance it is tested, too, whether the obstacle is where it was.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import norm

from plnerf.change.match import same_structures, same_wires
from plnerf.change.places import Onto, onto
from plnerf.change.values import (
    Change,
    ClearanceChange,
    SagChange,
    Standing,
    StructureChange,
    WireAlone,
)
from plnerf.change.warmed import Warmed, warmed_wires
from plnerf.line.clearances import GROUPS, Group, Place
from plnerf.line.ends import Quantity
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.mechanics.config import MechanicsConfig
from plnerf.survey.obstacles import onto_wire

CHANCE = 0.05
"""Probability that two surveys of an unchanged line differ anywhere, by chance."""
FOOT_M = 0.3
"""Standard deviation of a structure's foot across the line, which surveys do not state."""


def compare_surveys(a: Survey, b: Survey, config: MechanicsConfig | None = None) -> Change:
    """config: the conductors, and the deviation of temperatures that were given; of its states counts only
    what ends a tension section (`strain`, by A's numbers).

    Raises SurveyError for surveys that cannot be laid over each other.
    """
    to_b = onto(a.frame, b.frame)
    feet = to_b(np.array([one.foot for one in a.structures]).reshape(-1, 3))
    masts = same_structures(a.structures, b.structures, feet)
    chords = [to_b(wire.points(np.array([0.0, wire.base.length_m]))) for wire in a.wires]
    pairs = [(a.wires[i], b.wires[j]) for i, j in same_wires(chords, b.wires)]
    warmed, notes = warmed_wires(a, b, [one for one, _ in pairs], config or MechanicsConfig())
    moved = [_structure(a, b, feet, i, j) for i, j in masts]
    sags = [_sag(one, other, b.span_of(other.id).id, warmed.get(one.id)) for one, other in pairs]
    near = _clearances(a, b, pairs, warmed, to_b)
    tested = [part for one in sags for part in (one.difference_m, one.rest_m)]
    tested += [part for one in near for part in (one.difference_m, one.rest_m, one.by_object_m)]
    tested += [one.moved_m for one in moved]
    count = sum(one is not None for one in tested)
    sigmas = float(norm.ppf(1 - CHANCE / (2 * max(count, 1))))
    if silent := sorted(one.b for one in sags if one.difference_m is None):
        named = ", ".join(map(str, silent))
        notes.append(f"No sag is compared of B's wires {named}: an end of theirs, or of A's, is open.")
    known = {one.id for one, _ in pairs}, {one.id for _, one in pairs}
    return Change(
        structures=(
            *(replace(one, standing=_standing(one.moved_m, one.moved_m, sigmas)) for one in moved),
            *_alone(a, b, feet, masts),
        ),
        sags=tuple(replace(one, standing=_standing(one.difference_m, one.rest_m, sigmas)) for one in sags),
        clearances=tuple(replace(one, standing=_near_standing(one, sigmas)) for one in near),
        wires=(
            *(WireAlone(wire.id, None) for wire in a.wires if wire.id not in known[0]),
            *(WireAlone(None, wire.id) for wire in b.wires if wire.id not in known[1]),
        ),
        comparisons=count,
        sigmas=sigmas,
        notes=tuple(notes),
    )


def _sag(a: Wire, b: Wire, span: int, warmed: Warmed | None) -> SagChange:
    one, other = a.sag, b.sag
    if one is None or other is None:
        return SagChange(a.id, b.id, span, one, other, None, None, None, "not known")
    difference, expected = _less(other, one), None if warmed is None else warmed.sag
    rest = _rest(difference, expected)
    return SagChange(a.id, b.id, span, one, other, difference, expected, rest, "not known")


def _structure(a: Survey, b: Survey, feet: np.ndarray, i: int, j: int) -> StructureChange:
    one, other = a.structures[i], b.structures[j]
    sigma = float(np.sqrt(one.sigma_m**2 + other.sigma_m**2 + 2 * FOOT_M**2))
    moved = Quantity(float(np.linalg.norm(feet[i, :2] - other.foot[:2])), sigma)
    return StructureChange(one.id, other.id, other.name or one.name, other.foot, moved, "not known")


def _alone(
    a: Survey, b: Survey, feet: np.ndarray, masts: Sequence[tuple[int, int]]
) -> list[StructureChange]:
    in_a, in_b = {i for i, _ in masts}, {j for _, j in masts}
    gone = [
        StructureChange(one.id, None, one.name, feet[i], None, "different")
        for i, one in enumerate(a.structures)
        if i not in in_a
    ]
    new = [
        StructureChange(None, one.id, one.name, one.foot, None, "different")
        for j, one in enumerate(b.structures)
        if j not in in_b
    ]
    return [*gone, *new]


def _clearances(
    a: Survey, b: Survey, pairs: Sequence[tuple[Wire, Wire]], warmed: Mapping[int, Warmed], to_b: Onto
) -> list[ClearanceChange]:
    """The least distances of every wire to each group that a survey has something of near it."""
    of_a = {one.wire: one for one in (a.clearances.wires if a.clearances is not None else ())}
    of_b = {one.wire: one for one in (b.clearances.wires if b.clearances is not None else ())}
    found = []
    for one, other in pairs:
        if one.id not in of_a or other.id not in of_b:
            continue
        for group in GROUPS:
            before, after = of_a[one.id].least(group), of_b[other.id].least(group)
            if before is not None and after is not None:
                found.append(_near(before, after, other, warmed.get(one.id), to_b))
            elif before is not None or after is not None:
                found.append(_near_alone(one.id, other.id, group, before, after, to_b))
    return found


def _near(before: Place, after: Place, wire: Wire, warmed: Warmed | None, to_b: Onto) -> ClearanceChange:
    """wire: of B."""
    was, now = _distance(before), _distance(after)
    at = to_b(before.on_obstacle[None])
    meanwhile = float(onto_wire(wire, at)[0][0])  # from B's wire to A's obstacle
    difference = _less(now, was)
    expected = None if warmed is None else warmed.distance(before)
    return ClearanceChange(
        before.wire, wire.id, after.to, was, now, difference, expected, _rest(difference, expected),
        Quantity(now.value - meanwhile, difference.sigma), after.on_obstacle,
        float(np.linalg.norm(at[0] - after.on_obstacle)), "not known",
    )  # fmt: skip


def _near_alone(
    a: int, b: int, to: Group, before: Place | None, after: Place | None, to_b: Onto
) -> ClearanceChange:
    """Of a group that one survey alone has something of near the wire."""
    place = to_b(before.on_obstacle[None])[0] if before is not None else None
    place = after.on_obstacle if after is not None else place
    assert place is not None
    was, now = (None if one is None else _distance(one) for one in (before, after))
    return ClearanceChange(a, b, to, was, now, None, None, None, None, place, None, "different")


def _distance(place: Place) -> Quantity:
    return Quantity(place.distance_m, place.sigma_m)


def _less(later: Quantity, earlier: Quantity) -> Quantity:
    return Quantity(later.value - earlier.value, float(np.hypot(later.sigma, earlier.sigma)))


def _rest(difference: Quantity, expected: Quantity | None) -> Quantity | None:
    return None if expected is None else _less(difference, expected)


def _near_standing(one: ClearanceChange, sigmas: float) -> Standing:
    if one.by_object_m is None or not _within(one.by_object_m, sigmas):
        return "different"
    return _standing(one.difference_m, one.rest_m, sigmas)


def _standing(difference: Quantity | None, rest: Quantity | None, sigmas: float) -> Standing:
    """rest: of the difference, what temperature does not explain; None: it is not known."""
    if rest is not None and not _within(rest, sigmas):
        return "different"
    if difference is not None and _within(difference, sigmas):
        return "within the uncertainties"
    return "not known" if rest is None else "explained by temperature"


def _within(one: Quantity, sigmas: float) -> bool:
    return abs(one.value) <= sigmas * one.sigma
