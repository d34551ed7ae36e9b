"""All states of a survey: which wires have one, from what temperature, and what is missing where none has.

The library of the field is an extra (`pip install "plnerf[mechanics]"`): without it, a conductor or a
temperature, a survey has no states, and a finding says what is missing.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from plnerf.errors import SurveyError
from plnerf.findings import Finding, harms, note
from plnerf.line.ends import Attached, Quantity
from plnerf.line.line import Line
from plnerf.line.states import Load, State, States, WireState
from plnerf.line.wire import Kind, Wire
from plnerf.mechanics.conductor import Conductor, load_conductor
from plnerf.mechanics.config import MechanicsConfig
from plnerf.mechanics.loads import DEFAULT, StateTable, load_states
from plnerf.mechanics.sections import Section, sections

KIND = "other states"
"""Kind of the findings."""
EXTRA = 'pip install "plnerf[mechanics]"'
NAME_IT = "If a structure holds their tension, name it in strain = [...] of the file of the states."


@dataclass(frozen=True)
class _Given:
    """What states are computed from."""

    conductors: dict[Kind, Conductor]
    temperature_c: Quantity
    temperature_from: str
    table: StateTable


def compute_states(
    lines: Sequence[Line],
    temperature_c: float | None,
    config: MechanicsConfig,
    loads: Sequence[Load] | None = None,
) -> tuple[States | None, tuple[Finding, ...]]:
    """The states of a line's wires, and what a reader must know of them.

    temperature_c: of the conductors at the survey, if it is given; loads: in place of those of the settings.
    None, and a finding that names what is missing, without a conductor, a temperature or the extra; a finding
    names wires that no tension answers a state of.  Raises ConfigError for conductors and states that cannot
    be.
    """
    given = _given(temperature_c, config)
    if isinstance(given, Finding):
        return None, (given,)
    found = [
        (one, given.conductors[one.wires[0].kind])
        for line in lines
        for one in sections(line, given.table.strain)
        if one.wires[0].kind in given.conductors
    ]
    states, unanswered = [], []
    for load in given.table.loads if loads is None else loads:
        wires: list[WireState] = []
        for one, of in found:
            try:
                wires += _wire_states(one, of, load, given)
            except SurveyError as error:  # of one section: the others have theirs
                ids = _listed([str(wire.id) for wire in one.wires])
                unanswered.append(harms(KIND, f"Wire{'s' * (len(one.wires) > 1)} {ids}: {error}"))
        states.append(State(load, tuple(wires)))
    made_of = tuple((str(kind), f"{of.name} ({of.source})") for kind, of in given.conductors.items())
    made = States(tuple(states), given.temperature_c, given.temperature_from, made_of)
    return made, (*_findings(lines, [one for one, _ in found], given), *unanswered)


def _given(temperature_c: float | None, config: MechanicsConfig) -> _Given | Finding:
    paths: dict[Kind, Path | None] = {"phase": config.conductor, "shield": config.shield_conductor}
    conductors = {kind: load_conductor(path) for kind, path in paths.items() if path is not None}
    if not conductors:
        return note(
            KIND, "Sag and clearances at other temperatures, in wind and under ice are not computed: no "
            "conductor is given.", "Give --conductor and --temperature-c.",
        )  # fmt: skip
    table = load_states(config.states or DEFAULT)
    if find_spec("mechaphlowers") is None:
        return harms(
            KIND, "Other states are not computed: mechaphlowers is not installed.", f"Install it: {EXTRA}."
        )
    if temperature_c is not None:
        known, words = Quantity(temperature_c, config.temperature_sigma_c), "given"
    elif table.weather is not None and "phase" in conductors:
        if find_spec("linerate") is None:
            return harms(
                KIND, "Other states are not computed: linerate, which has the conductors' temperature from "
                "current and weather, is not installed.", f"Install it: {EXTRA}.",
            )  # fmt: skip
        from plnerf.mechanics.temperature import conductor_temperature

        found = conductor_temperature(conductors["phase"], table.weather)
        known = Quantity(found, table.weather.sigma_c)
        words = f"from {table.weather.current_a:g} A and the weather, by IEEE 738 (linerate)"
    else:
        return harms(
            KIND, "Other states are not computed: the conductors' temperature at the survey is not known.",
            "Give --temperature-c, or [weather] in the file of the states.",
        )  # fmt: skip
    return _Given(conductors, known, words, table)


def _wire_states(one: Section, of: Conductor, load: Load, given: _Given) -> list[WireState]:
    """Of a section's wires, in their order."""
    from plnerf.mechanics.change_of_state import SectionModel
    from plnerf.mechanics.linearised import covariances

    model = SectionModel(tuple(wire.base for wire in one.wires), load, of.diameter_mm, one.forward)
    theta = np.array([wire.theta for wire in one.wires])
    m = np.array([given.temperature_c.value, of.weight_n_m, of.ea_n, of.expansion_per_k])
    of_m = np.diag([
        given.temperature_c.sigma, of.weight_sigma * m[1], of.modulus_sigma * m[2], of.expansion_sigma * m[3]
    ]) ** 2  # fmt: skip
    spans = model.spans(theta, np.zeros((len(theta), 2)))
    ratio = model.solve(spans, m)
    outputs = model.outputs(spans, m, ratio)
    spread = covariances(model, theta, m, ratio, np.array([_covariance(wire) for wire in one.wires]), of_m)
    sigma = np.sqrt(np.maximum(np.einsum("kii->ki", spread), 0.0))
    strength = of.rated_strength_kn
    return [
        WireState(
            wire=wire.id,
            theta=outputs[k, :6],
            covariance=spread[k, :6, :6],
            sag=Quantity(float(outputs[k, 6]), float(sigma[k, 6])),
            sag_change=Quantity(float(outputs[k, 7]), float(sigma[k, 7])),
            horizontal_n=Quantity(float(outputs[k, 8]), float(sigma[k, 8])),
            greatest_n=Quantity(float(outputs[k, 9]), float(sigma[k, 9])),
            strength_share=None if strength is None else float(outputs[k, 9]) / (1e3 * strength),
            ruling_span_m=one.ruling_span_m,
        )
        for k, wire in enumerate(one.wires)
    ]


