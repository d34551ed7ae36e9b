"""GeoPackage and KML, by GDAL (pyogrio, of the extra `plnerf[gis]`).

The GeoPackage is in the survey's CRS and carries a style for QGIS with every layer (table `layer_styles`,
which QGIS reads by itself).  KML is in longitudes and latitudes.
"""

import sqlite3
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from plnerf.export.gis import Feature
from plnerf.export.layers import Layer, columns_of
from plnerf.export.read_back import check_places, check_same
from plnerf.scene.files import complete_file

To = Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, "n 3"]]
GEOMETRY = {"Point": "Point Z", "LineString": "LineString Z", "Polygon": "Polygon Z"}
STYLES = """create table layer_styles (
    id integer primary key autoincrement not null, f_table_catalog text(256), f_table_schema text(256),
    f_table_name text(256), f_geometry_column text(256), styleName text(30), styleQML text, styleSLD text,
    useAsDefault boolean, description text, owner text(30), ui text(30),
    update_time datetime default (strftime('%Y-%m-%dT%H:%M:%fZ', 'now'))
)"""
DATASET = {"GPKG": {"VERSION": "1.2"}}
"""Options of a new file: programs that are some years old warn of a later version of the standard."""
Symbol = tuple[int, str, str, tuple[tuple[str, str], ...]]
SYMBOLS: dict[str, Symbol] = {
    "Point": (0, "marker", "SimpleMarker", (("color", "{rgb}"), ("name", "circle"), ("size", "2.4"))),
    "LineString": (1, "line", "SimpleLine", (("line_color", "{rgb}"), ("line_width", "0.5"))),
    "Polygon": (
        2, "fill", "SimpleFill",
        (("color", "{faint}"), ("outline_color", "{rgb}"), ("outline_width", "0.4")),
    ),
}  # fmt: skip
"""How QGIS 3 draws each geometry: its type, symbol and class of symbol layer, and the layer's options."""


BESIDE = {
    "Point": 'placement="6" dist="1.5"', "LineString": 'placement="2" placementFlags="10" dist="0.5"',
    "Polygon": 'placement="1"',
}  # fmt: skip
"""Where QGIS 3 places a label: beside a point, above a line, in a polygon; distances in millimetres.

A label that QGIS cannot place so is left out."""


def write_gpkg(path: Path, layers: Sequence[Layer], to_map: To, crs: str) -> None:
    """Writes all layers with their styles, and reads each back by GDAL.

    to_map: from the LineFrame to `crs`.  Raises SurveyError where a vertex is more than 1 mm away.
    """
    with complete_file(path) as beside:
        for k, layer in enumerate(layers):
            _write_layer(beside, layer, to_map, crs, "GPKG", append=k > 0)
        base = sqlite3.connect(beside)
        with base:
            base.execute(STYLES)
            for layer in layers:
                base.execute(
                    "insert into layer_styles (f_table_catalog, f_table_schema, f_table_name, "
                    "f_geometry_column, styleName, styleQML, styleSLD, useAsDefault, description, owner) "
                    "values ('', '', ?, 'geom', ?, ?, '', 1, 'plnerf', '')",
                    (layer.name, layer.name, qml(layer)),
                )
            base.execute(
                "insert into gpkg_contents (table_name, data_type, identifier) values ('layer_styles', "
                "'attributes', 'layer_styles')"
            )
        base.close()
        _check(path, beside, layers, to_map)


def write_kml(path: Path, layers: Sequence[Layer], to_lon_lat: To) -> None:
    """Writes all layers in longitudes and latitudes, each a folder, and reads each back."""
    with complete_file(path) as beside:
        for k, layer in enumerate(layers):
            _write_layer(beside, layer, to_lon_lat, "EPSG:4326", "LIBKML", append=k > 0)
        _check(path, beside, layers, to_lon_lat, tolerance_deg=1e-8)


