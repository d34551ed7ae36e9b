"""Further formats of a survey that lies in a folder: what `plnerf export` writes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Literal, get_args

from plnerf.errors import ConfigError, SurveyError
from plnerf.export.copc import write_copc
from plnerf.export.crs import CrsTransform, crs_transform
from plnerf.export.exports import LAS
from plnerf.export.geopackage import write_gpkg, write_kml
from plnerf.export.las import wkt_of
from plnerf.export.layers import layers_of
from plnerf.export.pls_cadd import XYZ, load_codes, write_xyz
from plnerf.line.survey import Survey

Format = Literal["gpkg", "kml", "copc", "pls-cadd"]
FORMATS: tuple[Format, ...] = get_args(Format)
NEEDS: dict[Format, tuple[str, ...]] = {
    "gpkg": ("pyogrio", "shapely"), "kml": ("pyogrio", "shapely"), "copc": ("copclib",), "pls-cadd": (),
}  # fmt: skip
NAMES: dict[Format, str] = {
    "gpkg": "survey.gpkg", "kml": "survey.kml", "copc": "cloud.copc.laz", "pls-cadd": XYZ,
}  # fmt: skip
EXTRA = 'pip install "plnerf[gis]"'


@dataclass(frozen=True)
class _Given:
    survey: Survey
    transform: CrsTransform
    laz: Path
    codes: dict[str, int]


def write_formats(
    survey: Survey, folder: Path, out: Path, formats: Sequence[Format], codes: Path | None = None
) -> list[Path]:
    """Writes a survey in further formats, and reads each back; returns the files.

    folder: of the survey, with its cloud; codes: PLS-CADD's feature codes (TOML); None: the default ones.
    Raises ConfigError where a library is missing, SurveyError where the survey lacks what a format needs.
    """
    missing = sorted({name for one in formats for name in NEEDS[one] if find_spec(name) is None})
    if missing:
        raise ConfigError(f"{', '.join(missing)} is not installed. Install: {EXTRA}.")
    laz = folder / LAS
    if {"copc", "pls-cadd"} & set(formats) and not laz.is_file():
        raise SurveyError(f"{folder} has no {LAS}, which {' and '.join(formats)} need. Survey again.")
    given = _Given(survey, crs_transform(survey), laz, load_codes(codes))
    writers: dict[Format, Callable[[Path, _Given], None]] = {
        "gpkg": _gpkg, "kml": _kml, "copc": lambda path, of: write_copc(path, of.laz),
        "pls-cadd": lambda path, of: write_xyz(path.parent, of.survey, of.laz, of.transform, of.codes),
    }  # fmt: skip
    written = []
    for one in dict.fromkeys(formats):
        writers[one](out / NAMES[one], given)
        written.append(out / NAMES[one])
    return written


def _gpkg(path: Path, of: _Given) -> None:
    if of.transform.crs is None:
        raise SurveyError(
            f"{path.name} needs a coordinate reference system, which {of.survey.source} has not. Give the "
            "photos' positions or the cloud's CRS."
        )
    write_gpkg(path, layers_of(of.survey, of.transform), of.transform.to_map, wkt_of(of.transform.crs))


def _kml(path: Path, of: _Given) -> None:
    if of.transform.earth is None:
        raise SurveyError(f"{path.name} needs longitudes and latitudes, which {of.survey.source} has not.")
    write_kml(path, layers_of(of.survey, of.transform), of.transform.to_lon_lat)
