"""Clearances by rule as rows of a table (`rows.py` has the rules of columns)."""

from plnerf.export.crs import CrsTransform
from plnerf.export.rows import Row, coordinates, plain_row
from plnerf.line.survey import Survey

RULES = "rules.csv"


def rule_rows(survey: Survey, transform: CrsTransform) -> list[Row]:
    """A row for each rule, state and span, with its verdict; then one for each rule that was not judged, or
    not in the states that it is for, with `why`."""
    report = survey.rules
    if report is None:
        return []
    rows: list[Row] = []
    for one in report.judged:
        rule, margin = report.rule(one.rule), report.margin(one)
        row: Row = {
            "rule": one.rule, "object": rule.object, "direction": rule.direction, "state": one.state,
            "line": one.line, "span": one.span, "wire": one.wire, "distance_m": one.distance.value,
            "distance_95_m": one.distance.half_95, "at_most": one.at_most,
            "required_m": rule.required_m, "margin_m": margin.value, "verdict": one.verdict,
            "read_in": rule.read_in, "verified": str(rule.verified).lower(), "why": None,
        }  # fmt: skip
        ends = {"on_wire": one.on_wire, "on_object": one.on_object}
        rows.append(plain_row(row) | coordinates(transform, ends))
    left: list[Row] = [
        {"rule": one.rule, "object": one.object, "direction": one.direction, "why": one.why}
        for one in report.not_judged
    ]
    empty: Row = dict.fromkeys((rows or left or [{}])[0])
    return rows + [empty | one for one in left]
