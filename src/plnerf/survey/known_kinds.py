"""Kinds of wires that somebody knows, and what is said of those that were guessed."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from plnerf.errors import SurveyError
from plnerf.findings import Finding, harms
from plnerf.line.cloud import CONDUCTOR, SHIELD
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.survey.config_wires import KindsConfig


def with_stated(survey: Survey, config: KindsConfig) -> Survey:
    """The survey with the kinds that the settings state, and a finding about guessed ones without a verdict.

    Raises SurveyError where a stated wire is none of the survey's.
    """
    stated, ids = config.stated, {wire.id for wire in survey.wires}
    strange = sorted(stated.keys() - ids)
    if strange and ids:
        raise SurveyError(
            f"The kinds of wires {strange} are stated, but {survey.source} has wires 1 to {max(ids)}. Take "
            "the numbers from the report of a survey with the same settings."
        )

    def named(wire: Wire) -> Wire:
        return replace(wire, kind=stated.get(wire.id, wire.kind))

    lines = tuple(
        replace(line, spans=tuple(replace(span, wires=tuple(map(named, span.wires))) for span in line.spans))
        for line in survey.lines
    )
    cloud, kind_of = survey.cloud, {wire.id: named(wire).kind for wire in survey.wires}
    label = cloud.label.copy()
    for number in stated.keys() & ids:
        label[cloud.wire == number] = SHIELD if kind_of[number] == "shield" else CONDUCTOR
    guessed = {
        kind: [number for number, its in kind_of.items() if its == kind and number not in stated]
        for kind in ("neutral", "communication")
    }
    return replace(
        survey, lines=lines, cloud=replace(cloud, label=label), detected=tuple(map(named, survey.detected)),
        findings=(*survey.findings, *_about(guessed)),
    )  # fmt: skip


def _about(guessed: Mapping[str, Sequence[int]]) -> list[Finding]:
    named = {"neutral": "the next one down, and are taken for neutral conductors",
             "communication": "further down, and are taken for communication cables"}  # fmt: skip
    return [
        harms(
            "kinds of wires",
            f"Wires {' '.join(map(str, numbers))} hang alone below three phases on one crossarm, "
            f"{named[kind]}: nothing is required of their clearances.",
            f"If they are phases, survey again with --kinds.phase {' '.join(map(str, numbers))}.",
        )
        for kind, numbers in guessed.items()
        if numbers
    ]
