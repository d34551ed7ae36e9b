"""A survey as the files that others work with: cloud, conductors and clearances.

Every file is read back and compared with what was to be written before it is kept.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plnerf.export.check import check_all, check_places
from plnerf.export.crs import Places, places_of
from plnerf.export.dxf import Line, write_dxf
from plnerf.export.gis import Feature, write_geojson
from plnerf.export.las import write_las
from plnerf.export.rows import clearance_rows, conductor_properties, conductor_rows, write_csv
from plnerf.scene.files import complete_file
from plnerf.scene.ply import read_ply, write_ply
from plnerf.survey.clearance import Clearances
from plnerf.survey.model import Cloud, Survey

VERTEX_M = 1.0
"""Between vertices of a conductor's polyline, which is d^2 / 8p off the wire: 0.2 mm for p of 600 m."""
LAS, PLY, DXF = "cloud.laz", "cloud.ply", "conductors.dxf"
CONDUCTORS, CLEARANCES = "conductors.csv", "clearances.csv"
GEOJSON, PROJECTED, NEAR_PLACES = "conductors.geojson", "conductors-projected.geojson", "clearances.geojson"


@dataclass(frozen=True)
class Exports:
    """What was written."""

    files: dict[str, Path]
    """By name, in the order they were written."""
    notes: tuple[str, ...]
    """What coordinates mean, and which files were left out and why."""


def write_exports(
    survey: Survey, clearances: Clearances | None, folder: Path, *, synthetic: bool = False
) -> Exports:
    """Writes the survey's files into a folder, and reads each back.

    clearances: None where there are none to be told.  synthetic: the cloud's points come from images.  Files
    that need a CRS or longitudes are left out where these are not known; those of an earlier survey go.
    Raises SurveyError where a file reads back differently by more than 1 mm, or the survey's CRS is not known
    to pyproj.
    """
    places = places_of(survey)
    for name in (LAS, PLY, DXF, CONDUCTORS, CLEARANCES, GEOJSON, PROJECTED, NEAR_PLACES):
        (folder / name).unlink(missing_ok=True)  # of an earlier survey: some may not be written now
    notes = list(places.notes)
    write_las(folder / LAS, survey.cloud, places, synthetic=synthetic)
    _write_cloud_ply(folder / PLY, survey.cloud)
    write_dxf(folder / DXF, _lines(survey, clearances, places), _unit_of(survey, places))
    written = [LAS, PLY, DXF]
    rows = conductor_rows(survey, places)
    if rows:
        write_csv(folder / CONDUCTORS, rows, list(rows[0]))
        written.append(CONDUCTORS)
    else:
        notes.append(f"No conductors were found: {CONDUCTORS} and its GeoJSON are left out.")
    written += _write_gis(survey, clearances, places, folder, notes)
    near = [] if clearances is None else clearance_rows(survey, clearances, places)
    if near:
        write_csv(folder / CLEARANCES, near, list(near[0]))
        written.append(CLEARANCES)
    else:
        notes.append(f"There are no clearances: {CLEARANCES} and {NEAR_PLACES} are left out.")
    return Exports({name: folder / name for name in written}, tuple(notes))


def _write_gis(
    survey: Survey, clearances: Clearances | None, places: Places, folder: Path, notes: list[str]
) -> list[str]:
    """The names of what was written; what was left out goes to the notes."""
    wires = [
        Feature("LineString", conductor.fit.curve.polyline(VERTEX_M), conductor_properties(conductor, survey))
        for conductor in survey.conductors
    ]
    written = []
    if wires and places.crs is not None:
        write_geojson(folder / PROJECTED, wires, places.to_map, places.to_world, places.crs_json)
        written.append(PROJECTED)
    elif wires:
        notes.append(f"{PROJECTED} is left out: without a CRS, GIS programs cannot place it.")
    if places.earth is None:
        notes.append(f"{GEOJSON} and {NEAR_PLACES} are left out: they need longitudes and latitudes.")
        return written
    if wires:
        write_geojson(folder / GEOJSON, wires, places.to_wgs84, places.from_wgs84, None)
        written.append(GEOJSON)
    if clearances is not None and clearances.all_places():
        rows = clearance_rows(survey, clearances, places)
        points = [
            Feature("Point", place.obstacle[None], row)
            for place, row in zip(clearances.all_places(), rows, strict=True)
        ]
        write_geojson(folder / NEAR_PLACES, points, places.to_wgs84, places.from_wgs84, None)
        written.append(NEAR_PLACES)
    return written


def _write_cloud_ply(path: Path, cloud: Cloud) -> None:
    """The cloud in the world frame, in float64."""
    columns = {"classification": cloud.label, "wire_id": cloud.wire.astype(np.int32)}
    if cloud.rgb is not None:
        columns |= dict(zip(("red", "green", "blue"), cloud.rgb.T, strict=True))
    if cloud.sigma_m is not None:
        columns["sigma"] = cloud.sigma_m.astype(np.float32)
    with complete_file(path) as beside:
        write_ply(beside, cloud.xyz, columns)
        read = read_ply(beside)["vertex"]
        check_places(
            path, cloud.xyz, np.stack([read[axis] for axis in "xyz"], 1).astype(np.float64), "points"
        )
        for name, column in columns.items():
            check_all(path, np.array_equal(read[name], column), f"values of {name}")


def _lines(survey: Survey, clearances: Clearances | None, places: Places) -> list[Line]:
    """Conductors; towers from foot to top; clearances from the wire to the obstacle, with the wire's id."""
    world = [
        (f"CONDUCTOR-{conductor.kind.upper()}", conductor.id, conductor.fit.curve.polyline(VERTEX_M))
        for conductor in survey.conductors
    ]
    world += [
        ("TOWER", number, tower.foot + np.outer([0.0, tower.height_m], [0.0, 0.0, 1.0]))
        for number, tower in enumerate(survey.towers, 1)
    ]
    world += [
        (f"CLEARANCE-{place.to.upper()}", place.conductor, np.stack([place.wire, place.obstacle]))
        for place in (() if clearances is None else clearances.all_places())
    ]
    return [Line(layer, number, places.to_map(vertices)) for layer, number, vertices in world]


def _unit_of(survey: Survey, places: Places) -> str | None:
    if places.crs is not None:
        return str(places.crs.axis_info[0].unit_name)
    return "metre" if survey.unit == "m" else None
