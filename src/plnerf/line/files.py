"""Wires and surveys as JSON: the only place where their files are written and read.

All coordinates are of the LineFrame, which the file holds; lengths in the unit that it names.  What does not
exist is null, with the reason beside it.  A file is complete or absent.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from plnerf.errors import SurveyError
from plnerf.findings import Finding
from plnerf.line.base import Base
from plnerf.line.clearances import (
    GROUPS,
    Clearances,
    Crossing,
    Place,
    Possible,
    Profile,
    Requirement,
    WireClearance,
)
from plnerf.line.cloud import Cloud
from plnerf.line.coverage import Coverage
from plnerf.line.encroachments_json import encroachments_of, encroachments_row
from plnerf.line.ends import Attached, End, Evidence, Open, Quantity
from plnerf.line.frame import LineFrame
from plnerf.line.line import Line, Span, Structure
from plnerf.line.phases import InsulatorString
from plnerf.line.rules_json import rules_of, rules_row
from plnerf.line.states_json import states_of, states_row
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.scene.files import write_text
from plnerf.scene.strict_json import read_json, shown
from plnerf.scene.typed_json import kind_problem
from plnerf.scene.whole_result import finish_exchange

SURVEY_FILE = "survey.json"
"""Its name in a survey folder."""
SURVEY_VERSION = 7
"""6 had no encroachments and strings; 5 had no possible obstacles, coverage, other states and clearances by
rule; 4 named a wire's lowest point differently; 3 had no crossings; 2 had conductors in place of lines, and
no frame; 1 was written before conductors were fitted."""
WIRES_VERSION = 1


def write_wires(path: Path, wires: Sequence[Wire], frame: LineFrame, settings: Mapping[str, Any]) -> None:
    """Writes detected wires, with the settings that they were detected by."""
    content = {
        "format_version": WIRES_VERSION,
        "frame": _frame_row(frame),
        "settings": settings,
        "wires": [_wire_row(wire) for wire in wires],
    }
    write_text(path, json.dumps(plain_values(content), indent=1, allow_nan=False) + "\n")


def read_wires(path: Path) -> tuple[tuple[Wire, ...], LineFrame]:
    """What `write_wires` wrote.  Raises SurveyError where it is not that."""
    data = _load(path, WIRES_VERSION, "Remove it: the wires are detected again.")
    try:
        wires, frame = tuple(_wire(row) for row in data["wires"]), _frame(data["frame"])
        if problem := kind_problem(wires, tuple[Wire, ...]) or kind_problem(frame, LineFrame):
            raise ValueError(problem)
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise SurveyError(
            f"{path} is no file of wires ({_words(error)}). Remove it: the wires are detected again."
        ) from error
    return wires, frame


def write_survey_json(path: Path, survey: Survey) -> None:
    """Writes survey.json: all of a survey but the points of its cloud and its pictures."""
    write_text(path, json.dumps(survey_json(survey), indent=1, allow_nan=False, ensure_ascii=False) + "\n")


def survey_in(folder: Path) -> Path | None:
    """The survey.json of a folder; None: it holds no survey.

    A survey whose files were being exchanged when that was interrupted is put in its place first.  Raises
    PlnerfError where that cannot be done.
    """
    finish_exchange(folder)
    path = folder / SURVEY_FILE
    return path if path.is_file() else None


def read_survey(path: Path) -> Survey:
    """A survey out of survey.json; its cloud is empty, since the points lie in cloud.laz beside it.

    Raises SurveyError where the file is none, or of another format version.
    """
    finish_exchange(path.parent)
    data = _load(path, SURVEY_VERSION, "Survey again: plnerf survey.")
    try:
        survey = Survey(
            frame=_frame(data["frame"]),
            lines=tuple(_line(row) for row in data["lines"]),
            cloud=Cloud.empty(),
            source=data["source"],
            made=data["made"],
            settings=data["settings"],
            report_units=data["settings"].get("report_units", "metres"),
            clearances=None if data["clearances"] is None else _clearances(data["clearances"]),
            coverage=tuple(_coverage(row) for row in data["coverage"]),
            findings=tuple(Finding(**(row | {"where": tuple(row["where"])})) for row in data["findings"]),
            temperature_c=data["temperature_c"],
            rules=None if data["rules"] is None else rules_of(data["rules"]),
            states=None if data["states"] is None else states_of(data["states"]),
            encroachments=(
                None if data["encroachments"] is None else encroachments_of(data["encroachments"])
            ),
            strings=tuple(_string(row) for row in data["strings"]),
            detected=tuple(_wire(row) for row in data["detected"]),
            from_images=data["from_images"],
        )
        if problem := kind_problem(survey, Survey):
            raise ValueError(problem)
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise SurveyError(f"{path} is no survey ({_words(error)}). Survey again: plnerf survey.") from error
    return survey


def survey_json(survey: Survey) -> dict[str, Any]:
    """A survey as strictly JSON: finite numbers, texts, lists and nulls."""
    labels, counts = np.unique(survey.cloud.label, return_counts=True)
    content: dict[str, Any] = plain_values({
        "format_version": SURVEY_VERSION,
        "source": survey.source,
        "made": dict(survey.made),
        "frame": _frame_row(survey.frame),
        "temperature_c": survey.temperature_c,
        "findings": [asdict(one) for one in survey.findings],
        "points": len(survey.cloud.xyz),
        "points_by_class": {int(code): count for code, count in zip(labels, counts, strict=True)},
        "from_images": survey.from_images,
        "lines": [_line_row(line) for line in survey.lines],
        "clearances": None if survey.clearances is None else _clearances_row(survey.clearances),
        "coverage": [asdict(one) | {"silent": one.silent} for one in survey.coverage],
        "rules": None if survey.rules is None else rules_row(survey.rules),
        "states": None if survey.states is None else states_row(survey.states),
        "strings": [asdict(one) for one in survey.strings],
        "encroachments": (
            None if survey.encroachments is None else encroachments_row(survey.encroachments)
        ),
        "detected": [_wire_row(wire) for wire in survey.detected],
        "settings": dict(survey.settings),
    })
    return content


def _load(path: Path, version: int, advice: str) -> dict[str, Any]:
    data = read_json(path, SurveyError, advice)
    found = data.get("format_version") if isinstance(data, dict) else None
    if not isinstance(data, dict) or found != version:
        raise SurveyError(
            f"{path} has format version {shown(found)}, but this version of plnerf reads {version}. {advice}"
        )
    return data


def _words(error: Exception) -> str:
    text = f"it has no {error}" if isinstance(error, KeyError) else str(error)
    return text if len(text) < 200 else f"{text[:200]}..."


def _frame_row(frame: LineFrame) -> dict[str, Any]:
    return {
        "unit": frame.unit,
        "crs": frame.crs,
        "origin_lon_lat_height": frame.origin_lon_lat_height,
        "rule": "x_line = scale R_line_world (x_world - origin_world); z up",
        "R_line_world": frame.R_line_world,
        "scale": frame.scale,
        "origin_world": frame.origin_world,
        "scene_per_unit": frame.scene_per_unit,
    }


def _frame(row: Mapping[str, Any]) -> LineFrame:
    if row["unit"] not in {"m", "unscaled"}:
        raise ValueError(f"its unit is {row['unit']!r}")
    place = row["origin_lon_lat_height"]
    return LineFrame(
        _array(row["R_line_world"], 3, 3), float(row["scale"]), _array(row["origin_world"], 3), row["unit"],
        row["crs"], None if place is None else _array(place, 3), row["scene_per_unit"],
    )  # fmt: skip


def _wire_row(wire: Wire) -> dict[str, Any]:
    s, z = wire.lowest
    return {
        "id": wire.id,
        "name": wire.name,
        "circuit": wire.circuit,
        "kind": wire.kind,
        "bundle": wire.bundle,
        "diameter": wire.diameter_m,
        "sag": _quantity_row(wire.sag),
        "span_length": _quantity_row(wire.span_m),
        "p": _quantity_row(wire.p_m),
        "no_sag_because": wire.open,
        "wire_length": wire.length_m,
        "swing_rad": wire.swing_rad,
        "lowest_in_span": {"s": s, "z": z},
        "base": {"a": wire.base.a, "b": wire.base.b, "length": wire.base.length_m},
        "theta": wire.theta,
        "covariance": wire.covariance,
        "ends": [_end_row(end) for end in wire.ends],
        "points_at_ends": wire.points(np.array([0.0, wire.base.length_m])),
        "evidence": asdict(wire.evidence),
        "notes": wire.notes,
    }


def _wire(row: Mapping[str, Any]) -> Wire:
    evidence = dict(row["evidence"])
    if evidence["seen_m"] is not None:
        evidence["seen_m"] = tuple((float(low), float(high)) for low, high in evidence["seen_m"])
    first, last = (_end(end) for end in row["ends"])
    return Wire(
        id=int(row["id"]),
        base=Base(_array(row["base"]["a"], 2), _array(row["base"]["b"], 2)),
        theta=_array(row["theta"], 6),
        covariance=_array(row["covariance"], 6, 6),
        ends=(first, last),
        evidence=Evidence(**evidence),
        kind=row["kind"],
        bundle=row["bundle"],
        diameter_m=row["diameter"],
        name=row["name"],
        circuit=row.get("circuit"),
        notes=tuple(row["notes"]),
    )


def _end_row(end: End) -> dict[str, Any]:
    if isinstance(end, Open):
        return {"open": end.reason}
    return {"structure": end.structure, "point": end.point, "sigma": end.sigma_m, "string": end.string_m}


def _end(row: Mapping[str, Any]) -> End:
    if "open" in row:
        return Open(str(row["open"]))
    string = row.get("string")
    string_m = None if string is None else float(string)
    return Attached(int(row["structure"]), _array(row["point"], 3), float(row["sigma"]), string_m)


def _quantity_row(one: Quantity | None) -> dict[str, float] | None:
    return None if one is None else {"value": one.value, "sigma": one.sigma}


def _line_row(line: Line) -> dict[str, Any]:
    return {
        "id": line.id,
        "name": line.name,
        "circuits": line.circuits,
        "voltage_kv": line.voltage_kv,
        "from_m": line.from_m,
        "structures": [asdict(one) for one in line.structures],
        "spans": [
            {"id": span.id, "structures": span.structures, "wires": [_wire_row(wire) for wire in span.wires]}
            for span in line.spans
        ],
    }


def _line(row: Mapping[str, Any]) -> Line:
    return Line(
        id=int(row["id"]),
        structures=tuple(Structure(**(one | {"foot": _array(one["foot"], 3)})) for one in row["structures"]),
        spans=tuple(
            Span(
                int(one["id"]),
                (one["structures"][0], one["structures"][1]),
                tuple(_wire(wire) for wire in one["wires"]),
            )
            for one in row["spans"]
        ),
        name=row["name"],
        circuits=row["circuits"],
        voltage_kv=row["voltage_kv"],
        from_m=float(row.get("from_m", 0.0)),
    )


def _clearances_row(found: Clearances) -> dict[str, Any]:
    return {
        "state": found.state,
        "requirement": None if found.requirement is None else asdict(found.requirement),
        "wires": [
            {
                "wire": one.wire,
                "span": one.span,
                "kind": one.kind,
                "places": {
                    group: [_place_row(place, found) for place in one.places[group]] for group in GROUPS
                },
                "vertical": None if one.vertical is None else _place_row(one.vertical, found),
                "no_vertical": one.no_vertical,
                "profile": asdict(one.profile),
            }
            for one in found.wires
        ],
        "crossings": [asdict(one) for one in found.crossings],
        "possible": [asdict(one) for one in found.possible],
    }


def _place_row(place: Place, found: Clearances) -> dict[str, Any]:
    return asdict(place) | {"verdict": found.verdict(place)}


def _clearances(row: Mapping[str, Any]) -> Clearances:
    required = row["requirement"]
    if required is not None:
        required = Requirement(
            **(required | {key: tuple(required[key]) for key in ("applies_to", "caveats")})
        )
    return Clearances(
        tuple(_wire_clearance(one) for one in row["wires"]), required, row["state"],
        tuple(
            Crossing(**(one | {key: _array(one[key], 3) for key in ("on_upper", "on_lower")}))
            for one in row["crossings"]
        ),
        tuple(Possible(**(one | {"place": _place(one["place"])})) for one in row["possible"]),
    )  # fmt: skip


def _wire_clearance(row: Mapping[str, Any]) -> WireClearance:
    profile = dict(row["profile"])
    distances = {group: _gappy(values, -1) for group, values in profile.pop("distance_m").items()}
    arrays = {key: _gappy(profile[key], -1) for key in ("s_m", "sigma_z_m", "ground_z", "vegetation_z")}
    return WireClearance(
        wire=int(row["wire"]),
        span=int(row["span"]),
        kind=row["kind"],
        places={group: tuple(_place(one) for one in row["places"][group]) for group in GROUPS},
        vertical=None if row["vertical"] is None else _place(row["vertical"]),
        profile=Profile(
            wire=int(profile["wire"]), points=_array(profile["points"], -1, 3), distance_m=distances, **arrays
        ),
        no_vertical=row.get("no_vertical"),
    )


def _coverage(row: Mapping[str, Any]) -> Coverage:
    from_m, to_m, ground, air, images = (
        _gappy(row[key], -1) for key in ("from_m", "to_m", "ground", "air", "images")
    )
    return Coverage(row["line"], row["span"], from_m, to_m, ground, air, images, row["least"])


def _string(row: Mapping[str, Any]) -> InsulatorString:
    return InsulatorString(**(dict(row) | {"wires": tuple(row["wires"]), "ends": _array(row["ends"], 2, 3)}))


def _place(row: Mapping[str, Any]) -> Place:
    values = {key: value for key, value in row.items() if key != "verdict"}
    return Place(**(values | {key: _array(values[key], 3) for key in ("on_wire", "on_obstacle")}))


def _array(value: Any, *shape: int) -> np.ndarray:
    """Finite numbers of a stated shape."""
    array = _gappy(value, *shape)
    if not np.isfinite(array).all():
        raise ValueError(f"expected finite numbers, but found {str(value)[:60]}")
    return array


def _gappy(value: Any, *shape: int) -> np.ndarray:
    """Numbers of a stated shape; null is NaN."""
    return np.array(value, dtype=np.float64).reshape(shape)


def plain_values(value: Any) -> Any:
    """NumPy's values as Python's, numbers that are not finite as None, all the way down."""
    match value:
        case dict():
            return {str(key): plain_values(one) for key, one in value.items()}
        case list() | tuple():
            return [plain_values(one) for one in value]
        case np.ndarray() | np.generic():
            return plain_values(value.tolist())
        case float():
            return value if np.isfinite(value) else None
    return value
