"""What differs between two surveys of one line, and what explains it.

A sag depends on the conductors' temperature: where a conductor is given and both surveys state theirs, A's
wires are computed at B's (`mechanics/`), and what is left over is tested.  Otherwise a difference of sags is
stated, and its standing is not known.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.stats import norm

from plnerf.change.match import PLACES, same_structures, same_wires
from plnerf.change.places import Onto, onto
from plnerf.change.values import Change, ClearanceChange, SagChange, Standing, StructureChange
from plnerf.line.clearances import GROUPS, Place
from plnerf.line.ends import Quantity
from plnerf.line.states import Load
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.mechanics.config import MechanicsConfig
from plnerf.mechanics.states import compute_loads
from plnerf.survey.obstacles import onto_wire

CHANCE = 0.05
"""Probability that two surveys of an unchanged line differ anywhere, by chance."""
FOOT_M = 0.3
"""Standard deviation of a structure's foot across the line, which surveys do not state."""


def compare_surveys(a: Survey, b: Survey, conductor: Path | None = None, sigma_c: float = 3.0) -> Change:
    """conductor: of the phases, as for `plnerf survey --conductor`; sigma_c: standard deviation of each
    survey's stated temperature.  Raises SurveyError for surveys that cannot be laid over each other."""
    to_b = onto(a.frame, b.frame)
    feet = to_b(np.array([one.foot for one in a.structures]).reshape(-1, 3))
    masts = same_structures(a.structures, b.structures, feet)
    wires_a, wires_b = a.wires, b.wires
    curves = [to_b(wire.points(np.linspace(0.0, wire.base.length_m, PLACES))) for wire in wires_a]
    pairs = [(wires_a[i], wires_b[j]) for i, j in same_wires(wires_a, wires_b, curves)]
    expected, notes = _expected(a, b, [one for one, _ in pairs], conductor, sigma_c)
    sags = [_sag(one, other, b.span_of(other.id).id, expected.get(one.id)) for one, other in pairs]
    moved = [_structure(a, b, feet, i, j) for i, j in masts]
    near = _clearances(a, b, pairs, to_b)
    tested = [*(one.rest_m for one in sags), *(one.moved_m for one in moved)]
    tested += [part for one in near for part in (one.difference_m, one.by_object_m)]
    count = sum(one is not None for one in tested)
    sigmas = float(norm.ppf(1 - CHANCE / (2 * max(count, 1))))
    sags = [replace(one, standing=_sag_standing(one, sigmas)) for one in sags]
    of_sag = {one.b: one.standing for one in sags}
    known = {one.id for one, _ in pairs}, {one.id for _, one in pairs}
    return Change(
        structures=(
            *(replace(one, standing=_standing(one.moved_m, sigmas)) for one in moved),
            *_alone(a, b, feet, masts),
        ),
        sags=tuple(sags),
        clearances=tuple(replace(one, standing=_near_standing(one, of_sag[one.b], sigmas)) for one in near),
        only_a=tuple(wire.id for wire in wires_a if wire.id not in known[0]),
        only_b=tuple(wire.id for wire in wires_b if wire.id not in known[1]),
        comparisons=count,
        sigmas=sigmas,
        notes=tuple(notes),
    )


def _expected(
    a: Survey, b: Survey, wires: Sequence[Wire], conductor: Path | None, sigma_c: float
) -> tuple[dict[int, Quantity], list[str]]:
    """How much each wire's sag changes from A's temperature to B's, by the wire's id in A."""
    if conductor is None or a.temperature_c is None or b.temperature_c is None:
        missing = "no conductor is given (--conductor)" if conductor is None else "a survey states none"
        return {}, [
            "A difference of sags means nothing without the conductors' temperature at both surveys, and "
            f"{missing}: what sags differ by is not judged."
        ]
    loads = (Load("as B", b.temperature_c), Load("a little warmer", b.temperature_c + sigma_c))
    config = MechanicsConfig(conductor=conductor, temperature_sigma_c=sigma_c)
    states, findings = compute_loads(a.lines, a.temperature_c, config, loads)
    if states is None:
        return {}, [one.text for one in findings]
    at_b, warmer = states.states
    found = {}
    for wire in wires:
        one, more = at_b.of(wire.id), warmer.of(wire.id)
        if one is not None and more is not None:
            of_b = more.sag.value - one.sag.value
            found[wire.id] = Quantity(one.sag_change.value, float(np.hypot(one.sag_change.sigma, of_b)))
    return found, [
        f"The conductors were at {a.temperature_c:g} and {b.temperature_c:g} °C, each with a standard "
        f"deviation of {sigma_c:g} °C."
    ]


def _sag(a: Wire, b: Wire, span: int, expected: Quantity | None) -> SagChange:
    one, other = a.sag, b.sag
    if one is None or other is None:
        return SagChange(a.id, b.id, span, one, other, None, None, None, "not known")
    difference = Quantity(other.value - one.value, float(np.hypot(one.sigma, other.sigma)))
    rest = None
    if expected is not None:
        sigma = float(np.hypot(difference.sigma, expected.sigma))
        rest = Quantity(difference.value - expected.value, sigma)
    return SagChange(a.id, b.id, span, one, other, difference, expected, rest, "not known")


def _sag_standing(one: SagChange, sigmas: float) -> Standing:
    if one.difference_m is None or one.rest_m is None:
        return "not known"
    if _standing(one.rest_m, sigmas) == "different":
        return "different"
    return "within the uncertainties" if _within(one.difference_m, sigmas) else "explained by temperature"


def _near_standing(one: ClearanceChange, of_sag: Standing, sigmas: float) -> Standing:
    """A clearance that differs because its wire hangs otherwise stands as the wire's sag does."""
    if _within(one.difference_m, sigmas):
        return "within the uncertainties"
    if not _within(one.by_object_m, sigmas):
        return "different"
    return "different" if of_sag == "within the uncertainties" else of_sag


def _standing(one: Quantity | None, sigmas: float) -> Standing:
    if one is None:
        return "not known"
    return "within the uncertainties" if _within(one, sigmas) else "different"


def _within(one: Quantity, sigmas: float) -> bool:
    return abs(one.value) <= sigmas * one.sigma


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
    a: Survey, b: Survey, pairs: Sequence[tuple[Wire, Wire]], to_b: Onto
) -> list[ClearanceChange]:
    """The least distances of every wire to each group that both surveys have."""
    found = []
    of_a = {one.wire: one for one in (a.clearances.wires if a.clearances is not None else ())}
    of_b = {one.wire: one for one in (b.clearances.wires if b.clearances is not None else ())}
    for one, other in pairs:
        if one.id not in of_a or other.id not in of_b:
            continue
        for group in GROUPS:
            before, after = of_a[one.id].least(group), of_b[other.id].least(group)
            if before is None or after is None:
                continue
            at = to_b(before.on_obstacle[None])
            found.append(_near(one.id, other, before, after, at))
    return found


def _near(a: int, wire: Wire, before: Place, after: Place, at: np.ndarray) -> ClearanceChange:
    """at: A's obstacle in B's frame."""
    was, now = (Quantity(one.distance_m, one.sigma_m) for one in (before, after))
    sigma = float(np.hypot(was.sigma, now.sigma))
    meanwhile = float(onto_wire(wire, at)[0][0])  # from B's wire to A's obstacle
    return ClearanceChange(
        a, wire.id, after.to, was, now, Quantity(now.value - was.value, sigma),
        meanwhile - was.value, Quantity(now.value - meanwhile, sigma), after.on_obstacle,
        float(np.linalg.norm(at[0] - after.on_obstacle)), "not known",
    )  # fmt: skip
