"""Tables of clearances by rule: the verdicts, what could not be judged, and where the numbers are from."""

from collections import Counter
from typing import get_args

from plnerf.line.clearances import Verdict as VerdictWords
from plnerf.line.rules import Judged, RuleReport
from plnerf.line.survey import Survey
from plnerf.report.coverage_view import any_not_seen, not_seen
from plnerf.report.figures import NOTHING, Units, counted, listed
from plnerf.report.nearest import STANDINGS, limit_sign
from plnerf.report.shown import shown, units_of
from plnerf.report.tables import XYZ, Cell, Table, Verdict
from plnerf.report.words import numbers_of_spans, span_head


def rule_tables(survey: Survey) -> list[Table]:
    """The worst span of every rule in every state, all spans, what was not judged, and the rules; none
    without a matrix."""
    report = survey.rules
    if report is None:
        return []
    worst = tuple(sorted(report.worst(), key=lambda one: report.margin(one).value))
    tables = []
    if worst:
        tables.append(_verdicts(survey, report, worst, ""))
    if len(worst) < len(report.judged):
        folded = f"All {len(report.judged):,} verdicts, by span"
        tables.append(_verdicts(survey, report, report.judged, folded))
    if report.not_judged:
        tables.append(
            Table(
                ["rule", "why"], [[one.name, one.why] for one in report.not_judged],
                "What was not judged, or not in the states that it is for.", frozenset({0, 1}),
            )
        )  # fmt: skip
    return [*tables, _rules(report, units_of(survey))]


def rule_summary(survey: Survey) -> str:
    """How many verdicts of each kind there are, in one sentence; empty without a matrix."""
    report = survey.rules
    if report is None:
        return ""
    worst = report.worst()
    if not worst:
        return f"{report.name}: nothing could be judged."
    counts = Counter(one.verdict for one in worst)
    parts = [f"{counts[verdict]} {verdict}" for verdict in get_args(VerdictWords) if counts[verdict]]
    return (
        f"{report.name} at {report.voltage_kv:g} kV: {counted(len(worst), 'verdict')}, one of each rule "
        f"in each state: {listed(parts)}."
    )


def _verdicts(survey: Survey, report: RuleReport, judged: tuple[Judged, ...], folded: str) -> Table:
    units, span, silent = units_of(survey), numbers_of_spans(survey), any_not_seen(survey)
    upper = any(one.at_most for one in judged)
    rows: list[list[Cell]] = []
    for one in judged:
        rule, margin = report.rule(one.rule), report.margin(one)
        rows.append([
            Verdict(one.verdict, STANDINGS[one.verdict]), rule.name.replace(" ", "\u00a0"), one.state,
            span[one.wire], str(one.wire), limit_sign(one) + units.interval(one.distance),
            units.length(rule.required_m), limit_sign(one) + units.interval(margin),
            *[not_seen(survey, one.wire) or NOTHING] * silent,
            units.place(shown(survey.frame, one.on_wire)), units.place(shown(survey.frame, one.on_object)),
        ])  # fmt: skip
    which = "Every span" if folded else (
        "Of every rule in every state the most urgent verdict with the least margin, the least first"
    )
    return Table(
        ["verdict", "rule", "state", span_head(survey), "wire", *units.heads_95("distance"),
         *units.heads("required"), *units.heads_95("margin"), *["not seen at stations"] * silent,
         f"on the wire {XYZ}", f"on the object {XYZ}"],
        rows,
        f"{which}; phase conductors only. Margin: the distance less what is required. Within two of its "
        "standard deviations of 0 the verdict is \"within its uncertainty\"."
        + " Where stretches were not seen, a verdict is about what was seen." * silent
        + " ≤: a plant may be nearer, where too little of the air about the span's wires was seen." * upper,
        frozenset({0, 1, 2}), folded=folded,
    )  # fmt: skip


def _rules(report: RuleReport, units: Units) -> Table:
    return Table(
        ["rule", "object", "direction", "states", *units.heads("required"), "made of", "read in", "compared",
         "note"],
        [
            [
                str(one.number), one.object, one.direction, ", ".join(one.states),
                units.length(one.required_m), one.made_of, one.read_in,
                "with the standard" if one.verified else "unverified", one.note or NOTHING,
            ]
            for one in report.rules
        ],
        f"{report.name}: {report.source}, {report.date}. Each rule at {report.voltage_kv:g} kV, with where "
        "its numbers were read.",
        frozenset({1, 2, 3, 5, 6, 7, 8}), folded="The rules, and where their numbers were read",
    )  # fmt: skip
