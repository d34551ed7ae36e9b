"""Wires, structures, clearances and crossings as rows, and rows as CSV.

Columns end in their unit: _m, _deg, _c for degrees Celsius; _95_m is half the width of a length's 95 %
interval.  x, y and z are map coordinates (`crs.py`), and `reference` says what they and their heights refer
to.  What is not known is an empty cell; why a wire has no sag, span length and p is in the column
`no_sag_because`.  Lines, spans, structures and wires are numbered from 1; stations count along each line from
its first structure (`line/stations.py`).
"""

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from plnerf.export.crs import CrsTransform
from plnerf.export.read_back import TOLERANCE_M, check_all, check_same
from plnerf.line.clearances import Clearances
from plnerf.line.cloud import CONDUCTOR, SHIELD
from plnerf.line.ends import Attached, End, Quantity
from plnerf.line.line import Line, Span, Structure
from plnerf.line.stations import Stretch, chains, structure_stations
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.scene.files import complete_file

Row = dict[str, str | float | int | None]
"""By column; None is an empty cell."""
DECIMALS = 4


def wire_rows(survey: Survey, transform: CrsTransform) -> list[Row]:
    """A row for each wire: `wire_properties`, and coordinates of its ends and of its lowest point between
    them, `lowest_in_span`: the catenary's own may lie far outside of the span."""
    rows = []
    for line in survey.lines:
        for span in line.spans:
            for wire in span.wires:
                at = wire.points(np.array([0.0, wire.base.length_m, wire.lowest[0]]))
                named = dict(zip(("a", "b", "lowest_in_span"), at, strict=True))
                properties = wire_properties(survey, line, span, wire, transform)
                rows.append(properties | coordinates(transform, named))
    return rows


def wire_properties(survey: Survey, line: Line, span: Span, wire: Wire, transform: CrsTransform) -> Row:
    """What is known of a wire, as plain values; A is its first end and B its last.

    sag_m: greatest vertical drop below the chord, at `sag_from_a_m` horizontally from A.  p_m: tension across
    the load / load per length.  azimuth_deg: from A to B, clockwise from the world's y axis (north).
    swing_deg: of the load about the base, to the left from A to B where positive; empty where it was held at
    0.  Of an unscaled survey, the columns end in _unscaled instead of _m.
    """
    ends = wire.points(np.array([0.0, wire.base.length_m]))
    a, b = transform.to_world(ends)
    station_a, station_b = stretch_of(line, span).station(ends).tolist()
    swing = wire.swing_deg
    lowest_95 = Quantity(0.0, float(wire.sigma_at(np.array([wire.lowest[0]]))[0, 1])).half_95
    seen = wire.evidence
    row: Row = {
        "line": line.id,
        "span": span.id,
        "id": wire.id,
        "name": wire.name,
        "kind": wire.kind,
        "bundle": wire.bundle,
        "class_code": SHIELD if wire.kind == "shield" else CONDUCTOR,
        "state": _state(survey),
        "temperature_c": survey.temperature_c,
        **_quantity("sag", wire.sag),
        "sag_from_a_m": wire.sag_at_m if wire.sag else None,
        **_quantity("span", wire.span_m),
        **_quantity("length", wire.arc_m),
        **_quantity("p", wire.p_m),
        "no_sag_because": wire.open,
        "end_a": _held_by(wire.ends[0]),
        "end_b": _held_by(wire.ends[1]),
        "structure_a": _structure_at(wire.ends[0]),
        "structure_b": _structure_at(wire.ends[1]),
        "station_a_m": station_a,
        "station_b_m": station_b,
        "azimuth_deg": math.degrees(math.atan2(b[0] - a[0], b[1] - a[1])) % 360,
        "swing_deg": swing.value if swing else None,
        "swing_95_deg": swing.half_95 if swing else None,
        "lowest_in_span_95_m": lowest_95,
        "residual_across_m": seen.residual_across_m,
        "residual_up_m": seen.residual_up_m,
        "coverage": seen.coverage,
        "longest_gap_m": seen.longest_gap_m,
        "evidence": seen.source,
        "evidence_count": seen.count,
        "notes": " ".join(wire.notes) or None,
    }
    return {_unit(name, survey): value for name, value in plain_row(row).items()}


def clearance_rows(survey: Survey, transform: CrsTransform) -> list[Row]:
    """A row for each place where a wire comes near to something, with the verdict on it."""
    clearances = survey.clearances or Clearances(())
    along = {
        wire.id: (line, one)
        for line in survey.lines
        for chain in chains(line)
        for one in chain
        for wire in one.span.wires
    }
    rows = []
    for place in clearances.all_places():
        line, stretch = along[place.wire]
        verdict = clearances.verdict(place)
        required = clearances.requirement if verdict else None
        row: Row = {
            "line": line.id,
            "span": place.span,
            "wire": place.wire,
            "kind": place.kind,
            "to": place.to,
            "class_code": place.class_code,
            "measure": place.measure,
            "state": clearances.state,
            "temperature_c": survey.temperature_c,
            **_quantity("distance", Quantity(place.distance_m, place.sigma_m)),
            "at_most": place.at_most,
            "air_seen": place.air_seen,
            "hidden_m": place.hidden_m if place.at_most else None,
            "vertical_m": place.vertical_m,
            "s_m": place.s_m,
            "station_m": float(stretch.station(place.on_wire[None])[0]),
            "required_m": required.distance_m if required else None,
            "required_by": required.name if required else None,
            "verdict": verdict,
        }
        ends = coordinates(transform, {"on_wire": place.on_wire, "on_obstacle": place.on_obstacle})
        rows.append(plain_row(row) | ends)
    return rows


