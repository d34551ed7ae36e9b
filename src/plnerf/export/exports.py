"""A survey as the files that other programs read: cloud, wires, structures and clearances.

Every file is read back and compared with what was to be written before it is kept.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plnerf.capture.heights import heights_of
from plnerf.export.cloud_ply import write_cloud_ply, write_wires_ply
from plnerf.export.crs import CrsTransform, crs_transform
from plnerf.export.dxf import Drawn, write_dxf
from plnerf.export.encroachment_rows import (
    ENCROACHMENTS,
    PLACED_ENCROACHMENTS,
    encroachment_features,
    encroachment_rows,
)
from plnerf.export.gis import Feature, write_geojson
from plnerf.export.las import write_las
from plnerf.export.line_rows import (
    ATTACHMENTS,
    PHASES,
    SPANS,
    STRINGS,
    attachment_rows,
    phase_rows,
    span_rows,
    string_rows,
)
from plnerf.export.rows import (
    Row,
    clearance_rows,
    crossing_rows,
    structure_properties,
    structure_rows,
    wire_properties,
    wire_rows,
    write_csv,
)
from plnerf.export.rule_rows import RULES, rule_rows
from plnerf.export.state_rows import STATES, state_rows
from plnerf.line.clearances import Place
from plnerf.line.ends import Quantity
from plnerf.line.line import Line, Structure
from plnerf.line.stations import structure_stations
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire

VERTEX_M = 1.0
"""Between vertices of a wire's polyline, which is d^2 / 8p off the wire: 0.2 mm for p of 600 m."""
LAS, PLY, WIRE_POINTS, DXF = "cloud.laz", "cloud.ply", "wires.ply", "conductors.dxf"
WIRES, CLEARANCES = "conductors.csv", "clearances.csv"
STRUCTURES, PLACED_STRUCTURES, CROSSINGS = "structures.csv", "structures.geojson", "crossings.csv"
GEOJSON, PROJECTED, NEAR_PLACES = "conductors.geojson", "conductors-projected.geojson", "clearances.geojson"


FILES = (
    LAS, PLY, WIRE_POINTS, DXF, WIRES, CLEARANCES, GEOJSON, PROJECTED, NEAR_PLACES, STRUCTURES,
    PLACED_STRUCTURES, CROSSINGS, STATES, RULES, ENCROACHMENTS,
    PLACED_ENCROACHMENTS, SPANS, PHASES, ATTACHMENTS, STRINGS,
)  # fmt: skip
"""All that may be written of a survey."""


@dataclass(frozen=True)
class Exports:
    """What was written."""

    files: dict[str, Path]
    """By name, in the order in which they were written."""
    about: tuple[str, ...]
    """What coordinates mean, and which files were left out and why."""


def write_exports(survey: Survey, folder: Path) -> Exports:
    """Writes the survey's files into a folder, and reads each back.

    Files that need a CRS or longitudes are left out where these are not known; those of an earlier survey
    are removed.  Raises SurveyError where a file reads back differently by more than 1 mm, or pyproj does not
    know the survey's CRS.
    """
    transform = crs_transform(survey)
    for name in FILES:
        (folder / name).unlink(missing_ok=True)  # of an earlier survey: some may not be written now
    about = list(transform.about)
    write_las(folder / LAS, survey.cloud, transform, synthetic=survey.from_images)
    write_cloud_ply(folder / PLY, survey.cloud, transform)
    write_dxf(folder / DXF, _drawn(survey, transform), transform.unit_name, transform.reference)
    written = [LAS, PLY, DXF]
    if survey.wire_points is not None and len(survey.wire_points.xyz):
        write_wires_ply(folder / WIRE_POINTS, survey.wire_points, transform)
        written.append(WIRE_POINTS)
    rows = wire_rows(survey, transform)
    if rows:
        write_csv(folder / WIRES, rows, list(rows[0]))
        written.append(WIRES)
    else:
        about.append(f"No wires were found: {WIRES} and its GeoJSON are left out.")
    for name, some in (
        (STRUCTURES, structure_rows(survey, transform)), (CROSSINGS, crossing_rows(survey, transform)),
        (STATES, state_rows(survey)), (RULES, rule_rows(survey, transform)),
        (ENCROACHMENTS, encroachment_rows(survey, transform)), *_line_tables(survey, transform),
    ):  # fmt: skip
        if some:
            write_csv(folder / name, some, list(some[0]))
            written.append(name)
    written += _write_gis(survey, transform, folder, about)
    near = clearance_rows(survey, transform)
    if near:
        write_csv(folder / CLEARANCES, near, list(near[0]))
        written.append(CLEARANCES)
    else:
        about.append(f"There are no clearances: {CLEARANCES} and {NEAR_PLACES} are left out.")
    return Exports({name: folder / name for name in written}, tuple(about))


def _line_tables(survey: Survey, transform: CrsTransform) -> tuple[tuple[str, list[Row]], ...]:
    """Tables of spans, phases, attachments and strings, of surveys that have a scale."""
    if survey.frame.unit == "unscaled":
        return ()
    return (
        (SPANS, span_rows(survey, transform)), (PHASES, phase_rows(survey)),
        (ATTACHMENTS, attachment_rows(survey, transform)), (STRINGS, string_rows(survey, transform)),
    )  # fmt: skip