def _covariance(wire: Wire) -> np.ndarray:
    """Of theta and of the two ends along the base."""
    found = np.zeros((8, 8))
    found[:6, :6] = wire.covariance
    for k, end in enumerate(wire.ends):
        found[6 + k, 6 + k] = end.sigma_m**2 if isinstance(end, Attached) else 0.0
    return found


def _findings(
    lines: Sequence[Line], found: Sequence[Section], given: _Given
) -> tuple[Finding, ...]:
    """What a reader must know of the states; where there are none, why."""
    have = {wire.id for one in found for wire in one.wires}
    if not have:
        return tuple(_without(lines, have, given.conductors))
    named = "; ".join(f"{kind}: {of.name}" for kind, of in given.conductors.items())
    findings = [
        note(
            KIND,
            f"Other states hold for these conductors ({named}), which were at "
            f"{given.temperature_c.value:.0f} °C when surveyed ({given.temperature_from}; "
            f"± {given.temperature_c.half_95:.0f} °C, 95 %), and "
            "for attachments that stay where they are: strings that swing in wind, supports that give way, "
            "creep from now on, and aluminium that goes slack at high temperature are left out.",
        )
    ]
    if "shield" in given.conductors:
        findings.append(
            note(
                KIND,
                "Shield wires are taken to be as warm as the phases, at the survey and in every state. They "
                "carry no current, and mostly are cooler.",
            )
        )
    findings += [note(KIND, f"{of.name}: {text}") for of in given.conductors.values() for text in of.caveats]
    findings += _without(lines, have, given.conductors)
    strange = sorted(set(given.table.strain) - {one.id for line in lines for one in line.structures})
    if strange:
        findings.append(
            harms(
                KIND,
                f"strain = {strange} of the file of the states names structures that the survey does not "
                "have.",
                "Take their numbers from its report.",
            )
        )
    open_at = sorted({where for one in found for where in one.open_at})
    if open_at:
        findings.append(
            harms(
                KIND,
                f"The wires may go on in the same tension section beyond {_listed(open_at)}: the ruling span "
                "is that of what was surveyed.",
                NAME_IT,
            )
        )
    assumed = [str(id_) for id_ in sorted({id_ for one in found for id_ in one.assumed})]
    if assumed:
        findings.append(
            harms(
                KIND,
                f"The kind of structure{'s' * (len(assumed) > 1)} {_listed(assumed)} is not known: the wires "
                "are taken to run on there as over a suspension, which evens out their tensions.",
                NAME_IT,
            )
        )
    return tuple(findings)


def _without(lines: Sequence[Line], have: Collection[int], known: Collection[str]) -> list[Finding]:
    """Which wires have no states, and why."""
    reasons: dict[str, list[str]] = {}
    for wire in (wire for line in lines for wire in line.wires if wire.id not in have):
        why = wire.open if wire.kind in known else f"no conductor is given for {wire.kind} wires"
        reasons.setdefault(why or "its ends are not known", []).append(str(wire.id))
    return [
        note(KIND, f"Of wire{'s' * (len(ids) > 1)} {_listed(ids)} no other state is known: {why}.")
        for why, ids in reasons.items()
    ]


def _listed(parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
