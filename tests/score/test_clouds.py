"""Points of wires come out of every format as they went in; polylines are sampled evenly and densely."""

import json
from pathlib import Path

import laspy
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from plnerf.errors import SurveyError
from plnerf.line.polylines import lengths_along, onto_segments, resample
from plnerf.scene.ply import read_ply, write_ply
from plnerf.score.clouds import read_points, sample_lines
from plnerf.score.config import DEFAULT

STEP_M = DEFAULT.points.line_step_m
POINTS = np.array([[-19.818743705, 3.25, 9.05], [0.0, -1e-3, 7.84], [12.123, 54.456, 12.25]]) + np.array([
    4e5,
    5.4e6,
    800.0,
])  # as a survey's coordinates are
LINE = np.array([[0.0, 0.0, 10.0], [3.0, 4.0, 10.0], [3.0, 4.0, 8.0]])


def write_las(path: Path, points: np.ndarray, classes: list[int]) -> None:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 0.001), np.round(points.mean(0))
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.classification = np.array(classes, dtype=np.uint8)
    las.write(str(path))


def text_of(points: np.ndarray, mark: str, names: str) -> str:
    return "\n".join([names, *(mark.join(f"{value:.9f}" for value in row) for row in points)]) + "\n"


@pytest.mark.parametrize("kind", ["ply", "npy", "npz", "csv", "txt", "xyz", "geojson", "las", "laz"])
def test_what_is_written_is_read(kind: str, tmp_path: Path) -> None:
    path = tmp_path / f"wires.{kind}"
    match kind:
        case "ply":
            write_ply(path, POINTS, {"wire": np.arange(3, dtype=np.int32)})
        case "npy":
            np.save(path, np.c_[POINTS, np.ones(3)])
        case "npz":
            np.savez(path, points=POINTS, colours=np.ones((3, 3)))
        case "csv":
            path.write_text(text_of(np.c_[np.ones(3), POINTS], ";", "id;X;Y;Z"))
        case "txt":
            path.write_text(text_of(np.c_[POINTS, np.ones(3)], " ", "//X Y Z R"))
        case "xyz":
            path.write_text("\n".join(" ".join(f"{value:.9f}" for value in row) for row in POINTS))
        case "geojson":
            geometry = {"type": "MultiPoint", "coordinates": POINTS.tolist()}
            path.write_text(json.dumps({"type": "Feature", "properties": {}, "geometry": geometry}))
        case _:
            write_las(path, POINTS, [14, 14, 13])
    tolerance = 5.1e-4 if kind in {"las", "laz"} else 1e-9
    assert np.abs(read_points(path).points - POINTS).max() <= tolerance


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_of_other_programs(form: str, tmp_path: Path) -> None:
    """Floats beside bytes, comments, an element that is passed over, and faces after the vertices."""
    path = tmp_path / "cloud.ply"
    order = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}[form]
    camera = np.array([(1.5,)], [("k", f"{order}f4")])
    dtype = [("red", "u1"), ("z", f"{order}f4"), ("x", f"{order}f8"), ("y", f"{order}f4")]
    vertices = np.array([(7, 3.5, 1.0, 2.0), (8, 6.5, 4.0, 5.0)], dtype)
    header = (
        f"ply\nformat {form} 1.0\ncomment by hand\nobj_info more\nelement camera 1\nproperty float k\n"
        "element vertex 2\nproperty uchar red\nproperty float z\nproperty double x\nproperty float32 y\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    )
    if form == "ascii":
        body = b"1.5\n7 3.5 1 2\n8 6.5 4 5\n3 0 1 0\n"
    else:
        body = camera.tobytes() + vertices.tobytes() + b"\x03" + b"\x00" * 12
    path.write_bytes(header.encode() + body)
    assert read_points(path).points.tolist() == [[1, 2, 3.5], [4, 5, 6.5]]
    assert read_ply(path)["vertex"]["red"].tolist() == [7, 8]


def test_attributes_keep_their_types(tmp_path: Path) -> None:
    given_ = {"wire": np.array([3, 1, 2], np.uint16), "sigma_m": np.array([0.1, np.inf, 0.2], np.float32)}
    write_ply(tmp_path / "a.ply", POINTS, given_)
    vertex = read_ply(tmp_path / "a.ply")["vertex"]
    for name, column in given_.items():
        assert vertex[name].dtype == column.dtype and (vertex[name] == column).all()
    with pytest.raises(ValueError, match="int64"):
        write_ply(tmp_path / "b.ply", POINTS, {"wire": np.arange(3)})
    assert not (tmp_path / "b.ply").exists()


def test_lines_are_lines_in_every_format(tmp_path: Path) -> None:
    """As LineString, as MultiLineString in a collection, and as the edges of a PLY: the same points."""
    line = {"type": "LineString", "coordinates": LINE.tolist()}
    many = {"type": "MultiLineString", "coordinates": [LINE.tolist()]}
    (tmp_path / "a.geojson").write_text(json.dumps(line))
    nested = {"type": "GeometryCollection", "geometries": [many]}
    collection = {"type": "FeatureCollection", "features": [{"type": "Feature", "geometry": nested}]}
    (tmp_path / "b.geojson").write_text(json.dumps(collection))
    assert (read_points(tmp_path / "a.geojson").points == sample_lines([LINE], STEP_M)).all()
    assert (read_points(tmp_path / "b.geojson").points == sample_lines([LINE], STEP_M)).all()
    vertices = "\n".join(" ".join(map(str, row)) for row in LINE)
    (tmp_path / "c.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        f"element edge 2\nproperty int vertex1\nproperty int vertex2\nend_header\n{vertices}\n0 1\n1 2\n"
    )
    assert (read_points(tmp_path / "c.ply").points == sample_lines([LINE[:2], LINE[1:]], STEP_M)).all()


@pytest.mark.slow
@settings(deadline=None)
@given(
    st.lists(st.tuples(*[st.floats(-50, 50)] * 3), min_size=1, max_size=6),
    st.floats(0.05, 20),
)
def test_samples_lie_on_the_line_evenly_from_end_to_end(
    vertices: list[tuple[float, ...]], step: float
) -> None:
    line = np.array(vertices)
    samples = resample(line, step)
    total = lengths_along(line)[-1]
    assert np.allclose(samples[0], line[0]) and np.allclose(samples[-1], line[-1] if total else line[0])
    for sample in samples:
        if len(line) > 1:
            ones = np.repeat(sample[None], len(line) - 1, axis=0)
            share = onto_segments(ones, line[:-1], line[1:])[:, None]
            assert np.linalg.norm(line[:-1] + share * np.diff(line, axis=0) - ones, axis=1).min() < 1e-9
    assert (np.linalg.norm(np.diff(samples, axis=0), axis=1) <= step * (1 + 1e-9)).all()


def test_sampling_changes_no_distance_by_more_than_is_said() -> None:
    """At 5 cm beside a line, the nearest sample is as near as the line, to 0.3 mm."""
    samples = sample_lines([np.array([[0.0, 0, 0], [7.003, 0, 0]])], STEP_M)
    beside = np.c_[np.linspace(0, 7, 9999), np.full(9999, 0.05), np.zeros(9999)]
    distance, _ = cKDTree(samples).query(beside)
    assert distance.max() - 0.05 < 3e-4 and STEP_M == 0.01


def test_classes_of_las(tmp_path: Path) -> None:
    points = np.random.default_rng(0).uniform(0, 40, (8, 3)).round(3)
    write_las(tmp_path / "a.laz", points, [2, 2, 5, 13, 14, 14, 15, 7])
    cloud = read_points(tmp_path / "a.laz")
    assert np.allclose(cloud.points, points[3:6], atol=5.1e-4) and "class 13, 14" in cloud.taken
    assert np.allclose(read_points(tmp_path / "a.laz", classes=(15, 5)).points, points[[2, 6]], atol=5.1e-4)
    write_las(tmp_path / "b.las", points, [2, 2, 5, 1, 1, 1, 15, 7])
    assert len(read_points(tmp_path / "b.las").points) == 8
    with pytest.raises(SurveyError, match=r"no points of class 14; its classes are 1, 2, 5, 7, 15"):
        read_points(tmp_path / "b.las", classes=(14,))


def test_files_that_say_that_they_are_empty_give_no_points(tmp_path: Path) -> None:
    write_ply(tmp_path / "a.ply", np.empty((0, 3)))
    np.save(tmp_path / "a.npy", np.empty((0, 3)))
    (tmp_path / "a.csv").write_text("x,y,z\n")
    (tmp_path / "a.geojson").write_text('{"type": "FeatureCollection", "features": []}')
    laspy.LasData(laspy.LasHeader(point_format=6, version="1.4")).write(str(tmp_path / "a.las"))
    for path in tmp_path.iterdir():
        assert read_points(path).points.shape == (0, 3), path.name


def test_lines_too_long_to_sample_are_refused(tmp_path: Path) -> None:
    line = {"type": "LineString", "coordinates": [[0, 0, 0], [1e15, 0, 0]]}
    (tmp_path / "a.geojson").write_text(json.dumps(line))
    with pytest.raises(SurveyError, match="The lines are 1,000,000,000,000,000 m long"):
        read_points(tmp_path / "a.geojson")
    line["coordinates"] = [[0, 0, 0], [1e300, 0, 0]]  # whose square is infinite
    (tmp_path / "a.geojson").write_text(json.dumps(line))
    with np.errstate(over="ignore"), pytest.raises(SurveyError, match="The lines are inf m long"):
        read_points(tmp_path / "a.geojson")


def test_an_error_names_no_thousand_columns(tmp_path: Path) -> None:
    (tmp_path / "wide.csv").write_text(",".join(["5"] * 5000 + ["a"]))
    with pytest.raises(SurveyError, match="there is no x and no y") as raised:
        read_points(tmp_path / "wide.csv")
    assert len(str(raised.value)) < 1000
