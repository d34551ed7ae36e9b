"""What is exported is what was surveyed, to a millimetre, where the CRS says, or no file at all."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import ezdxf
import laspy
import numpy as np
import pytest
from ezdxf.document import Drawing
from pyproj import CRS, Transformer
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from tests.support import many_spans, surveys
from tests.support.catenary_surveys import UTM, ZERO, corridor, line_of

from plnerf.capture.heights import heights_of, horizontal
from plnerf.capture.local_frame import LocalFrame
from plnerf.errors import CaptureError, SurveyError
from plnerf.export import crs, dxf, exports, gis, las, rows
from plnerf.export.crs import crs_transform
from plnerf.export.exports import Exports, write_exports
from plnerf.line.cloud import Cloud
from plnerf.line.ends import Open, Quantity
from plnerf.line.files import survey_json
from plnerf.line.frame import LineFrame
from plnerf.line.survey import Survey, WirePoints
from plnerf.report.page_tables import wire_tables
from plnerf.scene.ply import read_ply
from plnerf.survey.clearance import measure_clearances
from plnerf.survey.config_ground import ClearanceConfig
from plnerf.survey.fit import fit_wire

ORIGIN = np.array([9.0, 51.45, 250.0])
RD = np.array([155_000.0, 463_000.0, 0.0])
ALL = {
    "cloud.laz", "cloud.ply", "conductors.dxf", "conductors.csv", "conductors-projected.geojson",
    "conductors.geojson", "clearances.geojson", "clearances.csv", "structures.csv", "structures.geojson",
    "spans.csv", "phases.csv", "attachments.csv",
}  # fmt: skip


def measured(survey: Survey) -> Survey:
    """With its clearances, 5 m being required."""
    found, _ = measure_clearances(survey, ClearanceConfig(clearance_m=5.0))
    return replace(survey, clearances=found)


def reframed(survey: Survey, **changed: object) -> Survey:
    """The same in a LineFrame of other properties."""
    return replace(survey, frame=replace(survey.frame, **changed))


@pytest.fixture(scope="module")
def survey() -> Survey:
    return replace(measured(corridor(count=600)), from_images=True)


@pytest.fixture(scope="module")
def local() -> Survey:
    """In a world of metres east, north and up of an origin, from which the LineFrame is turned and moved."""
    frame = {"origin_world": np.array([40.0, -3.0, 7.0]), "R_line_world": surveys.turned(31.0)}
    return reframed(measured(corridor(ZERO, count=600)), origin_lon_lat_height=ORIGIN, **frame)


@pytest.fixture(scope="module")
def written(survey: Survey, tmp_path_factory: pytest.TempPathFactory) -> Exports:
    return write_exports(survey, tmp_path_factory.mktemp("utm"))


def world(survey: Survey, points: np.ndarray) -> np.ndarray:
    return survey.frame.to_world(points)


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_all_files_are_written(written: Exports) -> None:
    assert set(written.files) == ALL
    assert all(path.is_file() for path in written.files.values())
    assert not list(written.files["cloud.laz"].parent.glob("*partial*"))
    assert any("heights above what is not stated" in text for text in written.about)


def test_the_laz_is_what_the_format_asks_for(survey: Survey, written: Exports) -> None:
    read = laspy.read(written.files["cloud.laz"])
    header = read.header
    assert str(header.version) == "1.4" and header.point_format.id == 7 and header.global_encoding.wkt
    assert np.abs(read.xyz - world(survey, survey.cloud.xyz)).max() < 1e-3
    assert header.scales.tolist() == [0.001] * 3 and np.abs(header.offsets - UTM).max() < 200
    assert np.array_equal(read.classification, survey.cloud.label)
    assert np.array_equal(read.wire_id, survey.cloud.wire)
    assert np.allclose(read.sigma, survey.cloud.sigma_m) and read.sigma.dtype == np.float32
    assert np.array_equal(np.stack([read.red, read.green, read.blue], 1) // 257, survey.cloud.rgb)
    assert (np.asarray(read.synthetic) == 1).all() and (read.return_number == 1).all()
    assert (read.number_of_returns == 1).all()


def test_the_synthetic_flag_is_for_clouds_from_images(survey: Survey, tmp_path: Path) -> None:
    plain = replace(survey.cloud, sigma_m=None, rgb=None)
    las.write_las(tmp_path / "c.laz", plain, crs_transform(survey), synthetic=False)
    read = laspy.read(tmp_path / "c.laz")
    assert not np.asarray(read.synthetic).any() and "sigma" not in read.point_format.dimension_names


@pytest.mark.parametrize(
    ("name", "origin"),
    [
        ("EPSG:25832", UTM),
        ("EPSG:28992", RD),
        ("EPSG:7415", RD),
        ("EPSG:5972", UTM),
        ("EPSG:32633", UTM),
        ("+proj=utm +zone=32 +ellps=GRS80 +units=m", UTM),
    ],
)
def test_a_crs_comes_back_out_of_the_laz(name: str, origin: np.ndarray, tmp_path: Path) -> None:
    survey = reframed(corridor(origin, count=200), crs=name)
    laz = write_exports(survey, tmp_path).files["cloud.laz"]
    with laspy.open(laz) as file:
        header = file.header
        found = header.parse_crs()
    assert found.equals(CRS(name), ignore_axis_order=True) or found.to_epsg() == CRS(name).to_epsg()
    assert sum(vlr.record_id == 2112 for vlr in header.vlrs) == 1 and header.global_encoding.wkt
    assert not any(vlr.record_id in {34735, 34736, 34737} for vlr in header.vlrs)  # no GeoTIFF keys beside
    assert np.abs(laspy.read(laz).xyz - world(survey, survey.cloud.xyz)).max() < 1e-3


SOLID = CRS("EPSG:25832").to_3d().to_wkt()


@pytest.mark.parametrize(
    ("name", "kind", "words", "urn"),
    [
        ("EPSG:25832", "unknown", "heights above what is not stated", "urn:ogc:def:crs:EPSG::25832"),
        (SOLID, "ellipsoid", "heights above the ellipsoid of ETRS89", "urn:ogc:def:crs:EPSG::25832"),
        (
            "EPSG:25832+7837",
            "datum",
            "heights above DHHN2016 (EPSG:7837)",
            "urn:ogc:def:crs,crs:EPSG::25832,crs:EPSG::7837",
        ),
    ],
)
def test_every_file_names_what_its_heights_are_above(
    name: str, kind: str, words: str, urn: str, survey: Survey, tmp_path: Path
) -> None:
    """And none passes heights above the ellipsoid off as others, nor the other way round."""
    done = write_exports(reframed(survey, crs=name), tmp_path)
    whole = f"ETRS89 / UTM zone 32N (EPSG:25832), {words}"
    with laspy.open(done.files["cloud.laz"]) as file:
        found = file.header.parse_crs()
        (wkt,) = [vlr.string for vlr in file.header.vlrs if vlr.record_id == 2112]
    # The first WKT, as LAS 1.4 asks for it: the second one names them PROJCRS and COMPOUNDCRS.
    assert wkt.startswith("PROJCS[" if kind == "unknown" else "COMPD_CS[")
    assert found is not None and heights_of(found).kind == kind
    assert horizontal(found).to_epsg(min_confidence=20) == 25832
    assert kind != "datum" or found.sub_crs_list[1].to_epsg() == 7837
    assert ezdxf.readfile(done.files["conductors.dxf"]).header.custom_vars.get("REFERENCE") == whole
    for table_name in ("conductors.csv", "structures.csv", "clearances.csv"):
        assert {row["reference"] for row in table(done.files[table_name])} == {whole}
    projected = json.loads(done.files["conductors-projected.geojson"].read_text())
    assert projected["crs"]["properties"]["name"] == urn
    assert projected["heights"] == heights_of(name).words
    assert any(whole in text for text in done.about)
    on_earth = json.loads(done.files["conductors.geojson"].read_text())
    height = on_earth["features"][0]["geometry"]["coordinates"][0][2]
    assert height == pytest.approx(world(survey, survey.wires[0].points(np.zeros(1)))[0, 2], abs=0.01)
    # No grid of DHHN2016 is installed here: heights stay what they are, and the file says so.
    above = "above the WGS 84 ellipsoid" if kind == "ellipsoid" else heights_of(name).words
    assert on_earth["heights"] == above
    assert any("de_bkg_gcg2016.tif" in text for text in done.about) == (kind == "datum")


def test_the_ply_says_what_its_coordinates_refer_to(local: Survey, survey: Survey, tmp_path: Path) -> None:
    def comment(one: Survey) -> str:
        header = write_exports(one, tmp_path).files["cloud.ply"].read_bytes().split(b"end_header")[0]
        return next(line for line in header.decode().splitlines() if line.startswith("comment "))

    named = "ETRS89 / UTM zone 32N (EPSG:25832), heights above DHHN2016 (EPSG:7837)"
    assert comment(reframed(survey, crs="EPSG:25832+7837")) == f"comment {named}"
    place = "metres east, north and up of 9.0000000 degrees east, 51.4500000 degrees north, height 250.000 m"
    assert comment(reframed(local, crs="EPSG:25832+7837")) == f"comment {place} ({named})"


def test_longitudes_and_latitudes_have_heights_above_the_ellipsoid_where_a_grid_is_there(
    survey: Survey, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a datum 47 m above the ellipsoid, which falls by 1 m per degree northwards."""
    monkeypatch.setattr(crs, "datum_height_m", lambda name, lon_lat: 47.0 - (lon_lat[:, 1] - 51.0))
    done = write_exports(reframed(survey, crs="EPSG:25832+7837"), tmp_path)
    on_earth = json.loads(done.files["conductors.geojson"].read_text())
    _, latitude, height = on_earth["features"][0]["geometry"]["coordinates"][0]
    stated = world(survey, survey.wires[0].points(np.zeros(1)))[0, 2]
    assert height == pytest.approx(stated + 47.0 - (latitude - 51.0), abs=0.01)
    assert on_earth["heights"] == "above the WGS 84 ellipsoid"


