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
from tests.support.catenary_surveys import UTM, corridor

from plnerf.capture.local_frame import LocalFrame
from plnerf.errors import CaptureError, SurveyError
from plnerf.export import crs as places
from plnerf.export import dxf, exports, gis, las, tables
from plnerf.export.crs import places_of
from plnerf.export.files import write_exports
from plnerf.export.las import wkt_of
from plnerf.scene.ply import read_ply
from plnerf.survey.clearance import measure_clearances
from plnerf.survey.fit import fit_catenary
from plnerf.survey.model import Cloud, Conductor, Survey
from plnerf.survey.thresholds import own_requirement

ORIGIN = np.array([9.0, 51.45, 250.0])
RD = np.array([155_000.0, 463_000.0, 0.0])
ALL = {
    "cloud.laz", "cloud.ply", "conductors.dxf", "conductors.csv", "conductors-projected.geojson",
    "conductors.geojson", "clearances.geojson", "clearances.csv",
}  # fmt: skip


def export(survey: Survey, folder: Path, *, synthetic: bool = False) -> exports.Exports:
    return write_exports(
        survey, measure_clearances(survey, own_requirement(5.0)), folder, synthetic=synthetic
    )


@pytest.fixture(scope="module")
def survey() -> Survey:
    return corridor(count=600)


@pytest.fixture(scope="module")
def local() -> Survey:
    """In metres east, north and up of an origin."""
    return replace(corridor(np.zeros(3), count=600), origin=ORIGIN)


@pytest.fixture(scope="module")
def written(survey: Survey, tmp_path_factory: pytest.TempPathFactory) -> exports.Exports:
    return export(survey, tmp_path_factory.mktemp("utm"), synthetic=True)


def test_all_files_are_written(written: exports.Exports) -> None:
    assert set(written.files) == ALL
    assert all(path.is_file() for path in written.files.values())
    assert not list(written.files["cloud.laz"].parent.glob("*partial*"))
    assert any("says nothing of heights" in note for note in written.notes)


