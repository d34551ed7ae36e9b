"""Shields are told from phases by where they hang and what they look like."""

import numpy as np
import pytest

from plnerf.survey.fit import Base, CatenaryFit
from plnerf.survey.kinds import kinds

Wire = tuple[CatenaryFit, int]


def wire(y: float, z: float, sag: float = 4.0, points: int = 300) -> Wire:
    base = Base(np.zeros(2), np.array([1.0, 0.0]), 100.0)
    fit = CatenaryFit(base, np.array([y, y, z, z, sag]), np.zeros((5, 5)), np.ones(9, bool), 0.0, 0.0)
    return fit, points


def kinds_of(wires: list[Wire]) -> list[str]:
    return list(kinds([fit for fit, _ in wires], [points for _, points in wires]))


PHASES = [(side * 5.0, z) for side in (-1, 1) for z in (18.0, 24.0, 30.0)]
SINGLE = [wire(y, z) for y, z in PHASES]
TWINS = [wire(y + twin, z) for y, z in PHASES for twin in (-0.2, 0.2)]


@pytest.mark.parametrize(("below", "top", "expected"), [
    (SINGLE, [], "phase"),  # the highest pair of a double circuit looks like the others
    (TWINS, [wire(0.0, 36.0)], "shield"),  # alone above bundles
    (SINGLE, [wire(-3.0, 36.0, sag=3.5), wire(3.0, 36.0, sag=3.5)], "shield"),  # flatter
    (SINGLE, [wire(0.0, 36.0, points=120)], "shield"),  # thinner
    (SINGLE, [wire(0.0, 36.0)], "phase"),  # nothing tells it from a phase
    (SINGLE, [wire(0.0, 30.5, sag=3.0)], "phase"),  # not above them
    (SINGLE[:2], [wire(0.0, 36.0, sag=3.0)], "phase"),  # one of three phases, one above the other
    (TWINS, [wire(-0.2, 36.0), wire(0.2, 36.0)], "phase"),  # a bundle itself
])  # fmt: skip
def test_shields_are_the_highest_and_differ(below: list[Wire], top: list[Wire], expected: str) -> None:
    assert kinds_of([*below, *top]) == ["phase"] * len(below) + [expected] * len(top)
    assert kinds_of([*top, *below]) == [expected] * len(top) + ["phase"] * len(below)


def test_no_wires_have_no_kinds() -> None:
    assert kinds([], []) == []