def test_heights_in_feet_are_those_of_the_crs_in_the_files(local: Survey, tmp_path: Path) -> None:
    """New York's plane in survey feet over NAVD88 in feet: metres inside, feet outside."""
    place = np.array([-73.9, 40.7, 30.0])
    done = write_exports(reframed(local, crs="EPSG:2263+6360", origin_lon_lat_height=place), tmp_path)
    row, wire = table(done.files["structures.csv"])[0], local.structures[0]
    east = local.frame.to_world(wire.foot[None])[0]
    assert float(row["foot_z"]) * 1200 / 3937 == pytest.approx(30.0 + east[2], abs=0.01)
    assert "heights above NAVD88 (ftUS)" in row["reference"]
    assert ezdxf.readfile(done.files["conductors.dxf"]).header["$INSUNITS"] == 21


def test_geojson_has_longitudes_and_latitudes(survey: Survey, written: Exports) -> None:
    data = json.loads(written.files["conductors.geojson"].read_text())
    assert "crs" not in data and len(data["features"]) == 3  # RFC 7946 knows one CRS only
    independent = Transformer.from_crs("EPSG:4326", "EPSG:25832", always_xy=True)
    for feature, wire in zip(data["features"], survey.wires, strict=True):
        lon, lat, height = np.array(feature["geometry"]["coordinates"]).T
        line = world(survey, wire.polyline(exports.VERTEX_M))
        east, north = independent.transform(lon, lat)
        assert np.abs(np.stack([east, north, height], 1) - line).max() < 1e-3
        said = feature["properties"]
        assert (said["line"], said["span"], said["id"], said["kind"]) == (1, 1, wire.id, wire.kind)
        assert said["sag_m"] == pytest.approx(value(wire.sag), abs=1e-4)
        assert said["state"] == "as surveyed" and said["class_code"] == (13 if wire.kind == "shield" else 14)


