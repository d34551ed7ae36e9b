"""Names of structures, phases and circuits come from the places of a user's list, whatever its format."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.support import surveys

from plnerf.errors import ConfigError
from plnerf.export.crs import crs_transform
from plnerf.line.ends import Attached
from plnerf.line.survey import Survey
from plnerf.survey.config_names import NamesConfig
from plnerf.survey.config_wires import KindsConfig
from plnerf.survey.named_places import read_places
from plnerf.survey.names import with_names

pyogrio, shapely = pytest.importorskip("pyogrio"), pytest.importorskip("shapely")


def named(survey: Survey, path: Path, **changed: float) -> Survey:
    return with_names(survey, NamesConfig(path, **changed), KindsConfig())


def csv_of(survey: Survey, path: Path, off_m: float = 3.0) -> Path:
    """Structures 3 m beside where they are; the phases at the first ends of the first span's wires."""
    at = crs_transform(survey).to_map(np.array([one.foot for one in survey.structures]))
    rows = [f"M{100 + k},,{x + off_m},{y},L-12,380" for k, (x, y, _) in enumerate(at)]
    held = [wire.ends[0] for wire in survey.spans[0].wires]
    ends = np.array([end.point for end in held if isinstance(end, Attached)])
    for k, (x, y, z) in enumerate(crs_transform(survey).to_map(ends)):
        rows.append(f",{'ABCDEF'[k]},{x},{y},,,{z},{1 + k // 3}")
    path.write_text("Name,phase,Easting,Northing,line,kv,z,circuit\n" + "\n".join(rows) + "\n", "utf-8-sig")
    return path


def test_a_csv_names_structures_phases_circuits_and_the_line(tmp_path: Path) -> None:
    survey = surveys.long(0.02)
    found = named(survey, csv_of(survey, tmp_path / "names.csv"))
    assert [one.name for one in found.structures] == ["M100", "M101", "M102"]
    (line,) = found.lines
    assert (line.name, line.voltage_kv, line.circuits) == ("L-12", 380.0, 2)
    for span in found.spans:  # the second span has none of its own
        assert [wire.name for wire in span.wires] == list("ABCDEF")
        assert [wire.circuit for wire in span.wires] == ["1"] * 3 + ["2"] * 3
    assert any("3 of 3 structures" in one.text and one.degree == "note" for one in found.findings)


def test_a_geopackage_and_a_kml_name_them_too(tmp_path: Path) -> None:
    survey = surveys.long(0.02)
    lonlat = crs_transform(survey).to_lon_lat(np.array([one.foot for one in survey.structures]))
    shapes = shapely.to_wkb(shapely.points(lonlat[:, :2]))
    for driver, name, field in (("GPKG", "a.gpkg", "name"), ("KML", "a.kml", "Name")):
        pyogrio.raw.write(
            tmp_path / name, shapes, [np.array(["x1", "x2", "x3"], object)], [field], driver=driver,
            geometry_type="Point", crs="EPSG:4326",
        )  # fmt: skip
        found = named(survey, tmp_path / name)
        assert [one.name for one in found.structures] == ["x1", "x2", "x3"], driver


def test_what_is_too_far_stays_without_a_name_and_is_said(tmp_path: Path) -> None:
    survey = surveys.long(0.02)
    path = csv_of(survey, tmp_path / "names.csv", off_m=25.0)
    found = named(survey, path)
    assert {one.name for one in found.structures} == {None}
    (said,) = [one for one in found.findings if "structures" in one.text]
    assert said.degree == "harms" and "M100, M101, M102" in said.text
    wider = named(survey, path, structure_m=30.0)
    assert [one.name for one in wider.structures] == ["M100", "M101", "M102"]
    lost = replace(survey, frame=replace(survey.frame, crs=None))
    path.write_text("name,lon,lat\na,5.0,52.0\n")
    assert "coordinate reference system is not known" in named(lost, path).findings[-1].text


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "neither lon and lat nor x and y"),
        ("name,x\na,1\n", "neither lon and lat nor x and y"),
        ("name,x,y\na,1,two\n", "Row 2"),
        ("name,x,y\na,1,nan\n", "no finite coordinates"),
        ("x,y\n1,2\n", "names no structure"),
        ("name,x,y,kv\na,1,2,\nb,1,2,110 kV\n", "Row 3 .* has the voltage_kv '110 kV'"),
        ("name,x,y,kv\na,1,2,nan\n", "Row 2 .* has the voltage_kv 'nan'"),
    ],
)
def test_a_list_that_is_none_is_refused_before_the_survey(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "names.csv"
    path.write_text(text)
    with pytest.raises(ConfigError, match=said):
        NamesConfig(path)


def test_a_list_that_is_missing_or_no_map_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="There is no list of names"):
        NamesConfig(tmp_path / "none.csv")
    (tmp_path / "bad.kml").write_text("nothing")
    with pytest.raises(ConfigError, match="cannot be read"):
        NamesConfig(tmp_path / "bad.kml")


def test_a_map_s_voltage_that_is_no_number_is_refused_and_shapes_without_points_are_passed_over(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a.gpkg"

    def write(kv: str) -> None:
        path.unlink(missing_ok=True)
        shapes = shapely.to_wkb(shapely.from_wkt(["POINT EMPTY", "POINT (5 52)"]))
        columns = [np.array([kv, kv], object), np.array(["a", "b"], object)]
        pyogrio.raw.write(
            path, shapes, columns, ["voltage_kv", "name"], driver="GPKG", geometry_type="Point",
            crs="EPSG:4326",
        )  # fmt: skip

    write("110 kV")
    with pytest.raises(ConfigError, match=r"Object 2 of the list of names .* has the voltage_kv '110 kV'"):
        NamesConfig(path)
    write("110")
    (place,) = read_places(path, surveys.long(0.02).frame)
    assert (place.name, place.voltage_kv, len(place.points)) == ("b", 110.0, 1)
