"""Stations are counted along a line from structure to structure, whichever way its wires run."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support import surveys
from tests.support.many_spans import FEET, FRAME, PHASES, bent, line_along

from plnerf.line.base import Base
from plnerf.line.ends import Open
from plnerf.line.line import Line, Span
from plnerf.line.stations import azimuth_deg, chains, structure_stations
from plnerf.line.wire import Wire

LENGTHS = np.linalg.norm(np.diff(FEET, axis=0), axis=1)
LINE = line_along(FEET, PHASES)


def turned(wire: Wire) -> Wire:
    """The same curve, counted from its other end."""
    theta = wire.theta[[1, 0, 3, 2, 4, 5]] * [-1, -1, 1, 1, 1, -1]
    return replace(wire, base=Base(wire.base.b, wire.base.a), theta=theta, ends=wire.ends[::-1])


def backwards(span: Span) -> Span:
    first, last = span.structures
    return replace(span, structures=(last, first), wires=tuple(turned(wire) for wire in span.wires))


def test_stations_are_lengths_from_structure_to_structure() -> None:
    (chain,) = chains(LINE)
    assert [one.span.id for one in chain] == [1, 2, 3] and chain[0].from_m == 0
    assert [one.to_m for one in chain] == pytest.approx(np.cumsum(LENGTHS))
    assert list(structure_stations(LINE).values()) == pytest.approx([0, *np.cumsum(LENGTHS)])
    assert list(structure_stations(LINE)) == [1, 2, 3, 4]
    middle = np.array([[*(np.array(FEET[1]) + FEET[2]) / 2, 9.0]])
    assert chain[1].station(middle) == pytest.approx([LENGTHS[0] + LENGTHS[1] / 2])


@pytest.mark.parametrize("which", [(0,), (1,), (2,), (0, 1), (0, 1, 2)])
def test_wires_that_run_against_their_chain_change_nothing(which: tuple[int, ...]) -> None:
    spans = tuple(backwards(span) if k in which else span for k, span in enumerate(LINE.spans))
    (chain,) = chains(replace(LINE, spans=spans))
    (same,) = chains(LINE)
    assert [one.held for one in chain] == [(1, 2), (2, 3), (3, 4)]
    for one, other in zip(chain, same, strict=True):
        assert (
            np.abs(one.base.a - other.base.a).max() < 1e-9 and np.abs(one.base.b - other.base.b).max() < 1e-9
        )
        points = one.span.wires[0].polyline()
        assert np.abs(one.station(points) - other.station(points)).max() < 1e-9


def test_an_open_end_lies_where_the_wires_end() -> None:
    line = bent().lines[0]
    (chain,) = chains(line)
    last = chain[-1]
    assert last.held == (3, None) and 0.7 * LENGTHS[2] - 3 < last.base.length_m < 0.7 * LENGTHS[2] + 3
    ends = np.concatenate([wire.points(np.array([wire.base.length_m])) for wire in last.span.wires])
    assert last.station(ends).max() == pytest.approx(last.to_m)
    first = replace(line, spans=(backwards(last.span),))
    assert chains(first)[0][0].held == (None, 3) and chains(first)[0][0].base.length_m == pytest.approx(
        last.base.length_m
    )
    loose = replace(last.span, structures=(None, None), wires=tuple(
        replace(wire, ends=(Open("hidden"), Open("hidden"))) for wire in last.span.wires
    ))  # fmt: skip
    ((alone,),) = chains(replace(line, spans=(loose,)))
    points = np.concatenate([wire.polyline() for wire in loose.wires])
    assert alone.from_m == 0
    assert [alone.station(points).min(), alone.station(points).max()] == pytest.approx([0, alone.to_m])


def test_spans_that_share_nothing_and_branches_are_chains_of_their_own() -> None:
    apart = tuple(replace(span, structures=(None, None)) for span in LINE.spans)
    assert [len(chain) for chain in chains(replace(LINE, spans=apart))] == [1, 1, 1]
    branch = Span(4, (2, None), LINE.spans[2].wires)
    found = chains(replace(LINE, spans=(*LINE.spans, branch)))
    assert [[one.span.id for one in chain] for chain in found] == [[1, 2, 3], [4]]
    assert chains(Line(1, (), ())) == () and chains(replace(LINE, spans=(Span(1, (1, 2), ()),))) == ()


def test_azimuths_are_those_of_the_world() -> None:
    u = FRAME.R_line_world.T @ [*chains(LINE)[0][0].base.u, 0.0]
    assert azimuth_deg(FRAME, chains(LINE)[0][0].base) == pytest.approx(
        np.degrees(np.arctan2(u[0], u[1])) % 360
    )
    survey = surveys.long(0.05)
    (chain,) = chains(survey.lines[0])
    assert azimuth_deg(survey.frame, chain[0].base) == pytest.approx(
        np.degrees(np.arctan2(441.0 - 145.2, 139.5 - 17.7)), abs=0.05
    )
