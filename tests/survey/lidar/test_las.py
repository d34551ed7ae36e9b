"""LAS and LAZ files are read whole, as metres, or not at all."""

from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS

from plnerf.capture.heights import height_unit_m, heights_of, horizontal, known_crs, with_heights
from plnerf.capture.local_frame import LocalFrame
from plnerf.errors import SurveyError
from plnerf.export.crs import crs_transform
from plnerf.line.cloud import Cloud
from plnerf.line.frame import LineFrame
from plnerf.line.survey import Survey
from plnerf.survey.lidar.config import CloudConfig
from plnerf.survey.lidar.point_cloud import read_cloud

XYZ = np.random.default_rng(0).uniform([230_000, 570_000, 0], [230_090, 570_040, 30], (500, 3))


def write_las(
    path: Path, xyz: np.ndarray, crs: str | None = "EPSG:28992", scale: float = 0.001
) -> Path:
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales, header.offsets = [scale] * 3, np.floor(xyz.min(0)) if len(xyz) else np.zeros(3)
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


def write_in(path: Path, crs: str, scale: float, lonlat: tuple[float, float, float]) -> Path:
    """The points of `XYZ` about a place of the earth, in a CRS's own units."""
    local = XYZ - XYZ.mean(0)
    there = LocalFrame(crs, lonlat).to_crs(local)
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales, header.offsets = [scale, scale, 0.001], np.floor(there.min(0))
    header.add_crs(CRS(crs))
    las = laspy.LasData(header)
    las.xyz = there
    las.write(path)
    return path


@pytest.mark.parametrize(
    ("crs", "scale", "place", "units"),
    [
        ("EPSG:2263+6360", 0.001, (-73.9, 40.7, 30.0), "US survey foot"),
        ("EPSG:26918+6360", 0.001, (-73.9, 40.7, 30.0), "metre and US survey foot"),
        ("EPSG:4326+5773", 1e-9, (8.5, 47.2, 430.0), "degree and metre"),
        ("EPSG:4979", 1e-9, (8.5, 47.2, 430.0), "degree and metre"),
    ],
)
def test_feet_and_degrees_become_metres_and_go_out_as_they_came(
    crs: str, scale: float, place: tuple[float, float, float], units: str, tmp_path: Path
) -> None:
    cloud = read_cloud(write_in(tmp_path / "cloud.las", crs, scale, place))
    (said,) = cloud.findings
    assert f"The file is in {units} (" in said.what and "read as metres" in said.what
    middle = XYZ - XYZ.mean(0)
    assert np.abs(cloud.xyz - cloud.xyz.mean(0) - middle).max() < 0.02  # level where the frame's origin is
    assert cloud.origin is not None and heights_of(cloud.crs) == heights_of(crs)
    survey = Survey(LineFrame.of_cloud(cloud.xyz, cloud.crs, cloud.origin), (), Cloud.empty(), "cloud.las")
    transform = crs_transform(survey)
    back = transform.to_map(survey.frame.from_world(cloud.xyz))
    stated = laspy.read(tmp_path / "cloud.las").xyz
    if not CRS(crs).is_geographic:
        assert transform.crs is not None and horizontal(transform.crs) == horizontal(CRS(crs))
        assert np.abs(back - stated).max() < 1e-3
    else:
        assert "UTM" in transform.about[0]
        lon_lat = transform.to_lon_lat(survey.frame.from_world(cloud.xyz))
        assert np.abs(lon_lat - stated).max() < 1e-3


def test_heights_without_a_unit_are_in_that_of_the_other_coordinates(tmp_path: Path) -> None:
    feet = np.array([1_000_000.0, 200_000.0, 100.0]) + (XYZ - XYZ.mean(0)) / 0.3048006
    cloud = read_cloud(write_las(tmp_path / "feet.las", feet, "EPSG:2263"))
    assert np.abs(np.ptp(cloud.xyz, axis=0) - np.ptp(XYZ, axis=0)).max() < 0.05  # grid north is not north
    kinds = [(one.degree, "no unit of its heights" in one.what) for one in cloud.findings]
    assert kinds == [("note", False), ("harms", True)]
    assert heights_of(cloud.crs).kind == "unknown" and height_unit_m(known_crs(cloud.crs or "")) < 0.31
    stated = with_heights(cloud.crs or "", "EPSG:6360")
    assert stated == "EPSG:2263+6360"


def test_compound_systems_of_metres_stay_as_they_are(tmp_path: Path) -> None:
    for name, found in (("EPSG:7415", "EPSG:7415"), ("EPSG:25832+7837", "EPSG:25832+7837")):
        cloud = read_cloud(write_las(tmp_path / "cloud.las", XYZ, name))
        assert cloud.crs == found and cloud.origin is None and cloud.findings == ()


def test_coordinates_that_are_none_are_told(tmp_path: Path) -> None:
    """Degrees too coarse for wires, degrees without a system, and coordinates of another system."""
    degrees = np.random.default_rng(0).random((9, 3))
    with pytest.raises(SurveyError, match=r"degrees in steps of 1\.1e\+02 m on the ground, too coarse"):
        read_cloud(write_las(tmp_path / "degrees.las", degrees, "EPSG:4326"))
    wrong = write_las(tmp_path / "wrong.las", degrees + np.array([8.0, 400.0, 0.0]), "EPSG:4326", 1e-7)
    with pytest.raises(SurveyError, match=r"wrong.las are none of WGS 84 \(EPSG:4326\), heights .* Correct"):
        read_cloud(wrong)
    unstated = np.column_stack([
        8.5 + degrees[:, 0] / 99,
        47.2 + degrees[:, 1] / 99,
        400 + 20 * degrees[:, 2],
    ])
    with pytest.raises(SurveyError, match=r"x \(8\.5.* to 8\.5.*\) and y \(47\.2.*\) look like degrees"):
        read_cloud(write_las(tmp_path / "unstated.las", unstated, None))