def value(one: Quantity | None) -> float:
    assert one is not None
    return one.value


def half(one: Quantity | None) -> float:
    assert one is not None
    return one.half_95


def test_the_projected_copy_names_its_crs(survey: Survey, written: Exports) -> None:
    data = json.loads(written.files["conductors-projected.geojson"].read_text())
    assert data["crs"]["properties"]["name"] == "urn:ogc:def:crs:EPSG::25832"
    first = np.array(data["features"][0]["geometry"]["coordinates"])
    assert np.abs(first - world(survey, survey.wires[0].polyline(exports.VERTEX_M))).max() < 1e-3


def test_the_drawing_has_a_layer_for_each_kind(survey: Survey, written: Exports) -> None:
    drawing = ezdxf.readfile(written.files["conductors.dxf"])
    assert drawing.header["$INSUNITS"] == 6 and not drawing.audit().has_errors
    lines = list(drawing.modelspace().query("POLYLINE"))
    layers = {line.dxf.layer for line in lines}
    assert layers >= {"CONDUCTOR-PHASE", "CONDUCTOR-SHIELD", "STRUCTURE", "CLEARANCE-VEGETATION"}
    assert all(line.is_3d_polyline for line in lines)
    shield = next(line for line in lines if line.dxf.layer == "CONDUCTOR-SHIELD")
    vertices = np.array([list(point) for point in shield.points()])
    assert np.abs(vertices - world(survey, survey.wires[2].polyline(exports.VERTEX_M))).max() < 1e-3
    sag = survey.wires[2].sag
    said = [tag.value for tag in shield.get_xdata("PLNERF")]
    assert said[0] == 3 and f"sag {value(sag):.3f} +- {half(sag):.3f} m (95 %)" in said
    mast = next(line for line in lines if line.dxf.layer == "STRUCTURE")
    assert [point.z for point in mast.points()] == pytest.approx([0.0, 31.0])
    said = [tag.value for tag in mast.get_xdata("PLNERF")]
    assert said == [1, "line 1, structure 1", "unknown", "station 0.000 m", "given"]


