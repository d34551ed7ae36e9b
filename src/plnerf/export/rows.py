"""Conductors and clearances as rows, and rows as CSV.

Columns end in their unit (_m, _deg, _c for degrees Celsius).  x, y and z are map coordinates (see
`places.py`).
"""

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from plnerf.export.check import TOLERANCE_M, check_all, check_same
from plnerf.export.crs import Places
from plnerf.scene.files import complete_file
from plnerf.survey.clearance import STATE, Clearances
from plnerf.survey.model import CONDUCTOR, SHIELD, Conductor, Survey

Row = dict[str, str | float | int | None]
"""By column; None is an empty cell."""
DECIMALS = 4


def conductor_rows(survey: Survey, places: Places) -> list[Row]:
    """A row for each conductor: `conductor_properties`, and where its ends and its lowest point are."""
    rows = []
    for conductor in survey.conductors:
        curve = conductor.fit.curve
        ends = _named(places, survey, {"a": curve.a, "b": curve.b, "lowest": curve.lowest})
        rows.append(conductor_properties(conductor, survey) | ends)
    return rows


def conductor_properties(conductor: Conductor, survey: Survey) -> Row:
    """What is known of a conductor, in plain values.

    sag_m: greatest vertical drop below the chord, at `sag_from_a_m` horizontally from A.  p_m: horizontal
    tension / weight per length.  azimuth_deg: from A to B, clockwise from the world's north, its y axis.
    Of a survey without scale, the columns end in _unscaled instead of _m.
    """
    fit, curve = conductor.fit, conductor.fit.curve
    slope = (curve.b[2] - curve.a[2]) / curve.span_m
    row: Row = {
        "id": conductor.id,
        "span": conductor.span,
        "kind": conductor.kind,
        "class_code": CONDUCTOR if conductor.kind == "phase" else SHIELD,
        "state": STATE,
        "temperature_c": survey.temperature_c,
        "sag_m": curve.sag_m,
        "sag_sigma_m": fit.sag_sigma_m,
        "sag_from_a_m": curve.s0_m + curve.p_m * math.asinh(slope),
        "span_m": curve.span_m,
        "length_m": curve.length_m,
        "p_m": curve.p_m,
        "azimuth_deg": math.degrees(math.atan2(*curve.direction)) % 360,
        "residual_across_m": fit.residual_across_m,
        "residual_up_m": fit.residual_up_m,
        "coverage": conductor.coverage,
        "longest_gap_m": conductor.longest_gap_m,
        "evidence": conductor.evidence,
        "source": conductor.source,
        "note": conductor.note,
    }
    return {_unit(name, survey): _plain(value) for name, value in row.items()}


def clearance_rows(survey: Survey, clearances: Clearances, places: Places) -> list[Row]:
    """A row for each place where a conductor comes near to something, with the verdict on it."""
    required, rows = clearances.requirement, []
    for place in clearances.all_places():
        verdict = clearances.verdict(place)
        row: Row = {
            "conductor": place.conductor,
            "span": place.span,
            "kind": place.kind,
            "to": place.to,
            "class_code": place.class_code,
            "measure": place.measure,
            "state": clearances.state,
            "temperature_c": clearances.temperature_c,
            "distance_m": place.distance_m,
            "sigma_m": place.sigma_m,
            "vertical_m": place.vertical_m,
            "s_m": place.s_m,
            "required_m": None if required is None or verdict is None else required.distance_m,
            "required_by": None if required is None or verdict is None else required.name,
            "verdict": verdict,
        }
        ends = _named(places, survey, {"wire": tuple(place.wire), "obstacle": tuple(place.obstacle)})
        rows.append({name: _plain(value) for name, value in row.items()} | ends)
    return rows


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


def _named(places: Places, survey: Survey, points: dict[str, tuple[float, ...]]) -> Row:
    """Columns of the points' map coordinates."""
    at: Float[np.ndarray, "_ 3"] = places.to_map(np.array(list(points.values()), dtype=np.float64))
    return {
        f"{name}_{axis}": _plain(float(value))
        for name, point in zip(points, at, strict=True)
        for axis, value in zip("xyz", point, strict=True)
    }


def _unit(name: str, survey: Survey) -> str:
    return name if survey.unit == "m" or not name.endswith("_m") else name.removesuffix("_m") + "_unscaled"


def _plain(value: Any) -> str | float | int | None:
    """NumPy's numbers as Python's, rounded to a tenth of a millimetre; what is not finite is not known."""
    if not isinstance(value, float):
        return value.item() if isinstance(value, np.integer) else value
    return round(float(value), DECIMALS) if math.isfinite(value) else None