def _write_gis(survey: Survey, transform: CrsTransform, folder: Path, about: list[str]) -> list[str]:
    """The names of what was written; what was left out is appended to `about`."""
    wires = [
        Feature("LineString", wire.polyline(VERTEX_M), wire_properties(survey, line, span, wire, transform))
        for line in survey.lines
        for span in line.spans
        for wire in span.wires
    ]
    written = []
    heights = heights_of(transform.crs).words
    on_map = (transform.to_map, transform.from_map, transform.crs_json, heights)
    on_earth = (transform.to_lon_lat, transform.from_lon_lat, None, transform.lon_lat_heights)
    if wires and transform.crs is not None:
        write_geojson(folder / PROJECTED, wires, *on_map)
        written.append(PROJECTED)
    elif wires:
        about.append(f"{PROJECTED} is left out: without a CRS, GIS programs cannot place it.")
    if transform.earth is None:
        about.append(f"{GEOJSON} and {NEAR_PLACES} are left out: they need longitudes and latitudes.")
        return written
    if wires:
        write_geojson(folder / GEOJSON, wires, *on_earth)
        written.append(GEOJSON)
    masts = [
        Feature("Point", one.foot[None], structure_properties(survey, line, one))
        for line in survey.lines
        for one in line.structures
    ]
    if masts:
        write_geojson(folder / PLACED_STRUCTURES, masts, *on_earth)
        written.append(PLACED_STRUCTURES)
    if near := encroachment_features(survey):
        write_geojson(folder / PLACED_ENCROACHMENTS, near, *on_earth)
        written.append(PLACED_ENCROACHMENTS)
    if _places(survey):
        rows = clearance_rows(survey, transform)
        points = [
            Feature("Point", place.on_obstacle[None], row)
            for place, row in zip(_places(survey), rows, strict=True)
        ]
        write_geojson(folder / NEAR_PLACES, points, *on_earth)
        written.append(NEAR_PLACES)
    return written


def _drawn(survey: Survey, transform: CrsTransform) -> list[Drawn]:
    """Wires; structures from foot to top; clearances from the wire to the obstacle, with the wire's id;
    crossings from wire to wire, with the id of the one above."""
    unit = survey.frame.unit
    drawn = [
        (
            f"CONDUCTOR-{wire.kind.upper()}", wire.id, wire.polyline(VERTEX_M),
            (f"line {line.id}, span {span.id}", *_about_wire(wire, unit)),
        )
        for line in survey.lines
        for span in line.spans
        for wire in span.wires
    ]  # fmt: skip
    drawn += [
        (
            "STRUCTURE", one.id, np.stack([one.foot, one.top]),
            (f"line {line.id}, structure {one.id}", *_about_structure(line, one, unit)),
        )
        for line in survey.lines
        for one in line.structures
    ]  # fmt: skip
    line_of = {wire.id: line.id for line in survey.lines for wire in line.wires}
    drawn += [
        (
            f"CLEARANCE-{place.to.upper()}", place.wire, np.stack([place.on_wire, place.on_obstacle]),
            (
                f"line {line_of[place.wire]}, span {place.span}",
                _length("distance", Quantity(place.distance_m, place.sigma_m), unit),
            ),
        )
        for place in _places(survey)
    ]  # fmt: skip
    drawn += [
        (
            "CROSSING", one.upper, np.stack([one.on_upper, one.on_lower]),
            (f"above wire {one.lower}", _length("distance", Quantity(one.distance_m, one.sigma_m), unit)),
        )
        for one in (survey.clearances.crossings if survey.clearances is not None else ())
    ]  # fmt: skip
    return [Drawn(layer, number, transform.to_map(line), about) for layer, number, line, about in drawn]


def _about_wire(wire: Wire, unit: str) -> tuple[str, ...]:
    """Sag, span length, p and swing, or why there are none."""
    named = (("sag", wire.sag), ("span length", wire.span_m), ("p", wire.p_m))
    lengths = [_length(name, one, unit) for name, one in named]
    swing = wire.swing_deg
    if swing is not None:
        lengths.append(f"swing {swing.value:.2f} +- {swing.half_95:.2f} degrees (95 %)")
    return (*lengths, *[wire.open or ""] * bool(wire.open))


def _about_structure(line: Line, one: Structure, unit: str) -> tuple[str, ...]:
    """Its kind, its station, by how much the line turns there, and what shows it."""
    station, angle = structure_stations(line).get(one.id), one.line_angle_deg
    about: list[str] = [one.kind]
    if station is not None:
        about.append(f"station {station:.3f} {unit}")
    if angle is not None:
        about.append(f"line angle {angle:.2f} degrees")
    return (*about, one.evidence)


def _length(name: str, one: Quantity | None, unit: str) -> str:
    if one is None:
        return f"{name} -"
    return f"{name} {one.value:.3f} +- {one.half_95:.3f} {unit} (95 %)"


def _places(survey: Survey) -> tuple[Place, ...]:
    return survey.clearances.all_places() if survey.clearances is not None else ()
