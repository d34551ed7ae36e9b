"""What a LAS file says of its points comes out as it went in."""

from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pytest
from tests.survey.lidar.test_las import XYZ

from plnerf.export.crs import crs_transform
from plnerf.export.las import write_las
from plnerf.line.cloud import Cloud
from plnerf.line.frame import LineFrame
from plnerf.line.survey import Survey
from plnerf.survey.lidar.point_cloud import read_cloud

N = len(XYZ)


def written(path: Path, point_format: int) -> laspy.LasData:
    """A file with every attribute that its point format has, and extra bytes of several kinds."""
    random = np.random.default_rng(point_format)
    header = laspy.LasHeader(point_format=point_format, version="1.4" if point_format > 5 else "1.2")
    header.scales, header.offsets = [0.001] * 3, np.floor(XYZ.min(0))
    header.global_encoding.gps_time_type = laspy.header.GpsTimeType.STANDARD
    for params in (
        laspy.ExtraBytesParams(
            "amplitude", "uint16", "echo", scales=np.array([0.01]), offsets=np.array([5.0])
        ),
        laspy.ExtraBytesParams("normal", "3f4", "of the surface"),
        laspy.ExtraBytesParams("wire_id", "int8", "somebody's own"),
        laspy.ExtraBytesParams("reflectance", "float64", no_data=np.array([-9999.0])),
    ):
        header.add_extra_dim(params)
    las = laspy.LasData(header)
    las.xyz = XYZ
    most = {
        "intensity": 65535, "user_data": 255, "point_source_id": 65535, "return_number": 7,
        "number_of_returns": 7, "edge_of_flight_line": 1, "scan_direction_flag": 1, "synthetic": 1,
        "key_point": 1, "withheld": 1, "classification": 31,
    }  # fmt: skip
    for name, highest in most.items():
        las[name] = random.integers(0, highest + 1, N)
    las.gps_time = random.uniform(0, 1e9, N)
    for name in {"red", "green", "blue", "nir"} & set(las.point_format.dimension_names):
        las[name] = random.integers(0, 65536, N)
    if point_format > 5:
        las.scan_angle = random.integers(-15000, 15000, N)
        las.scanner_channel, las.overlap = random.integers(0, 4, N), random.integers(0, 2, N)
    else:
        las.scan_angle_rank = random.integers(-90, 90, N)
    las.points.array["amplitude"] = random.integers(0, 65536, N)
    las.normal = random.normal(size=(N, 3)).astype(np.float32)
    las.points.array["wire_id"] = random.integers(-100, 100, N)
    las.reflectance = np.where(random.random(N) < 0.1, np.nan, random.normal(size=N))
    las.write(path)
    return las


def exported(path: Path, *, keep_classes: bool = False) -> tuple[laspy.LasData, Cloud]:
    """The file as a survey of the cloud writes it, with classes and wires of its own."""
    read = read_cloud(path)
    assert read.attributes is not None
    frame = LineFrame.of_cloud(read.xyz, read.crs)
    cloud = Cloud(
        frame.from_world(read.xyz), np.arange(N).astype(np.uint8) % 7, np.arange(N) % 3,
        attributes=replace(read.attributes, keep_classes=keep_classes),
    )  # fmt: skip
    survey = Survey(frame, (), cloud, str(path))
    out = path.with_name("out.laz")
    write_las(out, cloud, crs_transform(survey), synthetic=False)
    return laspy.read(out), cloud


@pytest.mark.parametrize(("point_format", "out_format"), [(1, 7), (3, 7), (6, 7), (7, 7), (8, 8)])
def test_attributes_come_out_as_they_went_in(point_format: int, out_format: int, tmp_path: Path) -> None:
    given = written(tmp_path / "in.las", point_format)
    found, cloud = exported(tmp_path / "in.las")
    assert found.header.point_format.id == out_format
    assert found.header.global_encoding.gps_time_type == laspy.header.GpsTimeType.STANDARD
    assert np.abs(found.xyz - XYZ).max() < 1.5e-3
    others = {"X", "Y", "Z", "classification", "scan_angle_rank"}
    same = set(given.point_format.standard_dimension_names) - others
    assert {"intensity", "gps_time", "point_source_id", "return_number"} <= same
    for name in same:
        assert np.array_equal(found[name], given[name]), name
    if point_format < 6:
        assert np.abs(found.scan_angle * 0.006 - given.scan_angle_rank).max() < 0.004
    assert np.array_equal(found.amplitude, given.amplitude) and np.array_equal(found.normal, given.normal)
    assert np.array_equal(found.reflectance, given.reflectance, equal_nan=True)
    assert np.array_equal(found.points.array["input_wire_id"], given.points.array["wire_id"])
    assert np.array_equal(found.wire_id, cloud.wire) and np.array_equal(found.classification, cloud.label)
    (amplitude,) = (one for one in found.point_format.extra_dimensions if one.name == "amplitude")
    assert (amplitude.scales, amplitude.offsets, amplitude.description) == ([0.01], [5.0], "echo")


@pytest.mark.parametrize("point_format", [3, 7])
def test_classes_are_kept_on_request(point_format: int, tmp_path: Path) -> None:
    given = written(tmp_path / "in.las", point_format)
    found, cloud = exported(tmp_path / "in.las", keep_classes=True)
    assert np.array_equal(found.classification, given.classification)
    assert np.array_equal(found.plnerf_class, cloud.label)


@pytest.mark.data
def test_extra_bytes_of_the_name_of_a_standard_dimension(shared_data: Path, tmp_path: Path) -> None:
    """As in a real file whose extra bytes are called "classification"."""
    path = shared_data / "lidar" / "toronto3d_L002.las"
    raw = laspy.read(path).points.array
    read = read_cloud(path)
    assert read.attributes is not None
    cloud = Cloud(
        LineFrame.of_cloud(read.xyz, None).from_world(read.xyz), read.attributes.label,
        np.zeros(len(read.xyz), np.int64), attributes=read.attributes,
    )  # fmt: skip
    survey = Survey(LineFrame.of_cloud(read.xyz, None), (), cloud, str(path))
    write_las(tmp_path / "out.laz", cloud, crs_transform(survey), synthetic=False)
    found = laspy.read(tmp_path / "out.laz").points.array
    assert np.array_equal(found["input_classification"], raw["classification"])
    assert np.array_equal(found["prediction"], raw["prediction"])
    assert np.array_equal(read.attributes.label, raw["raw_classification"] & 31)