def test_the_laz_is_what_the_format_asks_for(survey: Survey, written: exports.Exports) -> None:
    las = laspy.read(written.files["cloud.laz"])
    header = las.header
    assert str(header.version) == "1.4" and header.point_format.id == 7 and header.global_encoding.wkt
    assert np.abs(las.xyz - survey.cloud.xyz).max() < 1e-3
    assert header.scales.tolist() == [0.001] * 3 and np.abs(header.offsets - UTM).max() < 200
    assert np.array_equal(las.classification, survey.cloud.label)
    assert np.array_equal(las.wire_id, survey.cloud.wire)
    assert np.allclose(las.sigma, survey.cloud.sigma_m) and las.sigma.dtype == np.float32
    assert np.array_equal(np.stack([las.red, las.green, las.blue], 1) // 257, survey.cloud.rgb)
    assert (np.asarray(las.synthetic) == 1).all() and (las.return_number == 1).all()
    assert (las.number_of_returns == 1).all()


def test_the_synthetic_flag_is_for_clouds_from_images(survey: Survey, tmp_path: Path) -> None:
    plain = replace(survey.cloud, sigma_m=None, rgb=None)
    las.write_las(tmp_path / "c.laz", plain, places_of(survey), synthetic=False)
    read = laspy.read(tmp_path / "c.laz")
    assert not np.asarray(read.synthetic).any() and "sigma" not in read.point_format.dimension_names


@pytest.mark.parametrize(
    ("crs", "origin"),
    [
        ("EPSG:25832", UTM),
        ("EPSG:28992", RD),
        ("EPSG:7415", RD),
        ("EPSG:5972", UTM),
        ("EPSG:32633", UTM),
        ("+proj=utm +zone=32 +ellps=GRS80 +units=m", UTM),
    ],
)
def test_a_crs_comes_back_out_of_the_laz(crs: str, origin: np.ndarray, tmp_path: Path) -> None:
    survey = replace(corridor(origin, count=200), crs=crs)
    laz = write_exports(survey, None, tmp_path).files["cloud.laz"]
    with laspy.open(laz) as file:
        header = file.header
        found = header.parse_crs()
    assert found.equals(CRS(crs), ignore_axis_order=True) or found.to_epsg() == CRS(crs).to_epsg()
    assert sum(vlr.record_id == 2112 for vlr in header.vlrs) == 1 and header.global_encoding.wkt
    assert not any(vlr.record_id in {34735, 34736, 34737} for vlr in header.vlrs)  # no GeoTIFF keys beside
    assert np.abs(laspy.read(laz).xyz - survey.cloud.xyz).max() < 1e-3


def test_a_crs_of_three_dimensions_is_written_by_its_horizontal_part() -> None:
    assert CRS.from_wkt(wkt_of(CRS("EPSG:32632").to_3d())).to_epsg() == 32632
    assert CRS.from_wkt(wkt_of(CRS("EPSG:7415"))).is_compound


def test_geojson_has_longitudes_and_latitudes(survey: Survey, written: exports.Exports) -> None:
    data = json.loads(written.files["conductors.geojson"].read_text())
    assert "crs" not in data and len(data["features"]) == 3  # RFC 7946 knows one CRS only
    independent = Transformer.from_crs("EPSG:4326", "EPSG:25832", always_xy=True)
    for feature, conductor in zip(data["features"], survey.conductors, strict=True):
        lon, lat, height = np.array(feature["geometry"]["coordinates"]).T
        line = conductor.fit.curve.polyline(exports.VERTEX_M)
        east, north = independent.transform(lon, lat)
        assert np.abs(np.stack([east, north, height], 1) - line).max() < 1e-3
        said = feature["properties"]
        assert said["id"] == conductor.id and said["kind"] == conductor.kind
        assert said["sag_m"] == pytest.approx(conductor.fit.curve.sag_m, abs=1e-4)
        assert said["state"] == "as surveyed" and said["class_code"] in {13, 14}


def test_the_projected_copy_names_its_crs(survey: Survey, written: exports.Exports) -> None:
    data = json.loads(written.files["conductors-projected.geojson"].read_text())
    assert data["crs"]["properties"]["name"] == "urn:ogc:def:crs:EPSG::25832"
    first = np.array(data["features"][0]["geometry"]["coordinates"])
    assert np.abs(first - survey.conductors[0].fit.curve.polyline(exports.VERTEX_M)).max() < 1e-3


def test_the_drawing_has_a_layer_for_each_kind(survey: Survey, written: exports.Exports) -> None:
    drawing = ezdxf.readfile(written.files["conductors.dxf"])
    assert drawing.header["$INSUNITS"] == 6 and not drawing.audit().has_errors
    lines = list(drawing.modelspace().query("POLYLINE"))
    layers = {line.dxf.layer for line in lines}
    assert layers >= {"CONDUCTOR-PHASE", "CONDUCTOR-SHIELD", "TOWER", "CLEARANCE-VEGETATION"}
    assert all(line.is_3d_polyline for line in lines)
    shield = next(line for line in lines if line.dxf.layer == "CONDUCTOR-SHIELD")
    vertices = np.array([list(point) for point in shield.points()])
    assert np.abs(vertices - survey.conductors[2].fit.curve.polyline(exports.VERTEX_M)).max() < 1e-3
    tower = next(line for line in lines if line.dxf.layer == "TOWER")
    assert [point.z for point in tower.points()] == pytest.approx([0.0, 31.0])


def test_the_tables_hold_the_catenaries_and_the_verdicts(survey: Survey, written: exports.Exports) -> None:
    with written.files["conductors.csv"].open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row, conductor in zip(rows, survey.conductors, strict=True):
        curve = conductor.fit.curve
        assert float(row["p_m"]) == pytest.approx(curve.p_m, rel=1e-6)
        assert float(row["length_m"]) == pytest.approx(curve.length_m, abs=1e-3)
        assert [float(row[f"lowest_{axis}"]) for axis in "xyz"] == pytest.approx(curve.lowest, abs=1e-3)
        assert float(row["sag_sigma_m"]) == pytest.approx(conductor.fit.sag_sigma_m, abs=1e-4)
        s = float(row["sag_from_a_m"])
        chord = curve.a[2] + s / curve.span_m * (curve.b[2] - curve.a[2])
        assert chord - curve.heights(np.array([s]))[0] == pytest.approx(curve.sag_m, abs=1e-6)
        assert float(row["azimuth_deg"]) == pytest.approx(np.degrees(np.arctan(118 / 22)), abs=0.01)
        assert row["temperature_c"] == ""
    found = measure_clearances(survey, own_requirement(5.0))
    with written.files["clearances.csv"].open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["verdict"] for row in rows] == [found.verdict(place) or "" for place in found.all_places()]
    for row, place in zip(rows, found.all_places(), strict=True):
        assert float(row["distance_m"]) == pytest.approx(place.distance_m, abs=1e-4)
        assert [float(row[f"obstacle_{axis}"]) for axis in "xyz"] == pytest.approx(place.obstacle, abs=1e-3)
    points = json.loads(written.files["clearances.geojson"].read_text())["features"]
    for point, row in zip(points, rows, strict=True):
        assert point["properties"]["distance_m"] == float(row["distance_m"])


