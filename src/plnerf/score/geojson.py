"""Points and lines with heights out of GeoJSON.

RFC 7946 wants longitudes and latitudes; a survey's own files hold the coordinates of the world frame, which
nothing in the file tells apart: coordinates are taken as they are.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from plnerf.errors import SurveyError
from plnerf.scene.json_fields import numbers_of
from plnerf.scene.strict_json import read_json, shown


def read_geojson(path: Path) -> tuple[Float[np.ndarray, "n 3"], list[Float[np.ndarray, "_ 3"]]]:
    """All points, and all lines by their vertices.  Raises SurveyError where there are none, or no z."""
    data = read_json(path, SurveyError, "Write it again.")
    points, lines, others = [], [], set()
    if not isinstance(data, dict) or "type" not in data:
        raise SurveyError(f"{path} is no GeoJSON: it has no 'type'. Is it the file of another program?")
    for geometry in _geometries(data):
        kind, coordinates = geometry.get("type"), geometry.get("coordinates")
        match kind:
            case "Point":
                points.append(_vertices([coordinates], path))
            case "MultiPoint":
                points.append(_vertices(coordinates, path))
            case "LineString":
                lines.append(_vertices(coordinates, path))
            case "MultiLineString":
                parts = coordinates if isinstance(coordinates, list) else [coordinates]
                lines += [_vertices(part, path) for part in parts]
            case _:
                others.add(str(kind))
    if others and not points and not lines:
        raise SurveyError(
            f"{path} holds {', '.join(sorted(others))}, but no points and no lines. Export the wires as "
            "LineString with z."
        )
    return np.concatenate([np.empty((0, 3)), *points]), lines


def _geometries(data: Any) -> Iterator[dict[str, Any]]:
    """The geometries of GeoJSON's nested objects; what is none is passed over."""
    if isinstance(data, list):
        for item in data:
            yield from _geometries(item)
    elif isinstance(data, dict):
        nested = {"FeatureCollection": "features", "Feature": "geometry", "GeometryCollection": "geometries"}
        key = nested.get(str(data.get("type")))
        if key is None:
            yield data
        else:
            yield from _geometries(data.get(key))


def _vertices(coordinates: Any, path: Path) -> Float[np.ndarray, "v 3"]:
    array = numbers_of(coordinates)
    if not array.size:
        raise SurveyError(
            f"{path}: a geometry's coordinates are no list of [x, y, z], but {shown(coordinates)}. Every "
            "vertex needs its z; write the file again."
        )
    if array.ndim != 2 or array.shape[1] < 3 or not len(array):
        raise SurveyError(
            f"{path}: a geometry's coordinates have the shape {array.shape}, but every vertex needs x, y and "
            "z. Export the wires in three dimensions."
        )
    return array[:, :3]
