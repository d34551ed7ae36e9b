"""Roads, rail, water and buildings of the user's maps, in plan, in the survey's LineFrame.

Maps are read by GDAL (pyogrio) and held as shapely's geometries, both of the extra `plnerf[gis]`: GeoJSON,
GeoPackage, shapefiles and what else GDAL reads, of every layer, in any CRS that the map states.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError

from plnerf.capture.heights import horizontal
from plnerf.capture.local_frame import GEOGRAPHIC, LocalFrame
from plnerf.errors import ConfigError, SurveyError
from plnerf.line.frame import LineFrame
from plnerf.line.survey import Survey

MapClass = Literal["road", "rail", "water", "building"]
CLASSES: tuple[MapClass, ...] = get_args(MapClass)
WIDTH_M: dict[MapClass, float] = {"road": 6.0, "rail": 3.0, "water": 2.0, "building": 1.0}
"""Of what the map has as a line or a point and without a `width_m`."""
EXTRA = 'pip install "plnerf[gis]"'
Flat = Float[np.ndarray, "n 2"]


@dataclass(frozen=True)
class MapObject:
    """One object in plan."""

    kind: MapClass
    shape: Any
    """A shapely geometry with an area; LineFrame, metres."""


def check_maps(paths: Sequence[Path], field: str) -> None:
    """Raises ConfigError for maps that `read_objects` would refuse, before a line is surveyed: where one is
    missing or cannot be read, or the extra is missing that reads them."""
    for path in paths:
        if not path.is_file():
            raise ConfigError(
                f"There is no map {path}. Give a GeoJSON, a GeoPackage or another map that GDAL reads."
            )
    if paths and (find_spec("pyogrio") is None or find_spec("shapely") is None):
        raise ConfigError(f"Maps are read by pyogrio and shapely, which are not installed. Install: {EXTRA}.")
    for path in paths:
        _layers(path, field)


def read_objects(paths: Sequence[Path], field: str, frame: LineFrame) -> list[MapObject]:
    """The objects of some maps.  field: the attribute that holds the class of each.

    Lines and points are widened to their attribute `width_m`, or to `WIDTH_M`.  Raises ConfigError for maps
    that cannot be read, have no such attribute or none of `CLASSES` in it; SurveyError for a survey whose
    place on the earth is not known.
    """
    if not paths:
        return []
    if frame.crs is None:
        raise SurveyError(
            f"The map {paths[0]} cannot be laid over the survey, whose coordinate reference system is not "
            "known. Give the photos' positions or the cloud's CRS, or leave the map out."
        )
    return [one for path in paths for one in _of_file(path, field, frame)]


def near_line(objects: Sequence[MapObject], survey: Survey, reach_m: float) -> list[MapObject]:
    """Those within reach of the box, in plan, that holds the survey's wires: a map may be of a country."""
    if not objects or not survey.wires:
        return []
    import shapely

    wires = np.concatenate([wire.polyline(1.0)[:, :2] for wire in survey.wires])
    box = shapely.box(*(wires.min(0) - reach_m), *(wires.max(0) + reach_m))
    return [one for one in objects if shapely.intersects(box, one.shape)]


@dataclass(frozen=True, eq=False)
class _Layer:
    """The objects of a layer of a map that have one of the classes."""

    crs: str
    kinds: tuple[MapClass, ...]
    wkb: tuple[bytes, ...]
    widths_m: tuple[float, ...]


def _layers(path: Path, field: str) -> list[_Layer]:
    """All layers of a map that hold some."""
    contents = read_layers(path)
    found = [layer for content in contents if (layer := _layer(path, content, field)) is not None]
    if not found:
        raise ConfigError(
            f"The map {path} has no object whose attribute {field!r} is {', '.join(CLASSES)}. Name the "
            "attribute that holds their class: --rules.object-field."
        )
    return found


