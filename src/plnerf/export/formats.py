"""Further formats of a survey that lies in a folder: what `plnerf export` writes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Literal, get_args

from plnerf.errors import ConfigError, SurveyError
from plnerf.export.copc import write_copc
from plnerf.export.crs import CrsTransform, crs_transform
from plnerf.export.exports import LAS, Exports
from plnerf.export.geopackage import write_gpkg, write_kml
from plnerf.export.las import wkt_of
from plnerf.export.layers import layers_of
from plnerf.export.pls_cadd import XYZ, load_codes, write_xyz
from plnerf.line.survey import Survey
from plnerf.scene.las_files import open_las

Format = Literal["gpkg", "kml", "copc", "pls-cadd"]
FORMATS: tuple[Format, ...] = get_args(Format)
NEEDS: dict[Format, tuple[str, ...]] = {
    "gpkg": ("pyogrio", "shapely"), "kml": ("pyogrio", "shapely"), "copc": ("copclib",), "pls-cadd": (),
}  # fmt: skip
NAMES: dict[Format, str] = {
    "gpkg": "survey.gpkg", "kml": "survey.kml", "copc": "cloud.copc.laz", "pls-cadd": XYZ,
}  # fmt: skip
MAPS: tuple[Format, ...] = ("gpkg", "kml")
"""Formats that hold layers alone."""
EXTRA = 'pip install "plnerf[gis]"'


@dataclass(frozen=True)
class _Given:
    survey: Survey
    transform: CrsTransform
    laz: Path
    codes: dict[str, int]


def write_formats(
    survey: Survey,
    folder: Path,
    out: Path,
    formats: Sequence[Format] | None = None,
    codes: Path | None = None,
) -> Exports:
    """Writes a survey in further formats, and reads each back.

    folder: of the survey, with its cloud; formats: None: all but those for which the survey lacks something,
    which are named with the reason; codes: PLS-CADD's feature codes (TOML); None: the default ones.
    Raises ConfigError where a library is missing, SurveyError where the survey lacks what a format that was
    asked for needs, or its cloud cannot be read.
    """
    transform = crs_transform(survey)
    laz = folder / LAS
    lacks = lacking(survey, transform, laz)
    if formats is None:
        formats, about = [one for one in FORMATS if one not in lacks], tuple(lacks.values())
    else:
        about = ()
        for one in formats:
            if one in lacks:
                raise SurveyError(lacks[one])
    missing = sorted({name for one in formats for name in lacks_library(one)})
    if missing:
        raise ConfigError(f"{', '.join(missing)} is not installed. Install: {EXTRA}.")
    if {"copc", "pls-cadd"} & set(formats) and not laz.is_file():
        raise SurveyError(f"{folder} has no {LAS}, which {' and '.join(formats)} need. Survey again.")
    given = _Given(survey, transform, laz, load_codes(codes))
    writers: dict[Format, Callable[[Path, _Given], None]] = {
        "gpkg": _gpkg, "kml": _kml, "copc": lambda path, of: write_copc(path, of.laz),
        "pls-cadd": lambda path, of: write_xyz(path.parent, of.survey, of.laz, of.transform, of.codes),
    }  # fmt: skip
    files = {}
    for one in dict.fromkeys(formats):
        writers[one](out / NAMES[one], given)
        files[NAMES[one]] = out / NAMES[one]
    return Exports(files, about)


def lacks_library(one: Format) -> tuple[str, ...]:
    """The libraries that a format needs and that are not installed."""
    return tuple(name for name in NEEDS[one] if find_spec(name) is None)


def lacking(survey: Survey, transform: CrsTransform, laz: Path) -> dict[Format, str]:
    """The formats in which a survey cannot be written, each with the reason.  laz: the survey's cloud."""
    lacks: dict[Format, str] = {}
    if not (survey.wires or survey.structures):
        why = f"needs a wire or a structure, but {survey.source} has none. Leave it out."
        lacks |= {one: f"{NAMES[one]} {why}" for one in MAPS}
    if transform.crs is None:
        lacks["gpkg"] = (
            f"{NAMES['gpkg']} needs a coordinate reference system, which {survey.source} has not. Give the "
            "photos' positions or the cloud's CRS."
        )
    if transform.earth is None:
        lacks["kml"] = f"{NAMES['kml']} needs longitudes and latitudes, which {survey.source} has not."
    if survey.frame.unit != "m":
        lacks["pls-cadd"] = f"{NAMES['pls-cadd']} needs metres, but {survey.source} has no scale."
    if laz.is_file() and not _points_in(laz):
        lacks["copc"] = f"{NAMES['copc']} needs points, but {laz} has none. Leave it out."
        if not survey.wires:
            lacks["pls-cadd"] = f"{NAMES['pls-cadd']} needs points or wires, but {laz.parent} has none."
    return lacks


def _points_in(laz: Path) -> int:
    with open_las(laz) as reader:
        return int(reader.header.point_count)


def _gpkg(path: Path, of: _Given) -> None:
    assert of.transform.crs is not None  # or else the survey lacks it
    layers = layers_of(of.survey, of.transform)
    write_gpkg(path, layers, of.transform.to_map, wkt_of(of.transform.crs))


def _kml(path: Path, of: _Given) -> None:
    write_kml(path, layers_of(of.survey, of.transform), of.transform.to_lon_lat)
