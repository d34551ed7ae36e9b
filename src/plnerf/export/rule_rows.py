"""Clearances by rule as rows of a table (`rows.py` has the rules of columns)."""

import numpy as np

from plnerf.export.crs import CrsTransform
from plnerf.export.rows import DECIMALS, Row
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
        at = transform.to_map(np.array([one.on_wire, one.on_object]))
        places = {
            f"{name}_{axis}": float(value)
            for name, point in zip(("on_wire", "on_object"), at, strict=True)
            for axis, value in zip("xyz", point, strict=True)
        }
        rows.append({
            "rule": one.rule, "object": rule.object, "direction": rule.direction, "state": one.state,
            "line": one.line, "span": one.span, "wire": one.wire, "distance_m": one.distance.value,
            "distance_95_m": one.distance.half_95, "required_m": rule.required_m,
            "margin_m": margin.value, "verdict": one.verdict, "read_in": rule.read_in,
            "verified": str(rule.verified).lower(), "why": None, **places, "reference": transform.reference,
        })  # fmt: skip
    left: list[Row] = [
        {"rule": one.rule, "object": one.object, "direction": one.direction, "why": one.why}
        for one in report.not_judged
    ]
    empty: Row = dict.fromkeys((rows or left or [{}])[0])
    rows += [empty | one for one in left]
    return [
        {name: round(value, DECIMALS) if isinstance(value, float) else value for name, value in row.items()}
        for row in rows
    ]