def structure_rows(survey: Survey, transform: CrsTransform) -> list[Row]:
    """A row for each structure: `structure_properties`, and coordinates of its foot and its top."""
    return [
        structure_properties(survey, line, one) | coordinates(transform, {"foot": one.foot, "top": one.top})
        for line in survey.lines
        for one in line.structures
    ]


def structure_properties(survey: Survey, line: Line, one: Structure) -> Row:
    """What is known of a structure.  line_angle_deg: by how much the line turns there."""
    row: Row = {
        "line": line.id,
        "structure": one.id,
        "name": one.name,
        "kind": one.kind,
        "station_m": structure_stations(line).get(one.id),
        "line_angle_deg": one.line_angle_deg,
        "height_m": one.height_m,
        "along_95_m": Quantity(0.0, one.sigma_m).half_95,
        "evidence": one.evidence,
    }
    return {_unit(name, survey): value for name, value in plain_row(row).items()}


def crossing_rows(survey: Survey, transform: CrsTransform) -> list[Row]:
    """A row for each pair of wires of two lines that cross, the nearest to each other first."""
    of = {wire.id: (line.id, span.id) for line in survey.lines for span in line.spans for wire in span.wires}
    rows = []
    for one in survey.clearances.crossings if survey.clearances is not None else ():
        (line_above, span_above), (line_below, span_below) = of[one.upper], of[one.lower]
        row: Row = {
            "line_above": line_above,
            "span_above": span_above,
            "wire_above": one.upper,
            "line_below": line_below,
            "span_below": span_below,
            "wire_below": one.lower,
            "state": _state(survey),
            **_quantity("distance", Quantity(one.distance_m, one.sigma_m)),
            "vertical_m": one.vertical_m,
            "s_above_m": one.s_upper_m,
            "s_below_m": one.s_lower_m,
        }
        ends = coordinates(transform, {"on_above": one.on_upper, "on_below": one.on_lower})
        rows.append(plain_row(row) | ends)
    return rows


def stretch_of(line: Line, span: Span) -> Stretch:
    """Where a span lies along its line."""
    return next(one for chain in chains(line) for one in chain if one.span is span)


def write_csv(path: Path, rows: Sequence[Row], columns: Sequence[str]) -> None:
    """Writes rows and reads them back.  Raises SurveyError where they differ."""
    with complete_file(path) as beside:
        with beside.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, columns, lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
        with beside.open(encoding="utf-8", newline="") as file:
            reader = csv.DictReader(file)
            found = list(reader)
        check_same(path, list(columns), list(reader.fieldnames or ()), "the columns")
        check_same(path, len(rows), len(found), "the number of rows")
        for row, cells in zip(rows, found, strict=True):
            for name, value in row.items():
                if isinstance(value, float):
                    close = cells[name] != "" and abs(float(cells[name]) - value) <= TOLERANCE_M
                    check_all(path, close, f"numbers of the column {name!r}")
                else:
                    check_same(path, "" if value is None else str(value), cells[name], f"a cell of {name!r}")


def _quantity(name: str, one: Quantity | None) -> Row:
    """Columns of a length and of half the width of its 95 % interval."""
    return {f"{name}_m": one.value if one else None, f"{name}_95_m": one.half_95 if one else None}


def _held_by(end: End) -> str:
    return f"structure {end.structure}" if isinstance(end, Attached) else f"open: {end.reason}"


def _structure_at(end: End) -> int | None:
    return end.structure if isinstance(end, Attached) else None


def _state(survey: Survey) -> str:
    return (survey.clearances or Clearances(())).state


def coordinates(transform: CrsTransform, points: dict[str, Float[np.ndarray, "3"]]) -> Row:
    """Columns of the points' map coordinates."""
    at = transform.to_map(np.array(list(points.values()), dtype=np.float64))
    named: Row = {
        f"{name}_{axis}": _plain(float(value))
        for name, point in zip(points, at, strict=True)
        for axis, value in zip("xyz", point, strict=True)
    }
    return named | {"reference": transform.reference}


def _unit(name: str, survey: Survey) -> str:
    if survey.frame.unit == "m" or not name.endswith("_m"):
        return name
    return name.removesuffix("_m") + "_unscaled"


def plain_row(row: Row) -> Row:
    """NumPy's numbers as Python's, rounded to a tenth of a millimetre; what is not finite is not known."""
    return {name: _plain(value) for name, value in row.items()}


def _plain(value: Any) -> str | float | int | None:
    if not isinstance(value, float):
        return value.item() if isinstance(value, np.integer) else value
    return round(float(value), DECIMALS) if math.isfinite(value) else None
