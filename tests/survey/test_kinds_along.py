"""A wire is of one kind in all spans of its line."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support.many_spans import FEET, PHASES, line_along

from plnerf.line.ends import Open
from plnerf.line.line import Line
from plnerf.line.wire import Wire
from plnerf.survey.config_wires import KindsConfig
from plnerf.survey.kinds import kinds, same_along, with_kinds

UNKNOWN = line_along(FEET, [(y, z, "unknown") for y, z, _ in PHASES], sag_share=0.03)


def flatter(line: Line, spans: tuple[int, ...]) -> Line:
    """The line whose highest wire sags less in some of its spans."""

    def hung(wire: Wire) -> Wire:
        return replace(wire, theta=wire.theta * [1, 1, 1, 1, 0.8, 1])

    return replace(line, spans=tuple(
        replace(span, wires=(*span.wires[:3], hung(span.wires[3]))) if k in spans else span
        for k, span in enumerate(line.spans)
    ))  # fmt: skip


def kinds_of(line: Line, **settings: float) -> list[list[str]]:
    (named,) = with_kinds([line], replace(KindsConfig(), **settings))
    return [[wire.kind for wire in span.wires] for span in named.spans]


@pytest.mark.parametrize(
    ("spans", "kind"),
    [((), "phase"), ((0,), "phase"), ((0, 2), "shield"), ((1, 2), "shield"), ((0, 1, 2), "shield")],
)
def test_a_wire_has_the_kind_of_most_of_its_length(spans: tuple[int, ...], kind: str) -> None:
    assert kinds_of(flatter(UNKNOWN, spans)) == [["phase"] * 3 + [kind]] * 3
    alone = [kinds(span.wires, [300] * 4)[3] for span in flatter(UNKNOWN, spans).spans]
    assert [one == "shield" for one in alone] == [k in spans for k in range(3)]


def test_settings_decide_what_is_one_wire_and_when_it_is_a_shield() -> None:
    line = flatter(UNKNOWN, (0,))
    assert kinds_of(line, min_share=0.1) == [["phase"] * 3 + ["shield"]] * 3
    separate = kinds_of(line, same_m=-1.0)
    assert [span[3] for span in separate] == ["shield", "phase", "phase"]


def test_spans_that_share_no_structure_are_judged_alone() -> None:
    line = flatter(UNKNOWN, (0, 1))
    last = line.spans[2]
    loose = replace(
        last, wires=tuple(replace(wire, ends=(Open("hidden"), wire.ends[1])) for wire in last.wires)
    )
    apart = kinds_of(replace(line, spans=(*line.spans[:2], loose)))
    assert [span[3] for span in apart] == ["shield", "shield", "phase"]
    assert [span[3] for span in kinds_of(line)] == ["shield"] * 3


def test_strain_insulators_hold_a_wire_apart_along_the_line_and_it_is_one_still() -> None:
    """Each span's wires end 2 m before their structure."""
    line = flatter(UNKNOWN, (0, 1))

    def ended(wire: Wire) -> Wire:
        cut = wire.between(2.0, wire.base.length_m - 2.0)
        at = cut.points(np.array([0.0, cut.base.length_m]))
        ends = tuple(replace(end, point=point) for end, point in zip(wire.ends, at, strict=True))
        return replace(cut, ends=ends)

    spans = tuple(replace(span, wires=tuple(map(ended, span.wires))) for span in line.spans)
    assert kinds_of(replace(line, spans=spans)) == [["phase"] * 3 + ["shield"]] * 3


def test_wires_that_run_against_each_other_and_shorter_ones_are_compared_at_one_place() -> None:
    """On a slope of 20 degrees the end of a low wire is higher than the middle of the highest."""
    slope = np.tan(np.radians(20.0))
    (span,) = flatter(line_along(FEET[:2], [(y, z, "unknown") for y, z, _ in PHASES]), (0,)).spans
    L = span.wires[0].base.length_m
    steep = [replace(wire, theta=wire.theta + np.array([0, 0, 0, slope * L, 0, 0])) for wire in span.wires]
    assert kinds(steep, [300] * 4) == ["phase"] * 3 + ["shield"]
    part = [steep[0].between(0.6 * L, L), *steep[1:]]
    assert kinds(part, [120, 300, 300, 300]) == ["phase"] * 3 + ["shield"]


def test_how_many_images_show_a_wire_says_nothing_of_its_kind() -> None:
    seen_less = replace(UNKNOWN.spans[0].wires[3].evidence, count=3)
    spans = tuple(
        replace(span, wires=(*span.wires[:3], replace(span.wires[3], evidence=seen_less)))
        for span in UNKNOWN.spans
    )
    assert kinds_of(replace(UNKNOWN, spans=spans)) == [["phase"] * 4] * 3
    assert kinds(spans[0].wires, [300, 300, 300, 3]) == ["phase"] * 3 + ["shield"]  # of a laser's points


def test_no_spans_have_no_kinds() -> None:
    assert same_along([]) == [] and with_kinds([]) == ()