def test_the_tables_hold_the_catenaries_and_the_verdicts(survey: Survey, written: Exports) -> None:
    for row, wire in zip(table(written.files["conductors.csv"]), survey.wires, strict=True):
        for name, one in (("sag", wire.sag), ("span", wire.span_m), ("length", wire.arc_m), ("p", wire.p_m)):
            assert float(row[f"{name}_m"]) == pytest.approx(value(one), abs=1e-4)
            assert float(row[f"{name}_95_m"]) == pytest.approx(half(one), abs=1e-4)
        assert row["no_sag_because"] == "" and (row["end_a"], row["end_b"]) == ("structure 1", "structure 2")
        dense = world(survey, wire.points(np.linspace(0, wire.base.length_m, 200_001)))
        lowest = [float(row[f"lowest_in_span_{axis}"]) for axis in "xyz"]
        assert lowest == pytest.approx(dense[dense[:, 2].argmin()], abs=1e-3)
        s = float(row["sag_from_a_m"])
        (_, z_a), (_, z_b), (_, z) = wire.at(np.array([0.0, wire.base.length_m, s]))
        chord = z_a + s / wire.base.length_m * (z_b - z_a)
        assert chord - z == pytest.approx(value(wire.sag), abs=1e-6)
        assert float(row["azimuth_deg"]) == pytest.approx(np.degrees(np.arctan(118 / 22)), abs=0.01)
        assert row["temperature_c"] == "" and row["span"] == "1"
    found = survey.clearances
    assert found is not None
    rows = table(written.files["clearances.csv"])
    assert [row["verdict"] for row in rows] == [found.verdict(place) or "" for place in found.all_places()]
    for row, place in zip(rows, found.all_places(), strict=True):
        assert float(row["distance_m"]) == pytest.approx(place.distance_m, abs=1e-4)
        assert float(row["distance_95_m"]) == pytest.approx(1.959964 * place.sigma_m, abs=1e-4)
        at = [float(row[f"on_obstacle_{axis}"]) for axis in "xyz"]
        assert at == pytest.approx(world(survey, place.on_obstacle), abs=1e-3)
    points = json.loads(written.files["clearances.geojson"].read_text())["features"]
    for point, row in zip(points, rows, strict=True):
        assert point["properties"]["distance_m"] == float(row["distance_m"])


def test_open_ends_have_no_figure_but_the_reason(survey: Survey, tmp_path: Path) -> None:
    line = survey.lines[0]
    first, *others = survey.wires
    cut = replace(first, ends=(first.ends[0], Open("the cloud ends there")))
    spans = (replace(line.spans[0], wires=(cut, *others)),)
    done = write_exports(replace(survey, lines=(replace(line, spans=spans),)), tmp_path)
    reason = "the last end is open (the cloud ends there)"
    row, other, _ = table(done.files["conductors.csv"])
    empty = [f"{name}{end}" for name in ("sag", "span", "length", "p") for end in ("_m", "_95_m")]
    assert {row[name] for name in (*empty, "sag_from_a_m")} == {""} and row["no_sag_because"] == reason
    assert row["end_b"] == "open: the cloud ends there" and other["no_sag_because"] == ""
    assert float(row["lowest_in_span_z"]) == pytest.approx(cut.lowest[1], abs=1e-3)
    said = json.loads(done.files["conductors.geojson"].read_text())["features"][0]["properties"]
    assert said["sag_m"] is said["span_m"] is said["p_m"] is None and said["no_sag_because"] == reason
    drawn = next(iter(ezdxf.readfile(done.files["conductors.dxf"]).modelspace().query("POLYLINE")))
    tags = [tag.value for tag in drawn.get_xdata("PLNERF") if not str(tag.value).startswith("swing")]
    assert tags == [1, "line 1, span 1", "sag -", "span length -", "p -", reason]


def test_the_lowest_point_is_between_the_ends(survey: Survey, written: Exports) -> None:
    """Of the steep shield wire the catenary's own lowest point lies before its first end."""
    row, wire = table(written.files["conductors.csv"])[2], survey.wires[2]
    assert wire.lowest[0] == 0.0
    assert [row[f"lowest_in_span_{axis}"] for axis in "xyz"] == [row[f"a_{axis}"] for axis in "xyz"]


def test_two_lines_keep_their_numbers(tmp_path: Path) -> None:
    done = write_exports(surveys.two_lines(), tmp_path)
    rows = table(done.files["conductors.csv"])
    assert [(row["line"], row["span"]) for row in rows] == [("1", "1")] * 5 + [("2", "1")] * 5
    assert [row["id"] for row in rows] == [str(k) for k in range(1, 11)]
    near = table(done.files["clearances.csv"])
    assert {row["line"] for row in near if int(row["wire"]) > 5} == {"2"}


@pytest.fixture(scope="module")
def bent() -> Survey:
    return many_spans.bent()


@pytest.fixture(scope="module")
def many(bent: Survey, tmp_path_factory: pytest.TempPathFactory) -> Exports:
    return write_exports(bent, tmp_path_factory.mktemp("bent"))


def test_rows_of_wires_say_where_along_their_line_they_hang(bent: Survey, many: Exports) -> None:
    rows = table(many.files["conductors.csv"])
    assert [row["span"] for row in rows] == [*"111122223333444"]
    assert [(row["line"], row["span"]) for row in rows[::4]] == [
        ("1", "1"),
        ("1", "2"),
        ("1", "3"),
        ("2", "4"),
    ]
    middle = rows[5]  # in the middle of the second span, and of its arms
    assert (middle["structure_a"], middle["structure_b"]) == ("2", "3")
    assert float(middle["station_a_m"]) == pytest.approx(80.62, abs=0.02)
    assert float(middle["station_b_m"]) == pytest.approx(172.41, abs=0.02)
    assert float(middle["swing_deg"]) == pytest.approx(6.0) and float(
        middle["swing_95_deg"]
    ) == pytest.approx(0.196, abs=0.001)
    assert rows[0]["swing_deg"] == rows[0]["swing_95_deg"] == ""
    assert (rows[9]["structure_a"], rows[9]["structure_b"], rows[9]["end_b"]) == ("3", "", "open: not filmed")
    for row, wire in zip(rows, bent.wires, strict=True):
        dense = wire.points(np.linspace(0, wire.base.length_m, 20_001))
        lowest = [float(row[f"lowest_in_span_{axis}"]) for axis in "xyz"]
        assert lowest == pytest.approx(world_map(bent, dense[[dense[:, 2].argmin()]])[0], abs=0.01)
    places = table(many.files["clearances.csv"])
    for row in places:
        low, high = (float(rows[int(row["wire"]) - 1][f"station_{end}_m"]) for end in "ab")
        assert low - 0.1 <= float(row["station_m"]) <= high + 0.1
    assert {row["line"] for row in places} == {"1", "2"} and {row["span"] for row in places} == set("1234")


