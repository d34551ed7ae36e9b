"""Shields are told from phases by where they hang and what they look like."""

import dataclasses
from dataclasses import replace

import pytest
from tests.support.catenary_surveys import corridor, line_of

from plnerf.errors import ConfigError, SurveyError
from plnerf.line.hang import hang
from plnerf.line.wire import Wire
from plnerf.survey.clearance import measure_clearances
from plnerf.survey.config_ground import ClearanceConfig
from plnerf.survey.config_wires import KindsConfig
from plnerf.survey.kinds import kinds
from plnerf.survey.known_kinds import with_stated

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


ARM = [wire(y, 10.0, 0.75) for y in (-1.12, 0.4, 1.12)]


@pytest.mark.parametrize(("wires", "expected"), [
    ([*ARM, wire(-0.2, 8.2, 0.85)], ["neutral"]),
    ([*ARM, wire(-0.2, 8.2, 0.85), wire(0.2, 7.0, 0.9)], ["neutral", "communication"]),
    ([*ARM, wire(-0.2, 9.7, 0.85)], ["phase"]),  # on the same crossarm
    ([*ARM, wire(-0.2, 6.0, 0.85)], ["phase"]),  # too far below for a neutral of these
    ([*ARM, wire(-0.6, 8.2, 0.8), wire(0.6, 8.2, 0.8)], ["phase"] * 2),  # side by side: another circuit
    ([*ARM[:2], wire(-0.2, 8.2, 0.8)], ["phase"]),  # one of three phases
    ([wire(0.0, 10.0), wire(0.0, 8.8), wire(0.0, 7.6), wire(0.0, 6.4)], ["phase"]),  # a vertical circuit
    ([wire(0.0, 11.4, 0.8), *ARM[:2], wire(0.0, 8.2, 0.8)], ["phase"]),  # a triangle
])  # fmt: skip
def test_what_hangs_alone_below_three_phases_on_a_crossarm_is_none(
    wires: list[Hung], expected: list[str]
) -> None:
    assert kinds_of(wires)[3 if len(wires) > 3 else 2 :] == expected
    assert set(kinds_of(wires)[: -len(expected)]) == {"phase"}


def test_neutrals_have_no_verdict_and_can_be_stated_otherwise() -> None:
    """Guessed ones are named, with what to do if they are phases."""
    hung = [replace(one, id=k) for k, (one, _) in enumerate([*ARM, wire(-0.2, 8.2, 0.85)], 1)]
    names = kinds([*hung], [300] * 4)
    named = [replace(one, kind=kind) for one, kind in zip(hung, names, strict=True)]
    base = corridor(count=200)
    survey = replace(base, lines=(line_of(named),))
    found = with_stated(survey, KindsConfig())
    (said,) = found.findings
    assert [one.kind for one in found.wires] == ["phase"] * 3 + ["neutral"]
    assert "Wires 4 hang alone below three phases" in said.what and "--kinds.phase 4" in said.do
    clearances, _ = measure_clearances(found, ClearanceConfig(clearance_m=50.0))
    verdicts = {place.wire: clearances.verdict(place) for place in clearances.all_places()}
    assert verdicts[1] == "closer than required" and verdicts[4] is None
    known = with_stated(survey, KindsConfig(phase=(4,), communication=(2,), shield=(1,)))
    assert [one.kind for one in known.wires] == ["shield", "communication", "phase", "phase"]
    assert known.findings == ()
    label, first = (one.cloud.label[base.cloud.wire == 1] for one in (known, base))
    assert set(label) == {13} and set(first) == {14}
    with pytest.raises(SurveyError, match=r"wires \[9\] are stated, but cloud.laz has wires 1 to 4"):
        with_stated(survey, KindsConfig(neutral=(9,)))
    with pytest.raises(ConfigError, match="each once"):
        KindsConfig(neutral=(2,), phase=(2,))


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