def read_layers(path: Path) -> list[Any]:
    """The layers of a map that have shapes, as `pyogrio.raw.read` returns them.

    Raises ConfigError where the map cannot be read.
    """
    import pyogrio

    try:
        names = [str(name) for name, kind in pyogrio.list_layers(path) if kind is not None]
        return [pyogrio.raw.read(path, layer=name) for name in names]
    except (RuntimeError, ValueError) as error:  # GDAL's are the former; a text that is not UTF-8
        raise ConfigError(f"The map {path} cannot be read ({error}). Write it again.") from error


def _layer(path: Path, content: Any, field: str) -> _Layer | None:
    meta, _, geometry, columns = content
    names = [str(name) for name in meta["fields"]]
    if field not in names:
        return None
    classes = [str(kind).strip().lower() for kind in columns[names.index(field)]]
    widths = columns[names.index("width_m")] if "width_m" in names else [None] * len(classes)
    rows = [
        (kind, wkb, _width(kind, width))
        for kind, wkb, width in zip(classes, geometry, widths, strict=True)
        if kind in CLASSES and wkb is not None
    ]
    if not rows:
        return None
    if meta["crs"] is None:
        raise ConfigError(
            f"The map {path} states no coordinate reference system. Give it one (ogr2ogr -a_srs)."
        )
    kinds, shapes, metres = zip(*rows, strict=True)
    return _Layer(str(meta["crs"]), kinds, shapes, metres)


def _width(kind: MapClass, width: Any) -> float:
    try:
        value = float(width)
    except (TypeError, ValueError):  # none, or a text
        return WIDTH_M[kind]
    return value if np.isfinite(value) and value > 0 else WIDTH_M[kind]


def _of_file(path: Path, field: str, frame: LineFrame) -> list[MapObject]:
    import shapely

    layers = _layers(path, field)
    try:
        return [one for layer in layers for one in _of_layer(layer, onto_line(frame, layer.crs, path))]
    except shapely.errors.ShapelyError as error:
        raise ConfigError(f"The map {path} has a shape that is none ({error}). Repair it.") from error


def _of_layer(layer: _Layer, to_line: Callable[[Flat], Flat]) -> list[MapObject]:
    import shapely

    found = []
    for kind, wkb, width in zip(layer.kinds, layer.wkb, layer.widths_m, strict=True):
        shape = shapely.transform(shapely.force_2d(shapely.from_wkb(wkb)), to_line)
        if not shape.area:
            shape = shapely.buffer(shape, width / 2, cap_style="flat" if shape.length else "round")
        if not shape.is_empty:
            shapely.prepare(shape)
            found.append(MapObject(kind, shape))
    return found


def onto_line(frame: LineFrame, crs: str, path: Path) -> Callable[[Flat], Flat]:
    """From a map's coordinates to the LineFrame, in plan."""
    world = CRS.from_user_input(frame.crs)
    origin = frame.origin_lon_lat_height
    try:
        to_world = Transformer.from_crs(
            horizontal(CRS.from_user_input(crs)), "EPSG:4326" if origin is not None else horizontal(world),
            always_xy=True,
        )  # fmt: skip
    except CRSError as error:
        raise ConfigError(f"The map {path} is in the CRS {crs[:80]!r}, which is not known.") from error

    def onto(xy: Flat) -> Flat:
        flat = np.stack(to_world.transform(xy[:, 0], xy[:, 1]), 1)
        if origin is None:
            z = float(frame.to_world(np.zeros((1, 3)))[0, 2])
            placed = np.column_stack([flat, np.full(len(flat), z)])
        else:
            longitude, latitude, height = (float(value) for value in origin)
            level = np.column_stack([flat, np.full(len(flat), height)])
            placed = LocalFrame(GEOGRAPHIC, (longitude, latitude, height)).to_local(level)
        if not np.isfinite(placed).all():
            raise ConfigError(f"The map {path} has coordinates that its CRS cannot have ({crs[:80]}).")
        line: Flat = frame.from_world(placed)[:, :2]
        return line

    return onto
