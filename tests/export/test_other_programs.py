"""Exports as programs of others open them, where they are installed: GDAL's own (another version of it than
pyogrio has), PDAL and QGIS.  Debian: gdal-bin, pdal, python3-qgis."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from pyproj import CRS
from tests.support import surveys
from tests.support.encroaching import with_encroachments

from plnerf.export.crs import crs_transform
from plnerf.export.exports import VERTEX_M
from plnerf.exporting import export_survey
from plnerf.line.files import read_survey
from plnerf.line.survey import Survey
from plnerf.pipeline import write_survey

DRAW = Path(__file__).parents[2] / "benchmarks" / "draw_geopackage.py"
SYSTEM_PYTHON = "/usr/bin/python3"


def _loads_qgis() -> bool:
    return (
        Path(SYSTEM_PYTHON).exists()
        and not subprocess.run(
            [
                SYSTEM_PYTHON,
                "-c",
                "import importlib.util, sys; sys.exit(not importlib.util.find_spec('qgis'))",
            ],
            check=False,
        ).returncode
    )


needs_gdal = pytest.mark.skipif(not shutil.which("ogr2ogr"), reason="gdal-bin is not installed")
needs_pdal = pytest.mark.skipif(not shutil.which("pdal"), reason="pdal is not installed")
needs_qgis = pytest.mark.skipif(not _loads_qgis(), reason="python3-qgis is not installed")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("survey")
    write_survey(with_encroachments(surveys.short(0.05)), out)
    return out


@pytest.fixture(scope="module")
def survey(folder: Path) -> Survey:
    return read_survey(folder / "survey.json")


def printed(*command: str | Path) -> str:
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "Warning" not in done.stderr, done.stderr
    return done.stdout


def features(path: Path, layer: str) -> list[dict[str, Any]]:
    """Of a layer, as GDAL's ogr2ogr reads them."""
    options = ("-f", "GeoJSON", "/vsistdout/", "-lco", "COORDINATE_PRECISION=9")
    return json.loads(printed("ogr2ogr", *options, path, layer))["features"]


@needs_gdal
def test_gdal_opens_the_geopackage(folder: Path, survey: Survey) -> None:
    pyogrio = pytest.importorskip("pyogrio", reason="plnerf[gis] is not installed")
    (path,) = export_survey(folder, ("gpkg",)).files.values()
    assert "ERROR" not in (about := printed("ogrinfo", "-al", "-so", path)) and 'ID["EPSG",25832]' in about
    assert len(features(path, "layer_styles")) == len(pyogrio.list_layers(path)) - 1
    found, to_map = features(path, "wires"), crs_transform(survey).to_map
    for feature, wire in zip(found, survey.wires, strict=True):
        at = np.array(feature["geometry"]["coordinates"])
        assert np.abs(at - to_map(wire.polyline(VERTEX_M))).max() < 1e-3
        assert feature["properties"]["id"] == wire.id


@needs_gdal
def test_gdal_opens_the_kml(folder: Path, survey: Survey) -> None:
    pytest.importorskip("pyogrio", reason="plnerf[gis] is not installed")
    (path,) = export_survey(folder, ("kml",)).files.values()
    found = np.array([one["geometry"]["coordinates"] for one in features(path, "structures")])
    feet = np.array([one.foot for one in survey.structures])
    assert np.abs(crs_transform(survey).from_lon_lat(found) - feet).max() < 2e-3


@needs_gdal
def test_gdal_opens_the_drawing(folder: Path, survey: Survey) -> None:
    found, to_map = features(folder / "conductors.dxf", "entities"), crs_transform(survey).to_map
    drawn = [one for one in found if one["properties"]["Layer"].startswith("CONDUCTOR")]
    for feature, wire in zip(drawn, survey.wires, strict=True):
        assert feature["properties"]["Layer"] == f"CONDUCTOR-{wire.kind.upper()}"
        at = np.array(feature["geometry"]["coordinates"])
        assert np.abs(at - to_map(wire.polyline(VERTEX_M))).max() < 1e-3


@needs_pdal
@pytest.mark.parametrize("name", ["cloud.laz", "cloud.copc.laz"])
def test_pdal_opens_the_cloud(folder: Path, name: str) -> None:
    if name == "cloud.copc.laz":
        pytest.importorskip("copclib", reason="plnerf[gis] is not installed")
        export_survey(folder, ("copc",))
    las = laspy.read(folder / "cloud.laz")
    found = json.loads(printed("pdal", "info", "--all", "--enumerate", "Classification", folder / name))
    assert found["metadata"]["count"] == len(las.points)
    assert CRS(found["metadata"]["srs"]["wkt"]).to_epsg(min_confidence=20) == 25832
    box = found["stats"]["bbox"]["native"]["bbox"]
    edges = [[box[f"{end}{axis}"] for axis in "xyz"] for end in ("min", "max")]
    assert np.abs(np.array(edges) - [las.xyz.min(0), las.xyz.max(0)]).max() < 1e-3
    columns = {one["name"]: one for one in found["stats"]["statistic"]}
    assert set(columns["Classification"]["values"]) == set(np.unique(las.classification).tolist())
    assert columns["Z"]["average"] == pytest.approx(las.xyz[:, 2].mean(), abs=1e-3)


@needs_qgis
def test_qgis_draws_the_geopackage_in_its_own_styles(folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("pyogrio", reason="plnerf[gis] is not installed")
    (path,) = export_survey(folder, ("gpkg",)).files.values()
    text = printed(SYSTEM_PYTHON, DRAW, path, tmp_path / "map.png")
    assert "wires: 5 features, #1565c0, labels 1 2 3 4 5, EPSG:25832" in text
    assert "structures: 2 features, #212121, labels 1 2, EPSG:25832" in text
    assert "encroachments: 1 features, #c62828, labels 1, EPSG:25832" in text
    assert "structures 1 2," in text and "wires 1 2 3 4" in text and "encroachments 1," in text
    assert (tmp_path / "map.png").stat().st_size > 5000
