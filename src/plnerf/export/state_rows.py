"""Other states of the wires as rows of a table (`rows.py` has the rules of columns)."""

import math

from plnerf.export.rows import Row, plain_row
from plnerf.line.ends import Quantity
from plnerf.line.survey import Survey

STATES = "states.csv"


def state_rows(survey: Survey) -> list[Row]:
    """A row for each state and wire.

    sag_change_m: sag in the state less that of the survey.  Tensions in newtons: horizontal, and the
    greatest, at the higher attachment; strength_share: the latter over the conductor's rated strength.
    p_m and swing_deg give the curve between the attachments of `conductors.csv`; swing to the left from A to
    B where positive.
    """
    if survey.states is None:
        return []
    of = {
        wire.id: (line.id, span.id, wire)
        for line in survey.lines
        for span in line.spans
        for wire in span.wires
    }
    rows: list[Row] = []
    for state in survey.states.states:
        for one in state.wires:
            line, span, wire = of[one.wire]
            load = state.load
            row: Row = {
                "state": load.name,
                "temperature_c": load.temperature_c,
                "wind_pa": load.wind_pa,
                "ice_mm": load.ice_mm,
                "ice_kg_m3": load.ice_kg_m3,
                "line": line,
                "span": span,
                "wire": one.wire,
                "kind": wire.kind,
                **_columns("sag", "m", one.sag),
                **_columns("sag_change", "m", one.sag_change),
                **_columns("horizontal", "n", one.horizontal_n),
                **_columns("greatest", "n", one.greatest_n),
                "strength_share": one.strength_share,
                "p_m": one.of(wire).plane[2],
                "swing_deg": math.degrees(one.theta[5]),
                "ruling_span_m": one.ruling_span_m,
                "temperature_then_c": survey.states.temperature_c.value,
                "temperature_then_95_c": survey.states.temperature_c.half_95,
            }
            rows.append(plain_row(row))
    return rows


def _columns(name: str, unit: str, one: Quantity) -> Row:
    return {f"{name}_{unit}": one.value, f"{name}_95_{unit}": one.half_95}
