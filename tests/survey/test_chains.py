"""Wires become spans, and spans lines, whatever their directions and their order."""

import numpy as np
import pytest
from tests.support.hung_lines import ARMS, attachments, detected, rotated, true_spans, turned_by

from plnerf.line.base import Base
from plnerf.line.wire import Wire
from plnerf.survey.chains import find_chains, junctions, wires_of, with_wires
from plnerf.survey.config_spans import ChainConfig
from plnerf.survey.span_wires import crossing, span_of, turned

CONFIG = ChainConfig()
FEET = np.array([[0.0, 0.0], [40.0, 0.0], [85.0, 0.0], [125.0, 14.56]])
"""A line that runs straight on and then turns by 20 degrees."""


def shuffled(spans: list[list[Wire]], seed: int = 0, beyond: float = 3.0) -> list[Wire]:
    """Their wires as detected, in any order and in either direction."""
    random = np.random.default_rng(seed)
    wires = [detected(wire, random, tuple(random.uniform(-2, beyond, 2))) for span in spans for wire in span]
    order = random.permutation(len(wires))
    return [turned(wires[k]) if random.random() < 0.5 else wires[k] for k in order]


@pytest.mark.parametrize("degrees", [0.0, 37.0, 90.0, 200.0])
def test_wires_of_three_spans_make_one_line(degrees: float) -> None:
    R = turned_by(degrees)
    held = attachments(FEET)
    found = find_chains([rotated(wire, R) for wire in shuffled(true_spans(held))], CONFIG)
    assert [[len(span.wires) for span in chain] for chain in found] == [[4, 4, 4]]
    (chain,) = found
    run = chain[-1].base.b - chain[0].base.a
    assert run[0] > 0  # from the west
    forwards = float(run @ (R[:2, :2] @ (FEET[-1] - FEET[0]))) > 0
    at = junctions(chain, CONFIG)
    assert [len(one.pairs) for one in at] == [0, 4, 4, 0]
    bends = [one.bend_deg for one in at]
    assert bends[0] is None and bends[-1] is None
    assert bends[1:-1] == pytest.approx([0.0, 20.0] if forwards else [20.0, 0.0], abs=0.1)
    for junction in at[1:-1]:
        for i, j in junction.pairs:  # of one conductor
            before, after = (side[k] for side, k in zip(junction.sides, (i, j), strict=True))
            points = [
                wire.points(crossing(wire, junction.axis, np.array([junction.meet_m])))[0]
                for wire in (before, after)
            ]
            assert np.linalg.norm(points[0] - points[1]) < 0.2


def test_a_line_that_crosses_is_another_line() -> None:
    low = [(-1.0, 12.0), (1.0, 12.0)]
    across = true_spans(attachments(np.array([[50.0, -40.0], [70.0, 40.0]]), low))
    found = find_chains(shuffled([*true_spans(attachments(FEET)), *across]), CONFIG)
    assert [[len(span.wires) for span in chain] for chain in found] == [[4, 4, 4], [2]]


def test_lines_side_by_side_are_two_unless_their_ends_are_level() -> None:
    one, other = np.array([[0.0, 0.0], [60.0, 0.0]]), np.array([[25.0, 20.0], [95.0, 20.0]])
    apart = [*true_spans(attachments(one)), *true_spans(attachments(other))]
    assert len(find_chains(shuffled(apart), CONFIG)) == 2
    wide = true_spans(attachments(one, [(-9.0, 18.0), (9.0, 18.0)]))
    assert len(find_chains(shuffled(wide), CONFIG)) == 1


@pytest.mark.parametrize(("bend", "lines"), [(58.0, 1), (75.0, 2)])
def test_lines_turn_by_up_to_sixty_degrees(bend: float, lines: int) -> None:
    turn = np.radians(bend)
    feet = np.array([[0.0, 0.0], [50.0, 0.0], [50.0 + 50 * np.cos(turn), 50 * np.sin(turn)]])
    found = find_chains(
        shuffled(true_spans(attachments(feet, [(-1.5, 10.0), (1.5, 10.0)])), beyond=1), CONFIG
    )
    assert len(found) == lines


