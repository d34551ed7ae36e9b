"""Reads the points of LAS and LAZ files."""

from dataclasses import dataclass
from pathlib import Path

import laspy
import lazrs
import numpy as np
from jaxtyping import Float
from pyproj.exceptions import CRSError

from plnerf.errors import SurveyError
from plnerf.findings import Finding, note
from plnerf.survey.lidar.checks import check_cloud
from plnerf.survey.lidar.config import CloudConfig

SUFFIXES = frozenset({".las", ".laz"})
DEFAULT = CloudConfig()


@dataclass(frozen=True, eq=False)
class PointCloud:
    """The points of a file; their classes are not read."""

    xyz: Float[np.ndarray, "n 3"]
    """In the file's own coordinates: metres, z up."""
    crs: str | None
    """Of the coordinates, as EPSG code or WKT; None: the file states none."""
    path: Path
    findings: tuple[Finding, ...] = ()


def read_cloud(path: Path, config: CloudConfig = DEFAULT) -> PointCloud:
    """The points of a LAS or LAZ file, in float64.

    Raises SurveyError where it cannot be read, is cut off, or is no cloud in metres.
    """
    if not path.is_file():
        raise SurveyError(f"There is no cloud {path}. Give a LAS or LAZ file, or a run folder.")
    try:
        with laspy.open(path) as reader:
            stated = reader.header.point_count
            if stated > config.max_points:
                raise SurveyError(
                    f"{path} has {stated:,} points, more than {config.max_points:,} that fit into memory. "
                    "Cut it into pieces of some kilometres."
                )
            las = reader.read()
    except (OSError, ValueError, MemoryError, laspy.LaspyException, lazrs.LazrsError) as error:
        why = str(error) or "its header asks for more memory than there is"
        raise SurveyError(f"{path} cannot be read as LAS or LAZ ({why}). Copy it again.") from error
    if len(las.points) != stated:
        raise SurveyError(
            f"{path} states {stated:,} points, but holds {len(las.points):,}: it is cut off. Copy it again."
        )
    crs, findings = _crs_of(las.header, path)
    xyz = np.asarray(las.xyz, np.float64)
    check_cloud(xyz, config)
    return PointCloud(xyz, crs, path, findings)


def _crs_of(header: laspy.LasHeader, path: Path) -> tuple[str | None, tuple[Finding, ...]]:
    """The coordinate system that a header states, as EPSG code or WKT, and what is wrong with it.

    Raises SurveyError where it is not in metres.
    """
    kind = "coordinate system"
    try:
        crs = header.parse_crs()
    except CRSError as error:
        return None, (note(kind, f"The coordinate system that the file states is none: {error}."),)
    if crs is None:
        what = "The file states no coordinate system: its coordinates are taken for metres."
        return None, (note(kind, what),)
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
    return f"EPSG:{code}" if code else crs.to_wkt(), ()
