"""Names of structures, phases, circuits and lines, matched by place.

Structures and named places are assigned to each other so that the distances in plan add up to the least;
wires likewise, span by span.  A phase that is named in one span is that of the same wire in all of its spans.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

from plnerf.errors import SurveyError
from plnerf.findings import Finding, harms, note
from plnerf.line.line import Line, Span, Structure
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.survey.config_names import NamesConfig
from plnerf.survey.config_wires import KindsConfig
from plnerf.survey.kinds import through_spans
from plnerf.survey.named_places import NamedPlace, read_places

KIND = "names"
"""Kind of the findings."""
MOST_NAMED = 8
"""Names that a finding lists."""


def with_names(survey: Survey, config: NamesConfig, kinds: KindsConfig) -> Survey:
    """The survey with the names of a user's list, and a finding about what could not be matched."""
    if config.places is None or not survey.lines:
        return survey
    try:
        places = read_places(config.places, survey.frame)
    except SurveyError as error:
        return replace(survey, findings=(*survey.findings, harms(KIND, str(error))))
    feet = [one for one in places if one.phase is None]
    phases = [one for one in places if one.phase is not None]
    of_structure = _structures(survey.structures, feet, config.structure_m)
    of_wire = _wires(survey.lines, phases, config.wire_m, kinds)
    lines = tuple(_named(line, of_structure, of_wire) for line in survey.lines)
    findings = _about(survey, feet, phases, of_structure, of_wire, config)
    return replace(survey, lines=lines, findings=(*survey.findings, *findings))


def _structures(
    structures: Sequence[Structure], places: Sequence[NamedPlace], reach_m: float
) -> dict[int, NamedPlace]:
    """The place of each structure, by its id, as far as there is one."""
    if not structures or not places:
        return {}
    feet = np.array([one.foot[:2] for one in structures])
    at = np.array([one.points[:, :2].mean(0) for one in places])
    found = _assigned(np.linalg.norm(feet[:, None] - at, axis=2), reach_m)
    return {structures[i].id: places[j] for i, j in found}


def _wires(
    lines: Sequence[Line], places: Sequence[NamedPlace], reach_m: float, kinds: KindsConfig
) -> dict[int, NamedPlace]:
    """The place of each wire, by its id: that of the most of its spans."""
    found: dict[int, NamedPlace] = {}
    for line in lines if places else ():
        wires = list(line.wires)
        through = through_spans([span.wires for span in line.spans], kinds)
        votes: dict[int, Counter[int]] = {}
        number = {wire.id: int(group) for wire, group in zip(wires, through, strict=True)}
        for span in line.spans:
            apart = np.array([[_apart(wire, one) for one in places] for wire in span.wires])
            for i, j in _assigned(apart.reshape(len(span.wires), len(places)), reach_m):
                votes.setdefault(number[span.wires[i].id], Counter())[j] += 1
        for wire in wires:
            of = votes.get(number[wire.id])
            if of:
                found[wire.id] = places[of.most_common(1)[0][0]]
    return found


def _assigned(apart: Float[np.ndarray, "i j"], reach_m: float) -> list[tuple[int, int]]:
    """Pairs within reach, as many as there can be, with the least sum of distances."""
    far = 1e3 * reach_m
    rows, columns = linear_sum_assignment(np.where(apart <= reach_m, apart, far))
    return [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if apart[i, j] <= reach_m]


def _apart(wire: Wire, place: NamedPlace) -> float:
    """Median distance of the place's points from a wire beside which they lie; infinite where none does."""
    local = wire.base.local(place.points)
    beside = (local[:, 0] >= -1.0) & (local[:, 0] <= wire.base.length_m + 1.0)
    if not beside.any():
        if len(place.points) < 2:
            return np.inf
        return _apart_of_line(wire, place.points)
    off = wire.at(local[beside, 0]) - local[beside, 1:]
    return float(np.median(np.hypot(off[:, 0], np.nan_to_num(off[:, 1]))))


def _apart_of_line(wire: Wire, points: Float[np.ndarray, "n 3"]) -> float:
    """Of a line whose corners all lie beyond the wire's ends: of where it passes the wire's middle."""
    local = wire.base.local(points)
    order = np.argsort(local[:, 0])
    s, middle = local[order, 0], wire.base.length_m / 2
    if not s[0] <= middle <= s[-1]:
        return np.inf
    y = float(np.interp(middle, s, local[order, 1]))
    return abs(y - float(wire.at(np.array([middle]))[0, 0]))


def _named(line: Line, of_structure: dict[int, NamedPlace], of_wire: dict[int, NamedPlace]) -> Line:
    def wire(one: Wire) -> Wire:
        place = of_wire.get(one.id)
        return one if place is None else replace(one, name=place.phase, circuit=place.circuit)

    def span(one: Span) -> Span:
        return replace(one, wires=tuple(map(wire, one.wires)))

    structures = tuple(
        replace(one, name=of_structure[one.id].name) if one.id in of_structure else one
        for one in line.structures
    )
    spans = tuple(map(span, line.spans))
    mine = [of_structure[one.id] for one in line.structures if one.id in of_structure]
    mine += [of_wire[one.id] for one in line.wires if one.id in of_wire]
    names = Counter(one.line for one in mine if one.line)
    volts = Counter(one.voltage_kv for one in mine if one.voltage_kv)
    circuits = {one.circuit for one in mine if one.circuit}
    return replace(
        line, structures=structures, spans=spans,
        name=names.most_common(1)[0][0] if names else line.name,
        voltage_kv=volts.most_common(1)[0][0] if volts else line.voltage_kv,
        circuits=len(circuits) or line.circuits,
    )  # fmt: skip


def _about(
    survey: Survey, feet: Sequence[NamedPlace], phases: Sequence[NamedPlace],
    of_structure: dict[int, NamedPlace], of_wire: dict[int, NamedPlace], config: NamesConfig,
) -> list[Finding]:  # fmt: skip
    """How many names were matched, and which were not."""
    findings = []
    if feet:
        used = {id(one) for one in of_structure.values()}
        missed = [str(one.name) for one in feet if id(one) not in used]
        text = f"{len(of_structure)} of {len(survey.structures)} structures have a name of {config.places}"
        findings.append(_finding(f"{text} within {config.structure_m:g} m.", missed))
    if phases:
        used = {id(one) for one in of_wire.values()}
        missed = [str(one.phase) for one in phases if id(one) not in used]
        text = f"{len(of_wire)} of {len(survey.wires)} wires have a phase of {config.places}"
        findings.append(_finding(f"{text} within {config.wire_m:g} m.", missed))
    return findings


def _finding(text: str, missed: Sequence[str]) -> Finding:
    if not missed:
        return note(KIND, text)
    more = f" and {len(missed) - MOST_NAMED} more" if len(missed) > MOST_NAMED else ""
    return harms(KIND, f"{text} Without a match: {', '.join(missed[:MOST_NAMED])}{more}.")
