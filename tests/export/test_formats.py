"""GeoPackage, KML, COPC and PLS-CADD XYZ hold what the survey does, as independent readers see it."""

import sqlite3
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pytest
from tests.support import surveys
from tests.support.encroaching import with_encroachments

from plnerf.errors import ConfigError, SurveyError
from plnerf.export import copc, geopackage
from plnerf.export.crs import crs_transform
from plnerf.export.formats import Format, write_formats
from plnerf.exporting import export_survey
from plnerf.line.cloud import Cloud
from plnerf.line.files import read_survey, write_survey_json
from plnerf.pipeline import write_survey

pyogrio, shapely = pytest.importorskip("pyogrio"), pytest.importorskip("shapely")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("survey")
    write_survey(with_encroachments(surveys.short(0.05)), out)
    return out


def test_a_geopackage_has_all_layers_in_the_surveys_crs_with_styles(folder: Path) -> None:
    (path,) = export_survey(folder, ("gpkg",)).files.values()
    survey = read_survey(folder / "survey.json")
    layers = {str(name): str(kind) for name, kind in pyogrio.list_layers(path)}
    assert {name for name, kind in layers.items() if kind != "None"} == {
        "encroachments", "encroaching_crossings", "clearances", "spans", "wires", "attachments", "structures",
    }  # fmt: skip
    meta, _, wkb, columns = pyogrio.raw.read(path, layer="wires")
    assert "25832" in str(meta["crs"]) and len(wkb) == len(survey.wires)
    wanted = crs_transform(survey).to_map(survey.wires[0].polyline(1.0))
    found = shapely.get_coordinates(shapely.from_wkb(wkb[0]), include_z=True)
    assert np.abs(found - wanted).max() < 1e-3
    sag = columns[list(meta["fields"]).index("sag_m")]
    assert sag[0] == pytest.approx(survey.wires[0].sag.value, abs=1e-4)  # type: ignore[union-attr]
    base = sqlite3.connect(path)
    with base:
        styles = dict(base.execute("select f_table_name, styleQML from layer_styles where useAsDefault"))
        (identity,) = base.execute("pragma integrity_check").fetchone()
    base.close()
    assert identity == "ok" and styles.keys() == {name for name, kind in layers.items() if kind != "None"}
    for text in styles.values():
        assert ET.fromstring(text[text.index("<qgis") :]).find("renderer-v2/symbols/symbol/layer") is not None


def test_a_kml_is_in_longitudes_and_latitudes(folder: Path) -> None:
    (path,) = export_survey(folder, ("kml",)).files.values()
    survey = read_survey(folder / "survey.json")
    _, _, wkb, _ = pyogrio.raw.read(path, layer="structures")
    found = shapely.get_coordinates(shapely.from_wkb(wkb), include_z=True)
    feet = np.array([one.foot for one in survey.structures])
    assert np.abs(crs_transform(survey).from_lon_lat(found) - feet).max() < 2e-3
    assert ET.parse(path).getroot().tag.endswith("kml")