def test_the_ply_is_in_the_world(survey: Survey, written: exports.Exports) -> None:
    vertex = read_ply(written.files["cloud.ply"])["vertex"]
    assert np.array_equal(np.stack([vertex[axis] for axis in "xyz"], 1), survey.cloud.xyz)
    assert np.array_equal(vertex["classification"], survey.cloud.label)


def test_local_metres_become_those_of_the_crs(local: Survey, tmp_path: Path) -> None:
    files = export(local, tmp_path).files
    assert set(files) == ALL
    frame = LocalFrame("EPSG:25832", tuple(ORIGIN.tolist()))
    las = laspy.read(files["cloud.laz"])
    assert np.abs(las.xyz - frame.to_crs(local.cloud.xyz)).max() < 1e-3
    assert np.abs(frame.to_local(las.xyz) - local.cloud.xyz).max() < 1.5e-3
    data = json.loads(files["conductors.geojson"].read_text())
    place = np.array(data["features"][0]["geometry"]["coordinates"][0])
    assert place[:2] == pytest.approx(ORIGIN[:2], abs=1e-4)
    assert place[2] == pytest.approx(270.0, abs=0.05)
    vertex = read_ply(files["cloud.ply"])["vertex"]
    assert np.array_equal(vertex["x"], local.cloud.xyz[:, 0])


def test_degrees_are_no_metres(local: Survey, survey: Survey, tmp_path: Path) -> None:
    done = export(replace(local, crs="EPSG:4979"), tmp_path)
    with laspy.open(done.files["cloud.laz"]) as file:
        assert file.header.parse_crs().to_epsg() == 32632
    assert "EPSG:4979 has longitudes and latitudes; files that want metres are in EPSG:32632" in done.notes[0]
    south = places_of(replace(local, crs="EPSG:4979", origin=np.array([-70.5, -33.0, 500.0])))
    assert south.crs is not None and south.crs.to_epsg() == 32719
    with pytest.raises(SurveyError, match="are degrees, so that they hold no metres"):
        places_of(replace(survey, crs="EPSG:4326"))


@pytest.mark.parametrize(("crs", "said"), [("EPSG:3857", "is 0.50"), ("EPSG:2227", "is 0.30")])
def test_units_that_are_no_metres_are_told(crs: str, said: str) -> None:
    """Web Mercator far from the equator, and feet."""
    origin = np.array([1.2e6, 8.4e6, 0]) if crs == "EPSG:3857" else np.array([6.1e6, 2.1e6, 0])
    with pytest.raises(SurveyError, match=said + r".* does not hold metres\. Project the cloud"):
        places_of(replace(corridor(origin, count=50), crs=crs))


def test_without_a_crs_the_local_files_are_written_and_the_others_named(
    survey: Survey, tmp_path: Path
) -> None:
    done = export(replace(survey, crs=None), tmp_path)
    assert set(done.files) == {"cloud.laz", "cloud.ply", "conductors.dxf", "conductors.csv", "clearances.csv"}
    said = " ".join(done.notes)
    assert "conductors-projected.geojson is left out" in said
    assert "conductors.geojson and clearances.geojson are left out: they need longitudes" in said
    with laspy.open(done.files["cloud.laz"]) as file:
        assert file.header.parse_crs() is None and file.header.global_encoding.wkt
    assert np.abs(laspy.read(done.files["cloud.laz"]).xyz - survey.cloud.xyz).max() < 1e-3