def test_a_piece_across_a_structure_joins_no_two_spans() -> None:
    spans = true_spans(attachments(FEET[:3]))
    piece = spans[0][0].between(36.0, 44.0)
    found = find_chains([*shuffled(spans), detected(piece, None)], CONFIG)
    assert [sorted(len(span.wires) for span in chain) for chain in found] == [[4, 5]]


@pytest.mark.parametrize(("strings_m", "chains"), [(0.9, 1), (4.0, 2)])
def test_first_metres_of_a_next_span_go_on_beyond_tension_strings(strings_m: float, chains: int) -> None:
    """Of 2.6 m beyond a structure, 0.3 of their length would end between strings of a metre."""
    feet = np.array([[0.0, 0.0], [45.0, 0.0], [88.0, 12.0]])
    before, after = true_spans(attachments(feet, [(-1.5, 10.0), (1.5, 10.0), (0.5, 12.0)]))
    whole = [detected(wire.between(0.0, wire.base.length_m - strings_m), None) for wire in before]
    first = [detected(wire.between(strings_m, strings_m + 2.6), None) for wire in after]
    assert len(find_chains([*whole, *first], CONFIG)) == chains


def test_a_ring_of_spans_has_an_end() -> None:
    angle = np.radians(np.arange(0, 361, 45))
    feet = 60 * np.stack([np.cos(angle), np.sin(angle)], 1)
    inner = attachments(feet, ARMS[:3])
    inner[-1] = inner[0]
    (chain,) = find_chains(shuffled(true_spans(inner), beyond=0.5), CONFIG)
    assert len(chain) == 8 and all(len(span.wires) == 3 for span in chain)


def test_a_turned_wire_is_the_same_curve() -> None:
    (wire,) = (
        detected(one, np.random.default_rng(0)) for one in true_spans(attachments(FEET[2:], [(1.0, 10.0)]))[0]
    )
    theta = wire.theta + np.array([0, 0, 0, 0, 0, 0.1])
    wire = Wire(1, wire.base, theta, np.diag(np.arange(1, 7) * 1e-4), wire.ends, wire.evidence)
    other, s = turned(wire), np.linspace(0, wire.base.length_m, 7)
    np.testing.assert_allclose(other.points(wire.base.length_m - s), wire.points(s), atol=1e-12)
    np.testing.assert_allclose(other.sigma_at(wire.base.length_m - s), wire.sigma_at(s), rtol=1e-6)
    again = turned(other)
    np.testing.assert_allclose(again.theta, wire.theta)
    np.testing.assert_allclose(again.covariance, wire.covariance)


def test_wires_of_a_span_lie_on_one_straight_line_and_keep_their_curves() -> None:
    wires = shuffled(true_spans(attachments(FEET))[2:])
    span = span_of(wires)
    assert len(span.wires) == 4
    for own in span.wires:
        assert abs(span.base.local(np.append(own.base.a, 0.0)[None])[0, 1]) < 1e-9
        points = own.points(np.linspace(0, own.base.length_m, 9))
        near = min(np.abs(wire.points(wire.base.local(points)[:, 0]) - points).max() for wire in wires)
        assert near < 1e-6
    chains = ((span,),)
    (again,) = with_wires(chains, wires_of(chains))[0]
    assert isinstance(again.base, Base) and again.base.length_m == pytest.approx(span.base.length_m)


@pytest.mark.parametrize("turn_deg", [-2.0, 1.0])
def test_a_span_lies_along_its_wires_whatever_direction_they_were_searched_in(turn_deg: float) -> None:
    wires = true_spans(attachments(FEET))[2]
    R = turned_by(turn_deg)[:2, :2]
    searched = [wire.on(Base(wire.base.a, wire.base.a + R @ (wire.base.b - wire.base.a))) for wire in wires]
    assert all(abs(one.base.u @ wire.base.n) > 0.01 for one, wire in zip(searched, wires, strict=True))
    assert abs(span_of(searched).base.u @ span_of(wires).base.n) < 1e-4