def qml(layer: Layer) -> str:
    """The style of a layer for QGIS: one symbol, and labels by names, or else by numbers."""
    kind = layer.features[0].kind
    number, symbol, of, options = SYMBOLS[kind]
    red, green, blue = (int(layer.colour[k : k + 2], 16) for k in (1, 3, 5))
    colours = {"rgb": f"{red},{green},{blue},255", "faint": f"{red},{green},{blue},90"}
    listed = "".join(
        f'<Option name="{name}" type="QString" value="{value.format(**colours)}"/>' for name, value in options
    )
    first = ", ".join(f"&quot;{name}&quot;" for name in layer.label)
    label = "" if not layer.label else (
        '<labeling type="simple"><settings calloutType="simple"><text-style isExpression="1" '
        f'fieldName="coalesce({first})" fontSize="9" namedStyle="Regular" textColor="{colours["rgb"]}"/>'
        f"<placement {BESIDE[kind]}/></settings></labeling>"
    )  # fmt: skip
    return (
        "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>"
        f'<qgis version="3.28" styleCategories="Symbology|Labeling" labelsEnabled="{int(bool(label))}">'
        f'<renderer-v2 type="singleSymbol"><symbols><symbol type="{symbol}" name="0" alpha="1">'
        f'<layer class="{of}" enabled="1" pass="0"><Option type="Map">{listed}</Option></layer></symbol>'
        f"</symbols></renderer-v2>{label}<layerGeometryType>{number}</layerGeometryType></qgis>"
    )


def _write_layer(path: Path, layer: Layer, to: To, crs: str, driver: str, *, append: bool) -> None:
    import pyogrio
    import shapely

    names = columns_of(layer)
    geometry = shapely.to_wkb([_shape(one, to) for one in layer.features])
    values = [_column([one.properties[name] for one in layer.features]) for name in names]
    if driver == "LIBKML" and "name" in names:
        names = ["Name" if name == "name" else name for name in names]
    pyogrio.raw.write(
        path, np.asarray(geometry, object), [data for data, _ in values], names,
        field_mask=[mask for _, mask in values], layer=layer.name, driver=driver, crs=crs,
        geometry_type=GEOMETRY[layer.features[0].kind], append=append, promote_to_multi=False,
        dataset_options=None if append else DATASET.get(driver),
    )  # fmt: skip


def _shape(one: Feature, to: To) -> Any:
    import shapely

    at = to(one.points)
    if one.kind == "Point":
        return shapely.Point(at[0])
    return shapely.LineString(at) if one.kind == "LineString" else shapely.Polygon(at)


def _column(values: list[Any]) -> tuple[np.ndarray, np.ndarray | None]:
    """A column of one type, and where it is null."""
    missing = np.array([one is None for one in values])
    some = [one for one in values if one is not None]
    if some and all(isinstance(one, int) for one in some):
        return np.array([one or 0 for one in values], np.int64), missing if missing.any() else None
    if some and all(isinstance(one, int | float) for one in some):
        return np.array([np.nan if one is None else one for one in values], np.float64), None
    return np.array([None if one is None else str(one) for one in values], object), None


def _check(
    path: Path, beside: Path, layers: Sequence[Layer], to: To, tolerance_deg: float | None = None
) -> None:
    """tolerance_deg: of longitudes and latitudes; None: coordinates are metres, compared to 1 mm."""
    import pyogrio
    import shapely

    names = sorted(str(name) for name, kind in pyogrio.list_layers(beside) if kind is not None)
    check_same(path, sorted(layer.name for layer in layers), names, "the layers")
    for layer in layers:
        _, _, geometry, _ = pyogrio.raw.read(beside, layer=layer.name, columns=[])
        check_same(path, len(layer.features), len(geometry), f"the number of features of {layer.name}")
        wanted = np.concatenate([to(one.points) for one in layer.features])
        found = shapely.get_coordinates(shapely.from_wkb(geometry), include_z=True)
        if tolerance_deg is not None and len(wanted) == len(found):  # degrees as if they were metres
            scale = 1e-3 / tolerance_deg
            wanted, found = wanted * [scale, scale, 1], found * [scale, scale, 1]
        check_places(path, wanted, found, f"vertices of {layer.name}")
