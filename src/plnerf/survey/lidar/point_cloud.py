"""Reads the points of LAS and LAZ files."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from plnerf.errors import SurveyError
from plnerf.findings import Finding
from plnerf.line.cloud import Attributes
from plnerf.scene.las_files import open_las
from plnerf.survey.lidar.attributes import attributes_of
from plnerf.survey.lidar.checks import check_cloud
from plnerf.survey.lidar.config import CloudConfig
from plnerf.survey.lidar.metric import in_metres

SUFFIXES = frozenset({".las", ".laz"})
DEFAULT = CloudConfig()


@dataclass(frozen=True, eq=False)
class PointCloud:
    """The points of a file."""

    xyz: Float[np.ndarray, "n 3"]
    """Metres, z up: the file's own, or east, north and up of `origin`."""
    crs: str | None
    """Of the file, as EPSG code or WKT; None: the file states none."""
    path: Path
    findings: tuple[Finding, ...] = ()
    origin: tuple[float, float, float] | None = None
    """Longitude, latitude and height of what the points are relative to; None: they are in `crs`."""
    attributes: Attributes | None = None


def read_cloud(path: Path, config: CloudConfig = DEFAULT) -> PointCloud:
    """The points of a LAS or LAZ file, in float64.

    Feet, degrees and other units become metres.  Raises SurveyError where it cannot be read, is cut off, or
    is no cloud of a line.
    """
    if not path.is_file():
        raise SurveyError(f"There is no cloud {path}. Give a LAS or LAZ file, or a run folder.")
    with open_las(path) as reader:
        stated = reader.header.point_count
        if stated > config.max_points:
            raise SurveyError(
                f"{path} has {stated:,} points, more than {config.max_points:,} that fit into memory. "
                "Cut it into pieces of some kilometres."
            )
        las = reader.read()
    if len(las.points) != stated:
        raise SurveyError(
            f"{path} states {stated:,} points, but holds {len(las.points):,}: it is cut off. Copy it again."
        )
    found = in_metres(np.asarray(las.xyz, np.float64), las.header, path)
    check_cloud(found.xyz, config)
    return PointCloud(found.xyz, found.crs, path, found.findings, found.origin, attributes_of(las))
