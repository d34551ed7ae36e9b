"""Clearances by rule: every row of a matrix against every state that it is for, span by span.

    ground            the ground below the wire
    road, rail, water the same where the wire is above one of the user's map; else, in plan, its nearest edge
    building          points of class 6, and what stands on a building of the user's map
    vegetation, other the groups of the clearances as surveyed
    line              the wires of other lines that cross, as they hang in the same state

A matrix is for phase conductors.  Sag and swing are those of the states (`mechanics/`); the survey itself is
judged too, whatever states a row is for.  Where the nearest plant of a span is an upper limit
(`unseen_air.py`) nothing there is clear of plants.
"""

from collections.abc import Mapping, Sequence

from plnerf.errors import SurveyError
from plnerf.findings import Finding, harms, note
from plnerf.line.clearances import verdict_of
from plnerf.line.rules import Judged, NotJudged, Rule, RuleObject, RuleReport
from plnerf.line.states import SURVEYED
from plnerf.line.survey import Survey
from plnerf.survey.altitude import Altitude, altitude_of
from plnerf.survey.config_ground import ClearanceConfig
from plnerf.survey.config_rules import RulesConfig
from plnerf.survey.map_objects import MapObject, near_line, read_objects
from plnerf.survey.rule_file import Matrix, Row, load_matrix
from plnerf.survey.rule_scene import ON_MAPS, Least, RuleScene, RuleState, rule_states
from plnerf.survey.unseen_air import upper_limits

KIND = "clearances by rule"
"""Kind of the findings."""


def judge_rules(
    survey: Survey, clearance: ClearanceConfig, config: RulesConfig
) -> tuple[RuleReport | None, tuple[Finding, ...]]:
    """The verdicts of a matrix on a survey; None where none is given.

    Raises ConfigError for a voltage that is not the matrix's and maps that cannot be read.
    """
    if config.matrix is None:
        return None, ()
    matrix, kv = load_matrix(config.matrix), config.kv
    maps, given, unplaced = maps_near(survey, clearance.obstacles.reach_m, config)
    rules, not_judged = _applicable(matrix, kv, survey, config)
    states = rule_states(survey)
    lower_m: dict[RuleObject, float] = {}
    for one in rules:
        if one.direction == "vertical":
            lower_m[one.object] = max(one.required_m, lower_m.get(one.object, 0.0))
    scene = RuleScene(survey, maps, clearance, config, lower_m)
    limits = upper_limits(survey)
    judged: list[Judged] = []
    for rule in rules:
        found: list[Judged] = []
        for state in states:
            if state.name == SURVEYED or set(state.kinds) & set(rule.states):
                found += _judge(rule, state, scene.least(rule, state), limits)
        judged += found
        why = _why_not(rule, states, given, judged=bool(found))
        if why:
            not_judged.append(NotJudged(rule.number, rule.object, rule.direction, why))
    report = RuleReport(
        matrix.name, matrix.source, matrix.date, kv, matrix.caveats, tuple(rules), tuple(judged),
        tuple(sorted(not_judged, key=lambda one: one.rule)), _counts(maps),
    )  # fmt: skip
    return report, (*unplaced, *_findings(report))


def maps_near(
    survey: Survey, reach_m: float, config: RulesConfig
) -> tuple[list[MapObject], set[str], list[Finding]]:
    """The maps' objects near the line, and of what classes there are any at all; none, and a finding, where
    they cannot be laid over the survey."""
    try:
        every = read_objects(config.objects, config.object_field, survey.frame)
    except SurveyError as error:
        return [], set(), [harms(KIND, str(error))]
    return near_line(every, survey, reach_m), {one.kind for one in every}, []


def _applicable(
    matrix: Matrix, kv: float, survey: Survey, config: RulesConfig
) -> tuple[list[Rule], list[NotJudged]]:
    """The rows that hold for this line, and why others do not."""
    rules: list[Rule] = []
    left: list[NotJudged] = []
    altitude = altitude_of(survey)
    for row in matrix.rows:
        rule = matrix.rule(row, kv)
        if rule is None:
            continue
        why = _out_of_place(row, config, altitude)
        if why:
            left.append(NotJudged(row.number, row.object, row.direction, why))
        else:
            rules.append(rule)
    return rules, left


def _out_of_place(row: Row, config: RulesConfig, altitude: Altitude) -> str:
    if row.area and row.area not in config.areas:
        return f"it is for {row.area} areas (--rules.areas {row.area!r})"
    if row.up_to_m is not None and altitude.high_m > row.up_to_m:
        return f"it holds up to {row.up_to_m:.0f} m above the sea, but the line is at {altitude.words}"
    return ""


def _judge(
    rule: Rule, state: RuleState, least: Least, limits: Mapping[tuple[int, int], float]
) -> list[Judged]:
    found = []
    for (line, span), (wire, one) in least.items():
        at_most = rule.object == "vegetation" and (line, span) in limits
        verdict = verdict_of(
            one.distance.value, one.distance.sigma, rule.required_m,
            at_most=at_most, hidden_m=limits.get((line, span), 0.0),
        )  # fmt: skip
        found.append(Judged(
            rule.number, state.name, line, span, wire.id, one.distance, one.on_wire, one.on_object, verdict,
            at_most,
        ))  # fmt: skip
    return sorted(found, key=lambda one: one.distance.value)


def _why_not(rule: Rule, states: Sequence[RuleState], given: set[str], *, judged: bool) -> str:
    """Why a rule says nothing, or not in the states that it is for; empty where it does."""
    if rule.object in ON_MAPS and rule.object not in given:
        return f"no {rule.object} of a map is given (--objects)"
    if not judged:
        where = "crosses" if rule.object == "line" else "is near or below the phase conductors"
        return f"no {rule.object} {where}" + ", or no ground is known there" * (rule.object in ON_MAPS)
    if not any(set(one.kinds) & set(rule.states) for one in states):
        return (
            f"no state of {' or '.join(rule.states)} was computed: it was judged as surveyed only "
            "(--conductor, --states)"
        )
    return ""


def _counts(maps: Sequence[MapObject]) -> tuple[tuple[str, int], ...]:
    kinds = [one.kind for one in maps]
    return tuple((kind, kinds.count(kind)) for kind in dict.fromkeys(kinds))


def _findings(report: RuleReport) -> tuple[Finding, ...]:
    unverified = sum(not one.verified for one in report.rules)
    findings = [
        note(KIND, f"{report.name} ({report.source}, {report.date}) at {report.voltage_kv:g} kV, for phase "
             "conductors."),
        *(note(KIND, f"{report.name}: {caveat}") for caveat in report.caveats),
    ]  # fmt: skip
    if unverified:
        findings.append(
            harms(
                KIND,
                f"{unverified} of the {len(report.rules)} rules of {report.name} have numbers that were not "
                "compared with the standard itself.",
                "Compare them before you rely on a verdict.",
            )
        )
    return tuple(findings)