def test_every_output_numbers_spans_structures_and_wires_alike(bent: Survey, many: Exports) -> None:
    """Tables, GeoJSON, drawing, cloud, survey.json and the report: from 1, through all lines."""
    wires = {
        (line.id, span.id, wire.id) for line in bent.lines for span in line.spans for wire in span.wires
    }
    structures = {(line.id, one.id) for line in bent.lines for one in line.structures}
    assert {span for _, span, _ in wires} == {1, 2, 3, 4} and {k for _, k in structures} == {1, 2, 3, 4, 5}

    def numbers(some: list, *names: str) -> set[tuple[int, ...]]:
        return {tuple(int(row[name]) for name in names) for row in some}

    def properties(name: str) -> list:
        return [one["properties"] for one in json.loads(many.files[name].read_text())["features"]]

    for found in (table(many.files["conductors.csv"]), properties("conductors-projected.geojson")):
        assert numbers(found, "line", "span", "id") == wires
    for found in (table(many.files["clearances.csv"]), properties("clearances.geojson")):
        assert numbers(found, "line", "span", "wire") == wires
    for found in (table(many.files["structures.csv"]), properties("structures.geojson")):
        assert numbers(found, "line", "structure") == structures
    drawn = set()
    for one in ezdxf.readfile(many.files["conductors.dxf"]).modelspace():
        number, about, *_ = (tag.value for tag in one.get_xdata("PLNERF"))
        if one.dxf.layer.startswith("CONDUCTOR"):
            line, span = (int(part.split()[1]) for part in about.split(", "))
            drawn.add((line, span, number))
    assert drawn == wires
    assert set(np.unique(laspy.read(many.files["cloud.laz"]).wire_id)) - {0} <= {k for *_, k in wires}
    written = survey_json(bent)
    assert {
        (line["id"], span["id"], wire["id"])
        for line in written["lines"] for span in line["spans"] for wire in span["wires"]
    } == wires  # fmt: skip
    shown = [(*str(row[1]).split(" / "), row[0]) for row in wire_tables(bent)[0].rows]
    assert {tuple(int(str(number)) for number in one) for one in shown} == wires


def test_the_lowest_point_is_that_in_the_span_and_is_named_so(written: Exports, survey: Survey) -> None:
    columns = [name for name in table(written.files["conductors.csv"])[0] if name.startswith("lowest")]
    assert columns == ["lowest_in_span_95_m", *(f"lowest_in_span_{axis}" for axis in "xyz")]
    wire = survey_json(survey)["lines"][0]["spans"][0]["wires"][2]
    assert [name for name in wire if name.startswith("lowest")] == ["lowest_in_span"]
    assert 0 <= wire["lowest_in_span"]["s"] <= wire["base"]["length"]


def world_map(survey: Survey, points: np.ndarray) -> np.ndarray:
    return crs_transform(survey).to_map(points)


def test_structures_have_a_table_and_places(bent: Survey, many: Exports) -> None:
    rows = table(many.files["structures.csv"])
    assert [(row["line"], row["structure"]) for row in rows] == [("1", k) for k in "123"] + [
        ("2", k) for k in "45"
    ]
    assert [row["kind"] for row in rows] == [one.kind for one in bent.structures]
    assert [float(row["station_m"]) for row in rows] == pytest.approx([0, 80.62, 172.41, 0, 114.02], abs=0.01)
    assert rows[0]["line_angle_deg"] == "" and float(rows[2]["line_angle_deg"]) == pytest.approx(
        27.1, abs=0.1
    )
    for row, one in zip(rows, bent.structures, strict=True):
        for name, point in (("foot", one.foot), ("top", one.top)):
            at = [float(row[f"{name}_{axis}"]) for axis in "xyz"]
            assert at == pytest.approx(world_map(bent, point[None])[0], abs=1e-3)
    data = json.loads(many.files["structures.geojson"].read_text())
    assert [one["properties"]["structure"] for one in data["features"]] == [1, 2, 3, 4, 5]
    lon, lat, _ = data["features"][2]["geometry"]["coordinates"]
    east, north = Transformer.from_crs("EPSG:4326", "EPSG:25832", always_xy=True).transform(lon, lat)
    assert [east, north] == pytest.approx([float(rows[2]["foot_x"]), float(rows[2]["foot_y"])], abs=0.01)


