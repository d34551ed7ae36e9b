"""GeoJSON: longitudes and latitudes as RFC 7946 wants them, and a copy in the survey's own CRS.

The copy names its CRS as GeoJSON of 2008 did, which RFC 7946 dropped and GIS programs still read.  Both name
what heights are above (`heights`), which programs that do not know it pass over.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from plnerf.export.read_back import check_places, check_same
from plnerf.export.rows import Row
from plnerf.scene.files import complete_file

DEGREE_DECIMALS = 9
"""A tenth of a millimetre."""
METRE_DECIMALS = 4


@dataclass(frozen=True, eq=False)
class Feature:
    """A line, a point or an area in the LineFrame, and what is known of it."""

    kind: Literal["LineString", "Point", "Polygon"]
    points: Float[np.ndarray, "_ 3"]
    """Of an area its closed ring, counterclockwise."""
    properties: Row


def write_geojson(
    path: Path,
    features: Sequence[Feature],
    forward: Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, "n 3"]],
    backward: Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, "n 3"]],
    crs: dict[str, Any] | None,
    heights: str,
) -> None:
    """Writes features and reads them back.

    forward, backward: from LineFrame coordinates to the file's and back, so that what reads back is compared
    in metres.  crs: None for longitudes and latitudes, else the name of the file's.  heights: what heights
    are above, in words.  Raises SurveyError where a vertex is more than 1 mm away.
    """
    decimals = (DEGREE_DECIMALS, DEGREE_DECIMALS, METRE_DECIMALS) if crs is None else (METRE_DECIMALS,) * 3
    data: dict[str, Any] = {"type": "FeatureCollection"}
    if crs is not None:
        data["crs"] = crs
    data["heights"] = heights
    lines = [forward(feature.points) for feature in features]
    data["features"] = [_feature(*pair, decimals) for pair in zip(features, lines, strict=True)]
    with complete_file(path) as beside:
        beside.write_text(json.dumps(data, allow_nan=False) + "\n", encoding="utf-8")
        found = json.loads(beside.read_text(encoding="utf-8"))
        check_same(path, crs, found.get("crs"), "the CRS")
        check_same(path, heights, found.get("heights"), "what heights are above")
        check_same(path, len(features), len(found["features"]), "the number of features")
        for feature, line, read in zip(features, lines, found["features"], strict=True):
            check_same(path, feature.kind, read["geometry"]["type"], "a geometry")
            check_same(path, feature.properties, read["properties"], "the properties of a feature")
            vertices = np.array(read["geometry"]["coordinates"], dtype=np.float64).reshape(-1, 3)
            check_places(path, backward(line), backward(vertices), "vertices")


def _feature(
    feature: Feature, coordinates: Float[np.ndarray, "n 3"], decimals: tuple[int, ...]
) -> dict[str, Any]:
    vertices = [
        [round(value, digits) for value, digits in zip(vertex, decimals, strict=True)]
        for vertex in coordinates.tolist()
    ]
    shaped = {"LineString": vertices, "Point": vertices[0], "Polygon": [vertices]}
    return {
        "type": "Feature",
        "geometry": {"type": feature.kind, "coordinates": shaped[feature.kind]},
        "properties": feature.properties,
    }