def test_copc_holds_every_point_and_reads_by_place(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("copclib")
    monkeypatch.setattr(copc, "LEAF", 800)  # so that there are several cubes
    (path,) = export_survey(folder, ("copc",)).files.values()
    las = laspy.read(folder / "cloud.laz")
    with laspy.CopcReader.open(str(path)) as reader:
        every = reader.query()
        middle = las.xyz.mean(0)
        part = reader.query(bounds=laspy.copc.Bounds(middle - 5, middle + 5))
        coarse = reader.query(level=0)
    assert laspy.read(path).header.parse_crs() == las.header.parse_crs() is not None
    back = np.stack([every.x, every.y, every.z], 1)
    assert np.array_equal(np.sort(back, axis=0), np.sort(las.xyz, axis=0))
    assert (np.abs(las.xyz - middle) <= 5).all(1).sum() == len(part) and 0 < len(coarse) < len(every)
    assert np.bincount(every.classification).tolist() == np.bincount(las.classification).tolist()


def test_pls_cadd_lines_have_the_codes_of_the_map(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "codes.toml").write_text("[codes]\nground = 7\nphase = 55\n")
    (path,) = export_survey(folder, ("pls-cadd",), tmp_path, tmp_path / "codes.toml").files.values()
    rows = np.loadtxt(path, delimiter=",")
    las, survey = laspy.read(folder / "cloud.laz"), read_survey(folder / "survey.json")
    ground = las.xyz[las.classification == 2]
    assert np.abs(np.sort(rows[rows[:, 0] == 7, 1:], 0) - np.sort(ground, 0)).max() < 1e-3
    phases = rows[rows[:, 0] == 55]
    wanted = crs_transform(survey).to_map(survey.wires[0].polyline(1.0))
    assert np.abs(phases[: len(wanted), 1:] - wanted).max() < 1e-3
    table = (tmp_path / "pls-cadd-codes.csv").read_text().splitlines()
    assert table[0] == "feature_code,what,points" and f"7,ground,{(las.classification == 2).sum()}" in table
    for text, said in (("gravel = 7", "gravel"), ("ground = true", "no whole numbers")):
        (tmp_path / "codes.toml").write_text(f"[codes]\n{text}\n")
        with pytest.raises(ConfigError, match=said):
            export_survey(folder, ("pls-cadd",), tmp_path, tmp_path / "codes.toml")
    with pytest.raises(ConfigError, match=r"There is no map of feature codes none\.toml"):
        export_survey(folder, ("pls-cadd",), tmp_path, Path("none.toml"))


@pytest.mark.parametrize("wanted", ["copc", "pls-cadd"])
def test_a_cloud_that_is_cut_off_is_refused(folder: Path, tmp_path: Path, wanted: Format) -> None:
    for name, size in (("survey.json", None), ("cloud.laz", 500)):
        (tmp_path / name).write_bytes((folder / name).read_bytes()[:size])
    with pytest.raises(SurveyError, match=r"cloud\.laz cannot be read as LAS or LAZ"):
        export_survey(tmp_path, (wanted,))


def test_what_a_format_lacks_is_said(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bare = replace(surveys.short(0.05), frame=replace(surveys.FRAME, crs=None, origin_lon_lat_height=None))
    write_survey_json(tmp_path / "survey.json", bare)
    with pytest.raises(SurveyError, match="needs a coordinate reference system"):
        export_survey(tmp_path, ("gpkg",))
    with pytest.raises(SurveyError, match=r"has no cloud\.laz"):
        export_survey(tmp_path, ("copc",))
    monkeypatch.setattr("plnerf.export.formats.find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"copclib is not installed.*plnerf\[gis\]"):
        write_formats(read_survey(folder / "survey.json"), folder, tmp_path, ("copc",))


def test_without_a_choice_all_is_written_that_can_be(tmp_path: Path) -> None:
    pytest.importorskip("copclib")
    frame = replace(surveys.FRAME, crs=None, origin_lon_lat_height=None)
    write_survey(replace(surveys.short(0.05), frame=frame), tmp_path)
    done = export_survey(tmp_path)
    assert set(done.files) == {"cloud.copc.laz", "pls-cadd.xyz"}
    assert all(path.is_file() for path in done.files.values())
    assert [text.split()[0] for text in done.about] == ["survey.gpkg", "survey.kml"]
    write_survey(surveys.unscaled(0.05), tmp_path)
    assert set(export_survey(tmp_path).files) == {"cloud.copc.laz"}


def test_a_map_that_reads_back_differently_is_not_kept(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shape = geopackage._shape
    monkeypatch.setattr(
        geopackage, "_shape", lambda one, to: shape(one, lambda points: to(points) + np.array([0.002, 0, 0]))
    )
    with pytest.raises(SurveyError, match=r"survey\.gpkg reads back differently"):
        export_survey(folder, ("gpkg",), tmp_path)
    assert not list(tmp_path.glob("*gpkg"))


def test_a_survey_without_anything_is_exported_as_nothing_with_the_reasons(tmp_path: Path) -> None:
    nothing = Cloud(np.zeros((0, 3)), np.zeros(0, np.uint8), np.zeros(0, np.int64))
    write_survey(replace(surveys.empty(), cloud=nothing), tmp_path)
    found = export_survey(tmp_path)
    assert found.files == {} and len(found.about) == 4
    for wanted in ("copc", "pls-cadd"):
        with pytest.raises(SurveyError, match="needs points"):
            export_survey(tmp_path, (wanted,))


def test_a_survey_without_wires_has_no_maps_and_the_reason(tmp_path: Path) -> None:
    write_survey(surveys.empty(), tmp_path)
    found = export_survey(tmp_path)
    assert not {"survey.gpkg", "survey.kml"} & found.files.keys()
    assert "needs a wire or a structure" in " ".join(found.about)
    with pytest.raises(SurveyError, match=r"survey\.kml needs a wire or a structure"):
        export_survey(tmp_path, ("kml",))