def test_lines_that_cross_have_a_table_and_a_layer(bent: Survey, many: Exports) -> None:
    rows = table(many.files["crossings.csv"])
    assert bent.clearances is not None
    assert len(rows) == len(bent.clearances.crossings) == 12
    for row, one in zip(rows, bent.clearances.crossings, strict=True):
        assert (row["line_above"], row["span_above"], row["wire_above"]) == ("1", "2", str(one.upper))
        assert (row["line_below"], row["span_below"], row["wire_below"]) == ("2", "4", str(one.lower))
        ends = np.array([[float(row[f"on_{end}_{axis}"]) for axis in "xyz"] for end in ("above", "below")])
        assert np.linalg.norm(ends[0] - ends[1]) == pytest.approx(float(row["distance_m"]), rel=1e-3)
    drawing = ezdxf.readfile(many.files["conductors.dxf"])
    lines = [line for line in drawing.modelspace() if line.dxf.layer == "CROSSING"]
    assert len(lines) == 12
    said = [tag.value for tag in lines[0].get_xdata("PLNERF")]
    assert said[:2] == [
        bent.clearances.crossings[0].upper,
        f"above wire {bent.clearances.crossings[0].lower}",
    ]
    swung = [tag.value for line in drawing.modelspace() for tag in line.get_xdata("PLNERF")]
    assert "swing 6.00 +- 0.20 degrees (95 %)" in swung and "line 1, span 2" in swung
    again = write_exports(
        replace(bent, lines=bent.lines[:1], clearances=None), many.files["cloud.laz"].parent
    )
    assert (
        "crossings.csv" not in again.files
        and not (again.files["cloud.laz"].parent / "crossings.csv").exists()
    )


def test_the_ply_is_in_the_world(survey: Survey, written: Exports) -> None:
    vertex = read_ply(written.files["cloud.ply"])["vertex"]
    assert np.array_equal(np.stack([vertex[axis] for axis in "xyz"], 1), world(survey, survey.cloud.xyz))
    assert np.array_equal(vertex["classification"], survey.cloud.label)


def test_points_that_a_field_shows_on_wires_are_in_the_world(local: Survey, tmp_path: Path) -> None:
    some = WirePoints(local.wires[0].polyline(0.5), np.arange(244) % 7, np.linspace(0, 1, 244), 300)
    done = write_exports(replace(local, wire_points=some), tmp_path)
    vertex = read_ply(done.files["wires.ply"])["vertex"]
    assert np.array_equal(np.stack([vertex[axis] for axis in "xyz"], 1), world(local, some.xyz))
    assert vertex["x"].dtype == np.float64 and np.array_equal(vertex["view"], some.view)
    assert np.array_equal(vertex["solid"], some.solid.astype(np.float32))
    assert "wires.ply" not in write_exports(local, tmp_path).files  # and the earlier one is gone
    assert not (tmp_path / "wires.ply").exists()


def test_local_metres_become_those_of_the_crs(local: Survey, tmp_path: Path) -> None:
    files = write_exports(local, tmp_path).files
    assert set(files) == ALL
    frame = LocalFrame("EPSG:25832", tuple(ORIGIN.tolist()))
    read = laspy.read(files["cloud.laz"])
    there = world(local, local.cloud.xyz)
    assert np.abs(read.xyz - frame.to_crs(there)).max() < 1e-3
    assert np.abs(frame.to_local(read.xyz) - there).max() < 1.5e-3
    data = json.loads(files["conductors.geojson"].read_text())
    place = np.array(data["features"][0]["geometry"]["coordinates"][0])
    start = world(local, local.wires[0].points(np.zeros(1)))
    assert place == pytest.approx(LocalFrame("EPSG:4979", frame.origin).to_crs(start)[0], abs=1e-4)
    assert place[:2] == pytest.approx(ORIGIN[:2], abs=1e-3)
    assert place[2] == pytest.approx(277.0, abs=0.05)
    vertex = read_ply(files["cloud.ply"])["vertex"]
    assert np.array_equal(vertex["x"], there[:, 0])
    azimuth = float(table(files["conductors.csv"])[0]["azimuth_deg"])
    assert azimuth == pytest.approx(np.degrees(np.arctan2(118, 22)) + 31.0, abs=0.01)


@pytest.mark.parametrize("name", ["survey", "local"])
def test_every_transform_can_be_undone(name: str, request: pytest.FixtureRequest) -> None:
    some: Survey = request.getfixturevalue(name)
    transform, points = crs_transform(some), some.cloud.xyz
    for there, back, within in (
        (transform.to_world, transform.from_world, 1e-8),
        # PROJ undoes the shift between ETRS89 and WGS 84 to a tenth of a millimetre.
        (transform.to_map, transform.from_map, 2e-4),
        (transform.to_lon_lat, transform.from_lon_lat, 2e-4),
    ):
        assert np.abs(back(there(points)) - points).max() < within


