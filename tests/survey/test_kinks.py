"""Where curves alone show what holds them, and that the stated deviations hold."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support.hung_lines import ARMS, attachments, detected, true_spans

from plnerf.line.hang import hang
from plnerf.line.wire import Wire
from plnerf.survey.chains import meeting
from plnerf.survey.config_spans import ChainConfig, KinkConfig
from plnerf.survey.kinks import find_kinks, held_by
from plnerf.survey.span_wires import Junction, span_of

CONFIG = KinkConfig()


def bend(degrees: float) -> np.ndarray:
    """Feet of two spans."""
    turn = np.radians(degrees)
    return np.array([[-40.0, 0.0], [0.0, 0.0], [45 * np.cos(turn), 45 * np.sin(turn)]])


def junction_of(
    spans: list[list[Wire]], random: np.random.Generator | None, beyond: tuple[float, float] = (2.0, -1.0)
) -> Junction:
    """Of two spans as they are detected, the first ending so far beyond the structure, the second before."""
    before = span_of([detected(wire, random, (0.0, beyond[0])) for wire in spans[0]])
    after = span_of([detected(wire, random, (beyond[1], 0.0)) for wire in spans[1]])
    return meeting(before, after, ChainConfig())


@pytest.mark.parametrize("degrees", [0.0, 20.0, -50.0])
@pytest.mark.parametrize("beyond", [(4.0, 4.0), (2.0, -1.0), (-2.0, -2.0)])
def test_exact_curves_meet_where_they_are_held(degrees: float, beyond: tuple[float, float]) -> None:
    held = attachments(bend(degrees))
    junction = junction_of(true_spans(held), None, beyond)
    kinks = find_kinks(junction, CONFIG)
    assert [kink.pair for kink in kinks] == [(k, k) for k in range(4)]
    for kink in kinks:
        np.testing.assert_allclose(kink.point, held[1, kink.pair[0]], atol=1e-6)
        assert kink.gap_m < 1e-6 and kink.drop > 0.15
    together = held_by(kinks, junction.axis, None, CONFIG)
    assert together is not None and together.agreeing == 4
    assert junction.axis.place(np.array([together.t]), np.zeros((1, 2)))[0, :2] @ junction.axis.u == (
        pytest.approx(0.0, abs=1e-6)
    )


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [0.0, 30.0])
def test_stated_deviations_hold(degrees: float) -> None:
    """Over 30 draws of the errors of curves and of attachments along the line, four wires each."""
    random, off, of_structure, own = np.random.default_rng(1), [], [], []
    for _ in range(30):
        along = np.zeros((3, len(ARMS)))
        along[1] = random.normal(0, CONFIG.arms_m, len(ARMS))
        held = attachments(bend(degrees), along=along)
        junction = junction_of(true_spans(held), random)
        kinks = find_kinks(junction, CONFIG)
        assert len(kinks) == 4
        true = junction.axis.local(held[1])[:, 0]
        for kink in kinks:
            t, sigma = kink.along(junction.axis)
            off.append((t - true[kink.pair[0]]) / sigma)
        together = held_by(kinks, junction.axis, None, CONFIG)
        assert together is not None and together.sigma < 0.15
        of_structure.append(
            (together.t - float(junction.axis.local(np.zeros((1, 3)))[0, 0])) / together.sigma
        )
        own += [(t - true[i]) / sigma for (i, _), (t, sigma) in together.own.items()]
    for errors in (off, of_structure, own):
        inside = float((np.abs(errors) <= 1.96).mean())
        assert inside >= 0.9 and np.abs(errors).max() < 4.5
    # And are not far too large.
    assert np.std(off) > 0.6 and np.std(own) > 0.6 and np.std(of_structure) > 0.5


def test_wires_of_one_structure_keep_their_own_places() -> None:
    along = np.zeros((3, len(ARMS)))
    along[1] = [0.25, 0.0, -0.25, 0.0]
    held = attachments(bend(0.0), along=along)
    junction = junction_of(true_spans(held), None)
    sharp = [
        replace(span, wires=tuple(replace(wire, covariance=wire.covariance / 16) for wire in span.wires))
        for span in (junction.before, junction.after)
        if span is not None
    ]
    junction = replace(junction, before=sharp[0], after=sharp[1])
    together = held_by(find_kinks(junction, CONFIG), junction.axis, None, CONFIG)
    assert together is not None
    true = junction.axis.local(held[1])[:, 0]
    for (i, _), (t, sigma) in together.own.items():
        assert abs(t - true[i]) < 0.06 and sigma < 0.07
    assert together.t == pytest.approx(true.mean(), abs=0.03)


def test_a_wire_that_goes_on_unheld_has_no_kink() -> None:
    whole = hang((-40.0, 0.0, 18.0), (45.0, 0.0, 18.0), 3.0)
    random = np.random.default_rng(2)
    for _ in range(20):
        known = [detected(whole, random) for _ in range(2)]
        before = span_of([known[0].between(0.0, 41.0)])
        after = span_of([known[1].between(39.0, 85.0)])
        junction = meeting(before, after, ChainConfig())
        assert junction.pairs == ((0, 0),)
        assert find_kinks(junction, CONFIG) == ()


def test_what_pulls_a_wire_down_is_no_support() -> None:
    a, low, b = (-40.0, 0.0, 30.0), (0.0, 0.0, 18.0), (45.0, 0.0, 30.0)
    junction = junction_of([[hang(a, low, 0.3)], [hang(low, b, 0.3)]], None)
    assert junction.pairs and find_kinks(junction, CONFIG) == ()


def test_a_kink_far_from_the_others_does_not_count() -> None:
    held = attachments(bend(0.0))
    spans = true_spans(held)
    off = held[1, 0] + [0.9, 0.0, 0.1]
    spans[0][0] = hang(held[0, 0], off, 1.2)
    spans[1][0] = hang(off, held[2, 0], 1.35)
    junction = junction_of(spans, None)
    kinks = find_kinks(junction, CONFIG)
    together = held_by(kinks, junction.axis, None, CONFIG)
    assert len(kinks) == 4 and together is not None and together.agreeing == 3
    zero = float(junction.axis.local(np.zeros((1, 3)))[0, 0])
    assert together.t == pytest.approx(zero, abs=0.01)
    assert together.own[0, 0][0] == pytest.approx(zero, abs=0.01)
    assert together.own[0, 0][1] >= CONFIG.arms_m


@pytest.mark.parametrize(("before_m", "after_m", "counts"), [
    (0.0, 0.0, True), (4.0, 2.0, True), (2.0, 4.0, True), (4.0, 4.0, False),
])  # fmt: skip
def test_a_kink_alone_is_seen_on_one_side_at_least(before_m: float, after_m: float, counts: bool) -> None:
    """before_m, after_m: from the kink to where images show the wires."""
    spans = [[wires[0]] for wires in true_spans(attachments(bend(20.0)))]
    junction = junction_of(spans, None, (4.0, 4.0))
    seen = []
    for span, last, off_m in ((junction.before, True, before_m), (junction.after, False, after_m)):
        assert span is not None
        (wire,) = span.wires
        (kink,) = find_kinks(junction, CONFIG)
        s = float(wire.base.local(kink.point[None])[0, 0])
        stretch = ((0.0, s - off_m),) if last else ((s + off_m, wire.base.length_m),)
        evidence = replace(wire.evidence, seen_m=stretch)
        seen.append(replace(span, wires=(replace(wire, evidence=evidence),)))
    junction = replace(junction, before=seen[0], after=seen[1])
    kinks = find_kinks(junction, CONFIG)
    assert [kink.unseen_m for kink in kinks] == [pytest.approx(min(before_m, after_m), abs=1e-6)]
    assert (held_by(kinks, junction.axis, None, CONFIG) is not None) == counts
    assert held_by(kinks, junction.axis, (kinks[0].along(junction.axis)[0], 0.1), CONFIG) is not None


def moved(junction: Junction, sideways: float, upwards: float) -> Junction:
    """With all curves after it elsewhere."""
    assert junction.after is not None
    by = np.array([sideways, sideways, upwards, upwards, 0, 0])
    wires = tuple(replace(wire, theta=wire.theta + by) for wire in junction.after.wires)
    return replace(junction, after=replace(junction.after, wires=wires))


def test_curves_that_miss_each_other_state_more() -> None:
    """Where the line does not bend, they miss each other in plan."""
    junction = junction_of(true_spans(attachments(bend(0.0))), None)
    (first, *_) = find_kinks(junction, CONFIG)
    (missed, *_) = find_kinks(moved(junction, 0.1, 0.0), CONFIG)
    assert missed.gap_m > 0.05
    assert missed.along(junction.axis)[1] > 2 * first.along(junction.axis)[1]


def test_where_the_line_bends_heights_do_not_move_what_plan_shows() -> None:
    """Tension strings hang otherwise than the wires would go on."""
    junction = junction_of(true_spans(attachments(bend(18.0))), None)
    raised = find_kinks(moved(junction, 0.0, 0.05), CONFIG)
    assert len(raised) == 4
    for kink, one in zip(find_kinks(junction, CONFIG), raised, strict=True):
        assert one.along(junction.axis) == pytest.approx(kink.along(junction.axis), abs=0.004)


def test_what_else_shows_the_place_takes_part_by_its_deviation() -> None:
    junction = junction_of(true_spans(attachments(bend(0.0))), None)
    kinks = find_kinks(junction, CONFIG)
    alone = held_by(kinks, junction.axis, None, CONFIG)
    assert alone is not None
    vague = held_by(kinks, junction.axis, (alone.t + 0.1, 0.3), CONFIG)
    sharp = held_by(kinks, junction.axis, (alone.t + 0.1, 0.02), CONFIG)
    assert vague is not None and sharp is not None
    assert alone.t < vague.t < alone.t + 0.02 and vague.sigma < alone.sigma
    assert alone.t + 0.08 < sharp.t < alone.t + 0.1
    assert held_by((), junction.axis, (0.0, 0.1), CONFIG) is None
