"""The survey of a point cloud: LiDAR in, conductors, clearances and a report out."""

from collections.abc import Callable
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import laspy
import lazrs
import numpy as np
from jaxtyping import Float
from pyproj.exceptions import CRSError

from plnerf.errors import SurveyError
from plnerf.report.deliver import SurveyOptions, deliver
from plnerf.survey.lidar.find import find_conductors
from plnerf.survey.model import Survey

SUFFIXES = frozenset({".las", ".laz"})
MOST_POINTS = 60_000_000


def survey_cloud(
    path: Path, out: Path, options: SurveyOptions, progress: Callable[[int, int], None] | None = None
) -> Path:
    """Surveys a LAS or LAZ file, whose classes are not looked at; returns the report's path.

    Raises SurveyError where it cannot be read, or is no cloud in metres.
    """
    xyz, crs, notes = read_las(path)
    found = find_conductors(xyz, progress=progress)
    survey = Survey(
        found.conductors, found.towers, found.cloud, "m", crs, None, str(path), (*notes, *found.notes)
    )
    made = {
        "input": f"{path.name}, {len(xyz):,} points; its classes were not used",
        "program": f"plnerf {version('plnerf')}",
        "date (UTC)": datetime.now(UTC).strftime("%Y-%m-%d %H:%M"),
    }
    return deliver(survey, out, options, made=made, synthetic=False)


def read_las(path: Path) -> tuple[Float[np.ndarray, "n 3"], str | None, tuple[str, ...]]:
    """Coordinates in float64, the CRS as EPSG code or WKT, and what was wrong with it."""
    if not path.is_file():
        raise SurveyError(f"There is no cloud {path}. Give a LAS or LAZ file, or a run folder.")
    try:
        with laspy.open(path) as reader:
            if reader.header.point_count > MOST_POINTS:
                raise SurveyError(
                    f"{path} has {reader.header.point_count:,} points, more than {MOST_POINTS:,} that fit "
                    "into memory. Cut it into pieces of some kilometres."
                )
            stated = reader.header.point_count
            las = reader.read()
    except (OSError, ValueError, MemoryError, laspy.LaspyException, lazrs.LazrsError) as error:
        why = str(error) or "its header asks for more memory than there is"
        raise SurveyError(f"{path} cannot be read as LAS or LAZ ({why}). Copy it again.") from error
    if len(las.points) != stated:
        raise SurveyError(
            f"{path} states {stated:,} points, but holds {len(las.points):,}: it is cut off. Copy it again."
        )
    try:
        crs = las.header.parse_crs()
    except CRSError as error:
        return las.xyz, None, (f"The coordinate system that the file states is none: {error}.",)
    if crs is None:
        return las.xyz, None, ("The file states no coordinate system: its coordinates are taken for metres.",)
    horizontal = crs.sub_crs_list[0] if crs.is_compound else crs
    if horizontal.is_geographic:
        raise SurveyError(
            f"{path} is in degrees ({horizontal.name}), but metres are needed. Transform it to a projected "
            "coordinate system, such as UTM."
        )
    units = {axis.unit_name for axis in crs.axis_info if axis.unit_conversion_factor != 1}
    if units:
        raise SurveyError(
            f"{path} is in {' and '.join(sorted(units))} ({crs.name}), but metres are needed. Transform it "
            "to a projected coordinate system with heights in metres, such as UTM."
        )
    code = crs.to_epsg()
    return las.xyz, f"EPSG:{code}" if code else crs.to_wkt(), ()