def test_degrees_are_no_metres(local: Survey, survey: Survey, tmp_path: Path) -> None:
    done = write_exports(reframed(local, crs="EPSG:4979"), tmp_path)
    with laspy.open(done.files["cloud.laz"]) as file:
        found = file.header.parse_crs()
    assert horizontal(found).to_epsg(min_confidence=20) == 32632 and heights_of(found).kind == "ellipsoid"
    assert "WGS 84 has longitudes and latitudes; files that need metres are in UTM" in done.about[0]
    orthometric = crs_transform(reframed(local, crs="EPSG:4326+5773"))
    assert orthometric.reference == "WGS 84 / UTM zone 32N (EPSG:32632), heights above EGM96 (EPSG:5773)"
    andes = np.array([-70.5, -33.0, 500.0])
    south = crs_transform(reframed(local, crs="EPSG:4979", origin_lon_lat_height=andes))
    assert south.crs is not None and horizontal(south.crs).to_epsg(min_confidence=20) == 32719
    with pytest.raises(SurveyError, match="are degrees, so that they hold no metres"):
        crs_transform(reframed(survey, crs="EPSG:4326"))


@pytest.mark.parametrize(("name", "said"), [("EPSG:3857", "is 0.50"), ("EPSG:2227", "is 0.30")])
def test_units_that_are_no_metres_are_refused(name: str, said: str) -> None:
    """Web Mercator far from the equator, and feet."""
    origin = np.array([1.2e6, 8.4e6, 0]) if name == "EPSG:3857" else np.array([6.1e6, 2.1e6, 0])
    with pytest.raises(SurveyError, match=said + r".* does not hold metres\. Project the cloud"):
        crs_transform(reframed(corridor(origin, count=50), crs=name))


def test_without_a_crs_the_local_files_are_written_and_the_others_named(
    survey: Survey, tmp_path: Path
) -> None:
    done = write_exports(reframed(survey, crs=None), tmp_path)
    assert set(done.files) == {
        "cloud.laz", "cloud.ply", "conductors.dxf", "conductors.csv", "clearances.csv", "structures.csv",
        "spans.csv", "phases.csv", "attachments.csv",
    }  # fmt: skip
    said = " ".join(done.about)
    assert "conductors-projected.geojson is left out" in said
    assert "conductors.geojson and clearances.geojson are left out: they need longitudes" in said
    with laspy.open(done.files["cloud.laz"]) as file:
        assert file.header.parse_crs() is None and file.header.global_encoding.wkt
    read = laspy.read(done.files["cloud.laz"])
    assert np.abs(read.xyz - world(survey, survey.cloud.xyz)).max() < 1e-3


