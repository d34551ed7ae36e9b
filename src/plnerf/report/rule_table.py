"""Tables of clearances by rule: the verdicts, what could not be judged, and where the numbers are from."""

from plnerf.line.rules import Judged, RuleReport
from plnerf.line.survey import Survey
from plnerf.report.coverage_view import any_not_seen, not_seen
from plnerf.report.figures import NOTHING, Units, counted
from plnerf.report.nearest import STANDINGS
from plnerf.report.shown import shown
from plnerf.report.tables import XYZ, Cell, Table, Verdict
from plnerf.report.words import numbers_of_spans, span_head


def rule_tables(survey: Survey) -> list[Table]:
    """The worst span of every rule in every state, all spans, what was not judged, and the rules; none
    without a matrix."""
    report = survey.rules
    if report is None:
        return []
    worst = report.worst()
    tables = []
    if worst:
        tables.append(_verdicts(survey, report, worst, ""))
    if len(worst) < len(report.judged):
        folded = f"All {len(report.judged):,} verdicts, by span"
        tables.append(_verdicts(survey, report, report.judged, folded))
    if report.not_judged:
        tables.append(
            Table(
                ["rule", "why"], [[str(one.rule), one.why] for one in report.not_judged],
                "What was not judged, or not in the states that it is for.", frozenset({1}),
            )
        )  # fmt: skip
    return [*tables, _rules(report)]


def rule_summary(survey: Survey) -> str:
    """How many rules are kept in how many states, in one sentence; empty without a matrix."""
    report = survey.rules
    if report is None:
        return ""
    worst = report.worst()
    if not worst:
        return f"{report.name}: nothing could be judged."
    words = [one.verdict for one in worst]
    parts = [
        f"{words.count(verdict)} {text}"
        for verdict, text in (
            ("closer than required", "not kept"), ("within its uncertainty", "within its uncertainty"),
            ("clear", "kept"),
        )
        if verdict in words
    ]  # fmt: skip
    return (
        f"{report.name}, {report.voltage_kv:g} kV: of {counted(len(worst), 'verdict')} on a rule in a state, "
        f"{', '.join(parts)}."
    )


def _verdicts(survey: Survey, report: RuleReport, judged: tuple[Judged, ...], folded: str) -> Table:
    units, span, silent = Units(survey.frame.unit), numbers_of_spans(survey), any_not_seen(survey)
    rows: list[list[Cell]] = []
    for one in judged:
        rule, margin = report.rule(one.rule), report.margin(one)
        rows.append([
            Verdict(one.verdict, STANDINGS[one.verdict]), rule.name, one.state, span[one.wire], str(one.wire),
            units.interval(one.distance), units.length(rule.required_m),
            units.interval(margin), units.place(shown(survey.frame, one.on_wire)),
            units.place(shown(survey.frame, one.on_object)),
            *[not_seen(survey, one.wire) or NOTHING] * silent,
        ])  # fmt: skip
    which = "The least margin of every rule in every state" if not folded else "Every span"
    return Table(
        ["verdict", "rule", "state", span_head(survey), "wire", *units.heads_95("distance"),
         *units.heads("required"), *units.heads_95("margin"), f"on the wire {XYZ}", f"on the object {XYZ}",
         *["not seen at stations"] * silent],
        rows,
        f"{which}; phase conductors only. Margin: the distance less what is required. Within two of its "
        "standard deviations of 0 the verdict is \"within its uncertainty\"."
        + " Where stretches were not seen, a verdict is about what was seen." * silent,
        frozenset({0, 1, 2}), folded=folded,
    )  # fmt: skip


def _rules(report: RuleReport) -> Table:
    units = Units("m")
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
