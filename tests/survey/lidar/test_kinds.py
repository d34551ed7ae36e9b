"""Shields are told from phases by where they hang and what they look like."""

import dataclasses

import pytest

from plnerf.line.hang import hang
from plnerf.line.wire import Wire
from plnerf.survey.config_wires import KindsConfig
from plnerf.survey.kinds import kinds

Hung = tuple[Wire, int]
"""A wire and the number of its points."""


def wire(y: float, z: float, sag: float = 4.0, points: int = 300) -> Hung:
    return hang((0.0, y, z), (100.0, y, z), sag), points


def kinds_of(wires: list[Hung], **settings: float) -> list[str]:
    config = dataclasses.replace(KindsConfig(), **settings)
    return list(kinds([one for one, _ in wires], [points for _, points in wires], config))


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
def test_shields_are_the_highest_and_differ(below: list[Hung], top: list[Hung], expected: str) -> None:
    assert kinds_of([*below, *top]) == ["phase"] * len(below) + [expected] * len(top)
    assert kinds_of([*top, *below]) == [expected] * len(top) + ["phase"] * len(below)


def test_a_stretch_of_a_span_has_the_kinds_of_the_span() -> None:
    """Open ends change nothing: the wires' hang is compared, not their sag."""
    whole = [*SINGLE, wire(-3.0, 36.0, sag=3.5), wire(3.0, 36.0, sag=3.5)]
    part = [(one.between(30.0, 70.0), count * 2 // 5) for one, count in whole]
    assert kinds_of(part) == kinds_of(whole) == ["phase"] * 6 + ["shield"] * 2


@pytest.mark.parametrize(("setting", "value"), [
    ("level_m", 0.5), ("below_m", 9.0), ("max_shields", 1), ("min_below", 7), ("bundle_m", 6.0),
    ("flatter", 0.8),
])  # fmt: skip
def test_every_setting_decides(setting: str, value: float) -> None:
    """Two flatter wires that hang 1 m apart in height and 5 m beside each other, 7 m above the phases."""
    wires = [*SINGLE, wire(-2.5, 36.5, sag=3.5), wire(2.5, 37.5, sag=3.5)]
    assert kinds_of(wires)[-1] == "shield"
    assert kinds_of(wires, **{setting: value})[-2:] != ["shield"] * 2


def test_no_wires_have_no_kinds() -> None:
    assert kinds([], []) == []