def test_without_a_grid_for_heights_what_needs_them_is_left_out(
    survey: Survey, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_grid(name: str, xyz: np.ndarray) -> LocalFrame:
        raise CaptureError(f"{name} needs its grid")

    monkeypatch.setattr(crs, "local_frame", no_grid)
    done = write_exports(survey, tmp_path)
    assert set(done.files) == ALL - {"conductors.geojson", "clearances.geojson", "structures.geojson"}
    assert any("not known: EPSG:25832 needs its grid" in text for text in done.about)


def test_a_survey_without_scale_claims_no_metres(tmp_path: Path) -> None:
    """Its files hold LineFrame coordinates, whatever the unit of its world."""
    survey = surveys.unscaled()
    done = write_exports(survey, tmp_path)
    assert set(done.files) == {
        "cloud.laz", "cloud.ply", "conductors.dxf", "conductors.csv", "structures.csv",
    }  # fmt: skip
    assert any("unscaled" in text and "not in metres" in text for text in done.about)
    assert any("There are no clearances" in text for text in done.about)
    rows = table(done.files["conductors.csv"])
    assert "sag_unscaled" in rows[0] and "sag_95_unscaled" in rows[0]
    assert not [name for name in rows[0] if name.endswith("_m")]
    assert float(rows[0]["lowest_in_span_z"]) == pytest.approx(survey.wires[0].lowest[1], abs=1e-4)
    assert ezdxf.readfile(done.files["conductors.dxf"]).header["$INSUNITS"] == 0
    vertex = read_ply(done.files["cloud.ply"])["vertex"]
    assert np.array_equal(vertex["z"], survey.cloud.xyz[:, 2])


def test_an_empty_survey_is_written_and_says_so(survey: Survey, tmp_path: Path) -> None:
    done = write_exports(replace(survey, lines=(), clearances=None, cloud=Cloud.empty()), tmp_path)
    assert set(done.files) == {"cloud.laz", "cloud.ply", "conductors.dxf"}
    assert any("No wires were found" in text for text in done.about)


@pytest.mark.parametrize(
    ("module", "name", "value", "file"),
    [
        (las, "SCALE", 0.01, "cloud.laz"),
        (gis, "DEGREE_DECIMALS", 6, "conductors.geojson"),
        (gis, "METRE_DECIMALS", 1, "conductors-projected.geojson"),
    ],
)
def test_a_file_that_reads_back_differently_is_not_kept(
    survey: Survey, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    module: object, name: str, value: object, file: str,
) -> None:  # fmt: skip
    monkeypatch.setattr(module, name, value)
    with pytest.raises(SurveyError, match=f"{file} reads back differently"):
        write_exports(survey, tmp_path)
    assert not (tmp_path / file).exists() and not list(tmp_path.glob("*partial*"))


def test_a_table_that_reads_back_differently_is_not_kept(tmp_path: Path) -> None:
    with pytest.raises(SurveyError, match="reads back differently: numbers of the column 'a' differ"):
        rows.write_csv(tmp_path / "t.csv", [{"a": float("nan")}], ["a"])
    assert not (tmp_path / "t.csv").exists()


def test_a_drawing_that_reads_back_differently_is_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    line = dxf.Drawn("STRUCTURE", 1, np.array([UTM, UTM + 1]))
    read = dxf.readfile

    def moved(path: Path) -> Drawing:
        drawing = read(path)
        drawing.modelspace()[0].translate(0, 0.002, 0)
        return drawing

    monkeypatch.setattr(dxf, "readfile", moved)
    with pytest.raises(SurveyError, match=r"of its 2 vertices, number 0 \(from 0\) should be at"):
        dxf.write_dxf(tmp_path / "t.dxf", [line], "metre", "somewhere")
    assert not list(tmp_path.iterdir())


def test_long_texts_are_cut_where_dxf_allows_no_more(tmp_path: Path) -> None:
    line = dxf.Drawn("STRUCTURE", 1, np.array([UTM, UTM + 1]), ("ä" * 200,))
    dxf.write_dxf(tmp_path / "t.dxf", [line], "metre", "somewhere")
    (read,) = ezdxf.readfile(tmp_path / "t.dxf").modelspace()
    assert read.get_xdata("PLNERF")[-1].value == "ä" * 127


def test_a_cloud_wider_than_las_can_hold_is_refused(survey: Survey, tmp_path: Path) -> None:
    cloud = replace(survey.cloud, xyz=survey.cloud.xyz.copy())
    cloud.xyz[-1] += 3e6
    transform = crs_transform(reframed(survey, crs=None))
    with pytest.raises(SurveyError, match=r"cannot hold the cloud, which is wider than 2147484 m"):
        las.write_las(tmp_path / "c.laz", cloud, transform, synthetic=False)
    assert not list(tmp_path.iterdir())


def test_a_crs_that_is_none_is_refused(survey: Survey, tmp_path: Path) -> None:
    with pytest.raises(SurveyError, match=r"'EPSG:0' of cloud.laz is not known"):
        write_exports(reframed(survey, crs="EPSG:0"), tmp_path)


@pytest.mark.slow
@pytest.mark.data
def test_a_real_cloud_of_lidar_is_exported_to_the_millimetre(shared_data: Path, tmp_path: Path) -> None:
    """Airborne LiDAR of a 380 kV line in RD New; of its wires, the longest piece in one."""
    cloud = laspy.read(shared_data / "lidar" / "12AN2_20.laz")
    code = np.asarray(cloud.classification, dtype=np.uint8)
    some = (code == 14) | (np.arange(len(code)) % 4 == 0)
    label = code[some]
    frame = LineFrame.of_cloud(cloud.xyz, "EPSG:28992")
    xyz = frame.from_world(cloud.xyz[some])
    on = np.flatnonzero(label == 14)
    pairs = cKDTree(xyz[on]).query_pairs(1.0, output_type="ndarray")
    near = coo_matrix((np.ones(len(pairs)), pairs.T), (len(on), len(on)))
    piece = connected_components(near, directed=False)[1]
    mine = on[piece == np.bincount(piece).argmax()]
    of_wire = np.zeros(len(xyz), np.int64)
    of_wire[mine] = 1
    found, inlier = fit_wire(xyz[mine])
    wire = replace(found, id=1, kind="phase")
    survey = Survey(frame, (line_of([wire]),), Cloud(xyz, label, of_wire), "12AN2_20.laz")
    assert inlier.mean() > 0.99 and wire.base.length_m > 200 and wire.open is not None
    survey = replace(survey, clearances=measure_clearances(survey, ClearanceConfig())[0])
    files = write_exports(survey, tmp_path).files
    assert set(files) == ALL - {"structures.csv", "structures.geojson", "attachments.csv"}
    back = laspy.read(files["cloud.laz"])
    assert np.abs(back.xyz - cloud.xyz[some]).max() <= 1e-3
    assert np.array_equal(back.classification, label)
    assert back.header.parse_crs().to_epsg() == 28992
    line = wire.polyline(0.02)
    assert survey.clearances is not None
    for group, codes in (("ground", (2, 9)), ("vegetation", (5,))):
        least = survey.clearances.wires[0].least(group)
        assert least is not None and least.distance_m == pytest.approx(
            cKDTree(line).query(xyz[np.isin(label, codes)])[0].min(), abs=1e-3
        )
