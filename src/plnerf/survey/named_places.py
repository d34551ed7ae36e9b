"""Places with the names of structures and phases, out of the user's CSV, KML or GeoPackage.

Columns or attributes, in upper or lower case: `name` of a structure; or `phase` (and `circuit`) of a wire, at
a point on it or along a line; `line` and `voltage_kv` of the line that either belongs to.  A CSV has `lon`
and `lat` in degrees (WGS 84), or `x` and `y` in the survey's own coordinates, and may have `z`, a height in
those.  Of maps that GDAL reads (the extra `plnerf[gis]`) a height counts where it is not 0.
"""

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from plnerf.errors import ConfigError, SurveyError
from plnerf.line.frame import LineFrame
from plnerf.survey.map_objects import EXTRA, onto_line, read_layers

ALIASES = {
    "x": ("x", "east", "easting"), "y": ("y", "north", "northing"),
    "lon": ("lon", "long", "longitude"), "lat": ("lat", "latitude"),
    "z": ("z", "height", "elevation"), "name": ("name", "structure"), "phase": ("phase", "wire"),
    "circuit": ("circuit",), "line": ("line",), "voltage_kv": ("voltage_kv", "kv"),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class NamedPlace:
    """A name and where it belongs."""

    name: str | None
    """Of a structure; None: this names a phase."""
    phase: str | None
    circuit: str | None
    line: str | None
    voltage_kv: float | None
    points: Float[np.ndarray, "n 3"]
    """In the file's coordinates, then in the LineFrame; z is NaN where no height is stated."""


def check_places(path: Path) -> None:
    """Raises ConfigError for a file that `read_places` would refuse, before a line is surveyed."""
    _read(path)


def read_places(path: Path, frame: LineFrame) -> list[NamedPlace]:
    """The places of a file, in the LineFrame.  Raises ConfigError for a file that is none of its kind, and
    SurveyError for a survey whose place on the earth is not known and a file that is placed on the earth."""
    places, crs = _read(path)
    if crs is not None and frame.crs is None:
        raise SurveyError(
            f"The names of {path} cannot be matched to the survey, whose coordinate reference system is not "
            "known. Give the photos' positions or the cloud's CRS, or x and y in the survey's own metres."
        )
    return [_placed(one, crs, frame, path) for one in places]


def _placed(one: NamedPlace, crs: str | None, frame: LineFrame, path: Path) -> NamedPlace:
    known = np.isfinite(one.points[:, 2])
    level = np.where(known, one.points[:, 2], float(frame.to_world(np.zeros((1, 3)))[0, 2]))
    if crs is None and frame.crs is not None and frame.origin_lon_lat_height is not None:
        crs = frame.crs  # the survey's own map coordinates, which its world is not
    if crs is None:
        xyz = frame.from_world(np.column_stack([one.points[:, :2], level]))
    else:
        flat = onto_line(frame, crs, path)(one.points[:, :2])
        height = level
        if frame.origin_lon_lat_height is not None:  # the world counts heights from its origin
            height = np.where(known, one.points[:, 2] - frame.origin_lon_lat_height[2], level)
        z = frame.from_world(np.column_stack([np.zeros((len(flat), 2)), height]))[:, 2]
        xyz = np.column_stack([flat, z])
    xyz[~known, 2] = np.nan
    return replace(one, points=xyz)


def _read(path: Path) -> tuple[list[NamedPlace], str | None]:
    """All places, and the CRS that they are in; None: the survey's own."""
    if not path.is_file():
        raise ConfigError(f"There is no list of names {path}. Give a CSV, a KML or a GeoPackage.")
    places, crs = _of_csv(path) if path.suffix.lower() in {".csv", ".txt"} else _of_map(path)
    if not places:
        raise ConfigError(
            f"{path} names no structure and no phase. Give places with a column or an attribute `name` of a "
            "structure, or `phase` of a wire."
        )
    return places, crs


def _of_csv(path: Path) -> tuple[list[NamedPlace], str | None]:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file)
            named = tuple(reader.fieldnames or ())
            columns, rows = _columns(named), list(reader)
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"The list of names {path} is no CSV in UTF-8 ({error}).") from error
    pairs = [pair for pair in (("lon", "lat"), ("x", "y")) if set(pair) <= columns.keys()]
    if not pairs:
        raise ConfigError(
            f"The list of names {path} has the columns {', '.join(named) or 'none'}, but "
            "neither lon and lat nor x and y."
        )
    places = []
    for number, row in enumerate(rows, 2):
        text = {name: (row.get(column) or "").strip() for name, column in columns.items()}
        try:
            at = [float(text[name]) for name in pairs[0]]
            at.append(float(text["z"]) if text.get("z") else np.nan)
        except ValueError as error:
            raise ConfigError(f"Row {number} of the list of names {path}: {error}.") from error
        if not np.isfinite(at[:2]).all():
            raise ConfigError(f"Row {number} of the list of names {path} has no finite coordinates.")
        places += _place(text, np.array([at]), f"Row {number} of the list of names {path}")
    return places, "EPSG:4326" if pairs[0][0] == "lon" else None


