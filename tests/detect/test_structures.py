"""Two spans' wires end where their curves meet, also where images show them short of it or beyond."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support.drawn import HALF, hanging, resized, uncertain

from plnerf.detect.config import JoinConfig, MeetConfig
from plnerf.detect.structures import ended_where_they_meet, in_one_piece
from plnerf.line.base import Base
from plnerf.line.wire import Wire

CONFIG = MeetConfig()
JOIN = JoinConfig()


def next_span(wire: Wire, turn_rad: float, beside: float = 0.0) -> Wire:
    """The same wire hung on from the last end of this one, in another direction."""
    u, n = wire.base.u, wire.base.n
    onward = np.cos(turn_rad) * u + np.sin(turn_rad) * n
    begin = wire.base.b + beside * n
    return replace(wire, base=Base(begin, begin + 2 * HALF * onward))


@pytest.mark.parametrize("turn_rad", [0.0, 0.3, -0.9])
@pytest.mark.parametrize(("before", "beyond"), [(0.18, 0.1), (-0.1, 0.15), (-0.1, -0.2)])
def test_wires_that_are_seen_short_or_too_far_end_at_the_structure(
    turn_rad: float, before: float, beyond: float
) -> None:
    """before, beyond: how much of each is missing; below 0: by how much it goes on too far."""
    first = hanging(0.0, 0.05, sag=0.1)
    second = next_span(first, turn_rad)
    seen = [first.between(0.3, 2 * HALF - before), second.between(beyond, 1.5)]
    one, other = ended_where_they_meet(seen, CONFIG)
    structure = np.array([*first.base.b, first.theta[3]])
    off = 2 * CONFIG.step * 2 * HALF
    np.testing.assert_allclose(one.points(np.array([one.base.length_m]))[0], structure, atol=off)
    np.testing.assert_allclose(other.points(np.zeros(1))[0], structure, atol=off)
    np.testing.assert_allclose(one.points(np.zeros(1)), seen[0].points(np.zeros(1)), atol=1e-9)
    ((low, high),) = one.evidence.seen_m or ((np.nan, np.nan),)
    shown = min(1.5 - before, 1.5)
    assert (low, high) == pytest.approx((0.0, shown), abs=off)
    assert one.evidence.coverage == pytest.approx(shown / 1.5, abs=off)
    assert one.evidence.longest_gap_m == pytest.approx(max(before, 0.0), abs=off)


def test_the_frames_unit_does_not_matter() -> None:
    first = hanging(0.0, 0.05, sag=0.1)
    seen = [first.between(0.3, 1.6), next_span(first, 0.3).between(0.1, 1.5)]
    small = ended_where_they_meet(seen, CONFIG)
    large = ended_where_they_meet([resized(wire, 50.0) for wire in seen], CONFIG)
    for one, other in zip(small, large, strict=True):
        assert other.base.length_m == pytest.approx(50 * one.base.length_m, rel=1e-6)


def test_what_does_not_meet_is_left() -> None:
    first = hanging(0.0, 0.05, sag=0.1)
    cut = first.between(0.0, 1.7)

    def after(second: Wire) -> Wire:
        return ended_where_they_meet([cut, second], CONFIG)[0]

    assert after(next_span(first, 0.3)).base.length_m > 1.75
    assert after(uncertain(next_span(first, 0.3))) is cut
    assert after(next_span(first, 0.0, beside=0.05)) is cut  # of another wire
    assert after(next_span(first, 1.4)) is cut  # no line turns so
    far = next_span(first, 0.3).between(0.6, 1.5)
    assert after(far) is cut
    loose = replace(next_span(first, 0.3), covariance=np.diag([0.05**2] * 5 + [0.0]))
    assert after(loose) is cut


def test_of_twins_each_goes_on_in_its_own() -> None:
    first = hanging(0.0, 0.05, sag=0.1)
    twin = replace(hanging(0.015, 0.05, sag=0.1), id=2)
    seen = [wire.between(0.0, 1.7) for wire in (first, twin)]
    loose = np.diag([0.004**2] * 5 + [0.0])  # so that one's own and the other's are both near enough
    spans = [*seen, next_span(twin, 0.2), next_span(first, 0.2)]
    ended = ended_where_they_meet([replace(wire, covariance=loose) for wire in spans], CONFIG)
    for one, other in ((0, 3), (1, 2)):
        last = ended[one].points(np.array([ended[one].base.length_m]))
        np.testing.assert_allclose(last, ended[other].points(np.zeros(1)), atol=0.004)


def test_two_pieces_that_run_on_as_one_curve_are_one_wire_and_no_structure() -> None:
    """Whichever of them begins the wire; where their curves disagree they stay two, and meet at nothing."""
    wire = replace(hanging(0.0, 0.05, sag=0.1), covariance=0.001**2 * np.eye(6))
    pieces = [wire.between(0.1, 0.7), wire.between(0.72, 1.8)]
    for both in (pieces, pieces[::-1]):
        (one,) = in_one_piece(both, CONFIG, JOIN)
        ends, true = one.points(np.array([0.0, 1.7])), wire.points(np.array([0.1, 1.8]))
        np.testing.assert_allclose(ends, true, atol=1e-9)
    off = replace(pieces[1], theta=pieces[1].theta + np.array([0, 0.008, 0, 0, 0, 0]))
    assert len(in_one_piece([pieces[0], off], CONFIG, JOIN)) == 2
    for second in (pieces[1], off):
        ended = ended_where_they_meet([pieces[0], second], CONFIG)
        assert ended[0] is pieces[0] and ended[1] is second


def test_wires_of_two_spans_stay_two() -> None:
    first = replace(hanging(0.0, 0.05, sag=0.01), covariance=0.001**2 * np.eye(6))
    spans = [first, next_span(first, 0.0)]
    assert in_one_piece(spans, CONFIG, JOIN) == spans