def test_without_a_grid_for_heights_what_needs_them_is_left_out(
    survey: Survey, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_grid(crs: str, xyz: np.ndarray) -> LocalFrame:
        raise CaptureError(f"{crs} needs its grid")

    monkeypatch.setattr(places, "local_frame", no_grid)
    done = export(survey, tmp_path)
    assert set(done.files) == ALL - {"conductors.geojson", "clearances.geojson"}
    assert any("not known: EPSG:25832 needs its grid" in note for note in done.notes)


def test_a_survey_without_scale_claims_no_metres(survey: Survey, tmp_path: Path) -> None:
    done = write_exports(replace(survey, unit="unscaled"), None, tmp_path)
    assert set(done.files) == {"cloud.laz", "cloud.ply", "conductors.dxf", "conductors.csv"}
    assert any("not in metres" in note for note in done.notes)
    assert any("There are no clearances" in note for note in done.notes)
    with done.files["conductors.csv"].open(newline="") as file:
        names = csv.DictReader(file).fieldnames or []
    assert "sag_unscaled" in names and not [name for name in names if name.endswith("_m")]
    assert ezdxf.readfile(done.files["conductors.dxf"]).header["$INSUNITS"] == 0


def test_an_empty_survey_is_written_and_says_so(survey: Survey, tmp_path: Path) -> None:
    cloud = survey.cloud
    none = Cloud(cloud.xyz[:0], cloud.label[:0], cloud.wire[:0])
    done = export(replace(survey, conductors=(), towers=(), cloud=none), tmp_path)
    assert set(done.files) == {"cloud.laz", "cloud.ply", "conductors.dxf"}
    assert any("No conductors were found" in note for note in done.notes)


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
        write_exports(survey, None, tmp_path)
    assert not (tmp_path / file).exists() and not list(tmp_path.glob("*partial*"))


def test_a_table_that_reads_back_differently_is_not_kept(tmp_path: Path) -> None:
    with pytest.raises(SurveyError, match="reads back differently: numbers of the column 'a' differ"):
        tables.write_csv(tmp_path / "t.csv", [{"a": float("nan")}], ["a"])
    assert not (tmp_path / "t.csv").exists()


def test_a_drawing_that_reads_back_differently_is_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    line = dxf.Line("TOWER", 1, np.array([UTM, UTM + 1]))
    read = dxf.readfile

    def moved(path: Path) -> Drawing:
        drawing = read(path)
        drawing.modelspace()[0].translate(0, 0.002, 0)
        return drawing

    monkeypatch.setattr(dxf, "readfile", moved)
    with pytest.raises(SurveyError, match=r"of its 2 vertices, number 0 \(from 0\) should be at"):
        dxf.write_dxf(tmp_path / "t.dxf", [line], "metre")
    assert not list(tmp_path.iterdir())


def test_what_las_cannot_hold_is_told(survey: Survey, tmp_path: Path) -> None:
    cloud = replace(survey.cloud, xyz=survey.cloud.xyz.copy())
    cloud.xyz[-1] += 3e6
    with pytest.raises(SurveyError, match=r"cannot hold the cloud, which is wider than 2147484 m"):
        las.write_las(tmp_path / "c.laz", cloud, places_of(replace(survey, crs=None)), synthetic=False)
    assert not list(tmp_path.iterdir())


def test_a_crs_that_is_none_is_told(survey: Survey, tmp_path: Path) -> None:
    with pytest.raises(SurveyError, match=r"'EPSG:0' of cloud.laz is not known"):
        write_exports(replace(survey, crs="EPSG:0"), None, tmp_path)


@pytest.mark.data
def test_a_real_cloud_of_lidar_is_exported_to_the_millimetre(shared_data: Path, tmp_path: Path) -> None:
    """Airborne LiDAR of a 380 kV line in RD New; of its wires, the longest piece in one."""
    las = laspy.read(shared_data / "lidar" / "12AN2_20.laz")
    code = np.asarray(las.classification, dtype=np.uint8)
    some = (code == 14) | (np.arange(len(code)) % 4 == 0)
    xyz, label = las.xyz[some], code[some]
    on = np.flatnonzero(label == 14)
    pairs = cKDTree(xyz[on]).query_pairs(1.0, output_type="ndarray")
    near = coo_matrix((np.ones(len(pairs)), pairs.T), (len(on), len(on)))
    piece = connected_components(near, directed=False)[1]
    mine = on[piece == np.bincount(piece).argmax()]
    wire = np.zeros(len(xyz), np.int64)
    wire[mine] = 1
    conductor = Conductor(1, 0, "phase", fit_catenary(xyz[mine]), 1.0, 1.0, len(mine), "its points")
    survey = Survey((conductor,), (), Cloud(xyz, label, wire), "m", "EPSG:28992", None, "12AN2_20.laz")
    assert conductor.fit.inlier.mean() > 0.99 and conductor.fit.curve.span_m > 200
    found = measure_clearances(survey)
    files = write_exports(survey, found, tmp_path).files
    assert set(files) == ALL
    back = laspy.read(files["cloud.laz"])
    assert np.abs(back.xyz - xyz).max() <= 1e-3 and np.array_equal(back.classification, label)
    assert back.header.parse_crs().to_epsg() == 28992
    line = conductor.fit.curve.polyline(0.02)
    for group, codes in (("ground", (2, 9)), ("vegetation", (5,))):
        assert found.conductors[0].least(group).distance_m == pytest.approx(
            cKDTree(line).query(xyz[np.isin(label, codes)])[0].min(), abs=1e-3
        )