def _of_map(path: Path) -> tuple[list[NamedPlace], str]:
    if find_spec("pyogrio") is None or find_spec("shapely") is None:
        raise ConfigError(
            f"{path} is read by pyogrio and shapely, not installed. Install: {EXTRA}, or give a CSV."
        )
    import shapely

    places: list[NamedPlace] = []
    systems = set()
    for meta, _, geometry, values in read_layers(path):
        columns = _columns([str(name) for name in meta["fields"]])
        index = {str(name): k for k, name in enumerate(meta["fields"])}
        for k, wkb in enumerate(geometry):
            if wkb is None:
                continue
            text = {name: _text(values[index[column]][k]) for name, column in columns.items()}
            try:
                xyz = shapely.get_coordinates(shapely.from_wkb(wkb), include_z=True)
            except shapely.errors.ShapelyError as error:
                raise ConfigError(f"The map {path} has a shape that is none ({error}). Repair it.") from error
            xyz[xyz[:, 2] == 0, 2] = np.nan  # clients' maps have 0 for a height that they do not know
            found = _place(text, xyz, f"Object {k + 1} of the list of names {path}") if len(xyz) else []
            places += found
            if found:
                systems.add(str(meta["crs"]))
    if len(systems) > 1 or "None" in systems:
        raise ConfigError(
            f"The layers of {path} with names are in the coordinate reference systems "
            f"{', '.join(sorted(systems))}. Give all of them one."
        )
    return places, systems.pop() if systems else "EPSG:4326"


def _columns(given: Any) -> dict[str, str]:
    """The file's columns by what they mean."""
    lower = {str(name).strip().lower(): str(name) for name in given if name is not None}
    return {
        name: lower[alias] for name, aliases in ALIASES.items() for alias in aliases[::-1] if alias in lower
    }


def _text(value: Any) -> str:
    return "" if value is None or value != value else str(value).strip()


def _kilovolts(text: str, where: str) -> float | None:
    """A nominal voltage; None of a cell that is empty or 0.  Raises ConfigError for what is none."""
    try:
        value = float(text or 0)
    except ValueError:
        value = math.nan
    if not 0 <= value < math.inf:
        raise ConfigError(f"{where} has the voltage_kv {text[:40]!r}. Give kilovolts, or nothing.")
    return value or None


def _place(text: Mapping[str, str], points: Float[np.ndarray, "n 3"], where: str) -> list[NamedPlace]:
    """Nothing where a row names neither.  where: which one it is, for errors."""
    phase, name = text.get("phase") or None, text.get("name") or None
    if phase is None and name is None:
        return []
    return [
        NamedPlace(
            name if phase is None else None, phase, text.get("circuit") or None, text.get("line") or None,
            _kilovolts(text.get("voltage_kv", ""), where), points,
        )
    ]  # fmt: skip
