"""The table of other states, and their curves in the profile."""

from collections.abc import Sequence
from dataclasses import replace
from html import escape

import numpy as np

from plnerf.line.ends import Quantity
from plnerf.line.states import Load, State, WireState
from plnerf.line.stations import Stretch
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.report.colours import KINDS
from plnerf.report.figures import CERTAIN, MINUS, NOTHING, Units, share
from plnerf.report.shown import units_of
from plnerf.report.side import LEFT, Scale
from plnerf.report.tables import Table
from plnerf.report.words import numbers_of_spans, span_head

STATE_DASHES = ("2 3", "8 3 2 3", "12 4", "1 5", "5 2 1 2 1 2")
"""Of the states' curves, in the order of the states; with more they begin anew.  Winds from both sides, in
which wires hang alike from the side, share one."""


SAMPLE_PX, ROW_PX, LETTER_PX = 34, 18, 7.0
"""Of the legend: length of a sample, height of a row, width of a letter."""


def state_tables(survey: Survey) -> list[Table]:
    """A table for each state, a row for each wire; none where no state was computed."""
    if survey.states is None:
        return []
    return [_table(survey, one) for one in survey.states.states if one.wires]


def _table(survey: Survey, state: State) -> Table:
    units, span = units_of(survey), numbers_of_spans(survey)
    wires = {wire.id: wire for wire in survey.wires}
    blown = bool(state.load.wind_pa)
    rows = [
        [
            str(one.wire), span[one.wire], wires[one.wire].kind,
            units.interval(wires[one.wire].sag), units.interval(one.sag),
            units.interval(one.sag_change), _kn(one.horizontal_n), _kn(one.greatest_n),
            NOTHING if one.strength_share is None else share(one.strength_share),
            *[_blown(one, wires[one.wire], units)] * blown, units.length(one.ruling_span_m, 1),
        ]
        for one in state.wires
    ]  # fmt: skip
    return Table(
        ["wire", span_head(survey), "kind", *units.heads_95("sag as surveyed", "sag in this state", "change"),
         f"horizontal tension,\u00a0kN ±\u00a0{CERTAIN}", f"greatest tension,\u00a0kN ±\u00a0{CERTAIN}",
         "of rated strength", *units.heads("blown out") * blown, *units.heads("ruling span")],
        rows,
        f"{_named(state.load)}. Sag: the greatest vertical drop below the chord. Ruling span: that of the "
        "wire's spans from one strain structure to the next, as far as they were surveyed."
        + " Blown out: how far the wire is aside of its chord, seen from above." * blown,
        frozenset({2}),
    )  # fmt: skip


def _named(load: Load) -> str:
    """A state's name, and the load where the name does not state it."""
    return load.name if load.name == load.words else f"{load.name}: {load.words}"


def _kn(one: Quantity) -> str:
    return f"{one.value / 1e3:,.1f}\u202f±\u202f{one.half_95 / 1e3:,.1f}".replace("-", MINUS)


def _blown(one: WireState, wire: Wire, units: Units) -> str:
    y = one.of(wire).at(np.linspace(0.0, wire.base.length_m, 41))[:, 0]
    return units.length(float(np.abs(y - np.linspace(y[0], y[-1], 41)).max()))


def state_curves(scale: Scale, survey: Survey, of_wire: dict[int, Stretch]) -> list[str]:
    """The wires of a drawing in each state, thin and dashed; named by their hover text."""
    parts = []
    wires = {wire.id: wire for wire in survey.wires}
    for state, dashes in _dashed(survey):
        for one in (one for one in state.wires if one.wire in of_wire):
            wire = wires[one.wire]
            points = one.of(wire).points(np.linspace(0.0, wire.base.length_m, 61))
            path = scale.path(of_wire[one.wire].station(points), points[:, 2])
            parts.append(
                f'<polyline class="state" points="{path}" fill="none" stroke="{KINDS[wire.kind][1]}" '
                f'stroke-width="1" stroke-dasharray="{dashes}">'
                f"<title>wire {wire.id}, {escape(state.load.name)}</title></polyline>"
            )
    return parts


def state_heights(survey: Survey, of_wire: dict[int, Stretch]) -> list[np.ndarray]:
    """Heights of the curves, which a drawing must hold."""
    wires = {wire.id: wire for wire in survey.wires}
    return [
        one.of(wires[one.wire]).points(np.linspace(0.0, wires[one.wire].base.length_m, 21))[:, 2]
        for state in _states(survey)
        for one in state.wires
        if one.wire in of_wire
    ]


def state_legend(survey: Survey, width: float, top: float) -> tuple[list[str], float]:
    """Each state's dashes and its name, in rows of a width from y = top down, and the rows' height."""
    named: dict[str, list[str]] = {}
    for state, dashes in _dashed(survey):
        if state.wires:
            named.setdefault(dashes, []).append(state.load.name)
    parts: list[str] = []
    x, y = float(LEFT), top + 0.7 * ROW_PX
    for dashes, names in named.items():
        name = " / ".join(names)
        end = x + SAMPLE_PX + 8 + LETTER_PX * len(name)
        if x > LEFT and end > LEFT + width:
            x, y, end = float(LEFT), y + ROW_PX, LEFT + end - x
        parts.append(
            f'<line x1="{x:.1f}" x2="{x + SAMPLE_PX:.1f}" y1="{y:.1f}" y2="{y:.1f}" class="axis" '
            f'stroke-dasharray="{dashes}"/>'
            f'<text x="{x + SAMPLE_PX + 6:.1f}" y="{y:.1f}" dy="4">{escape(name)}</text>'
        )
        x = end + 16
    return parts, y + 0.5 * ROW_PX - top if parts else 0.0


def _dashed(survey: Survey) -> list[tuple[State, str]]:
    """The states with their dashes."""
    seen: list[Load] = []
    found = []
    for state in _states(survey):
        alike = replace(state.load, name="", wind_pa=abs(state.load.wind_pa))
        seen += [alike] * (alike not in seen)
        found.append((state, STATE_DASHES[seen.index(alike) % len(STATE_DASHES)]))
    return found


def _states(survey: Survey) -> Sequence[State]:
    return survey.states.states if survey.states is not None else ()
