"""Surveys with encroachments, made up: for tests of reports and exports."""

from dataclasses import replace

import numpy as np

from plnerf.line.encroachments import Approach, Encroachment, Encroachments
from plnerf.line.ends import Quantity
from plnerf.line.survey import Survey


def with_encroachments(survey: Survey) -> Survey:
    """A tree that falls and grows, and a pair of crossing wires."""
    a, b = np.array([1.0, 2.0, 9.0]), np.array([1.5, 2.5, 6.0])
    gap = Quantity(3.1, 0.1)

    def one(way: str, distance: float, years: Quantity | None = None) -> Approach:
        verdict = "closer than required" if way != "grow-in" else "within its uncertainty"
        return Approach(
            way, "storm <b>" if way == "blow-out" else "as surveyed", 1, "radial",  # type: ignore[arg-type]
            Quantity(distance, 0.2), 3.0, "rule 1: vegetation, radial (a matrix)", verdict, a, b, years,  # type: ignore[arg-type]
        )  # fmt: skip

    corners = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 4.0], [0.0, 4.0]])
    tree = Encroachment(
        1, 3, "vegetation", 1, 1, 1, None, 21.0, corners, np.array([1.0, 2.0, 6.5]), 5.5, gap, gap, gap, a, b,
        (one("fall-in", -0.75), one("grow-in", 2.75, Quantity(2.0, 0.5))),
    )  # fmt: skip
    wires = Encroachment(
        2, 2, "line", 1, 1, 1, 2, 23.0, np.zeros((0, 2)), b, None, gap, gap, gap, a, b,
        (one("blow-out", 2.25),),
    )  # fmt: skip
    found = Encroachments((tree, wires), ("a matrix",), ("Growth of <i> is not examined.",))
    return replace(survey, encroachments=found)
