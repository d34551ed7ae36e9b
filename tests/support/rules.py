"""Surveys with clearances by rule, made up: for tests of reports and exports."""

from dataclasses import replace

import numpy as np

from plnerf.line.ends import Quantity
from plnerf.line.rules import Judged, NotJudged, Rule, RuleReport
from plnerf.line.survey import Survey

RULES = (
    Rule(1, "ground", "vertical", ("still",), 6.5, "6.50 m", "a page <i>", False, "farmland"),
    Rule(2, "building", "horizontal", ("wind",), 4.0, "4.00 m", "the standard", True),
    Rule(3, "rail", "vertical", ("still",), 8.5, "8.50 m", "a page", False),
)


def with_rules(survey: Survey) -> Survey:
    """Of three rules, the third of which was not judged."""
    (line, *_), span = survey.lines, survey.spans[0]
    a, b = np.array([1.0, 2.0, 9.0]), np.array([1.0, 2.0, 3.0])

    def one(rule: int, state: str, distance: float, wire: int, verdict: str) -> Judged:
        return Judged(rule, state, line.id, span.id, wire, Quantity(distance, 0.1), a, b, verdict)  # type: ignore[arg-type]

    judged = (
        one(1, "as surveyed", 7.0, 1, "clear"), one(1, "75 °C", 6.25, 1, "closer than required"),
        one(1, "75 °C", 6.45, 2, "within its uncertainty"), one(2, "as surveyed", 5.0, 3, "clear"),
    )  # fmt: skip
    missing = (NotJudged(3, "rail", "vertical", "no rail of a map is given (--objects)"),)
    report = RuleReport("a matrix", "a standard", "2026", 220.0, (), RULES, judged, missing, (("road", 2),))
    return replace(survey, rules=report)
