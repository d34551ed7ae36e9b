"""LAS and LAZ files are read whole, in metres, or not at all."""

from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS

from plnerf.errors import SurveyError
from plnerf.survey.lidar.config import CloudConfig
from plnerf.survey.lidar.point_cloud import read_cloud

XYZ = np.random.default_rng(0).uniform([230_000, 570_000, 0], [230_090, 570_040, 30], (500, 3))


def write_las(path: Path, xyz: np.ndarray, crs: str | None = "EPSG:28992") -> Path:
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales, header.offsets = [0.001] * 3, np.floor(xyz.min(0)) if len(xyz) else np.zeros(3)
    if crs is not None:
        header.add_crs(CRS(crs))
    las = laspy.LasData(header)
    las.xyz = xyz
    las.write(path)
    return path


@pytest.mark.parametrize("name", ["line.las", "line.laz"])
def test_points_come_back_as_they_are(tmp_path: Path, name: str) -> None:
    path = write_las(tmp_path / name, XYZ)
    cloud = read_cloud(path)
    assert np.abs(cloud.xyz - XYZ).max() < 0.001 and cloud.xyz.dtype == np.float64
    assert cloud.crs == "EPSG:28992" and cloud.path == path and cloud.findings == ()


def test_a_file_without_coordinate_system_is_read_with_a_finding(tmp_path: Path) -> None:
    cloud = read_cloud(write_las(tmp_path / "nowhere.las", XYZ, None))
    assert cloud.crs is None and "states no coordinate system" in cloud.findings[0].text


def test_what_is_no_cloud_of_a_line_is_told(tmp_path: Path) -> None:
    with pytest.raises(SurveyError, match="There is no cloud"):
        read_cloud(tmp_path / "absent.laz")
    (tmp_path / "broken.las").write_bytes(b"LASF and no more")
    with pytest.raises(SurveyError, match="cannot be read as LAS or LAZ"):
        read_cloud(tmp_path / "broken.las")
    whole = write_las(tmp_path / "whole.las", XYZ)
    (tmp_path / "cut.las").write_bytes(whole.read_bytes()[:-3000])
    with pytest.raises(SurveyError, match=r"is cut off\. Copy it again|cannot be read as LAS or LAZ"):
        read_cloud(tmp_path / "cut.las")
    with pytest.raises(SurveyError, match="has 500 points, more than 499 that fit into memory"):
        read_cloud(whole, CloudConfig(max_points=499))
    with pytest.raises(SurveyError, match="The cloud holds no points"):
        read_cloud(write_las(tmp_path / "empty.las", XYZ[:0]))


def test_other_units_than_metres_are_told(tmp_path: Path) -> None:
    """By the stated system, or where there is none by the coordinates themselves, as the file has them."""
    degrees = np.random.default_rng(0).random((9, 3))
    with pytest.raises(SurveyError, match=r"is in degrees \(WGS 84\), but metres are needed"):
        read_cloud(write_las(tmp_path / "degrees.las", degrees, "EPSG:4326"))
    with pytest.raises(SurveyError, match=r"is in US survey foot \(.*\), but metres are needed"):
        read_cloud(write_las(tmp_path / "feet.las", XYZ, "EPSG:2263"))
    unstated = np.column_stack([
        8.5 + degrees[:, 0] / 99,
        47.2 + degrees[:, 1] / 99,
        400 + 20 * degrees[:, 2],
    ])
    with pytest.raises(SurveyError, match=r"x \(8\.5.* to 8\.5.*\) and y \(47\.2.*\) look like degrees"):
        read_cloud(write_las(tmp_path / "unstated.las", unstated, None))
