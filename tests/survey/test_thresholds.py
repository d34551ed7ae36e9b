"""Tables of clearances say what they say, for voltages they have, and nothing in between."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pyproj import CRS
from tests.support.catenary_surveys import UTM, corridor
from tests.support.lidar_clouds import line

from plnerf.errors import SurveyError
from plnerf.line.clearances import GROUPS
from plnerf.line.survey import Survey
from plnerf.survey import altitude, run
from plnerf.survey.altitude import Altitude, altitude_at, altitude_of
from plnerf.survey.clearance import measure_clearances
from plnerf.survey.config import SurveyConfig
from plnerf.survey.config_ground import ClearanceConfig
from plnerf.survey.lidar.point_cloud import PointCloud
from plnerf.survey.thresholds import (
    AboveTableError,
    check_altitude,
    load_table,
    own_requirement,
    required_clearance,
    requirement,
)

FOOT = 0.3048
TABLE = """
name = "Works standard 7"
source = "of the works"
date = "2020-01-01"
applies_to = ["ground", "vegetation"]
unit = "m"
altitude_up_to = [1000, 2000]
caveats = []
class = [{nominal_kv = 110, distance = [3.0, 3.5]}, {nominal_kv = 27.5, distance = [2.0, 2.25]}]
"""


def at(altitude_m: float) -> Altitude:
    return Altitude(altitude_m, altitude_m)


def own(tmp_path: Path, text: str = TABLE) -> Path:
    path = tmp_path / "own.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_table_of_the_package_says_what_the_standard_does_and_where_it_is_from() -> None:
    table = load_table()
    feet = {230: 4.0, 345: 4.3, 500: 7.0, 765: 11.6}
    for voltage, distance in feet.items():
        assert required_clearance(float(voltage), at(0.0), table).distance_m == pytest.approx(distance * FOOT)
    assert required_clearance(765.0, at(1500.0), table).distance_m == pytest.approx(12.4 * FOOT)
    found = required_clearance(345.0, at(-20.0), table)  # below the sea there is more air, not less
    assert found.applies_to == ("vegetation",) and found.date == "2024-04-01"
    assert "FAC-003-5" in found.source and "345 kV" in found.name
    assert any("flash-over distance" in caveat for caveat in found.caveats)


def test_bands_of_altitude_hold_their_upper_bound_and_never_ask_for_less_above() -> None:
    table = load_table()
    assert required_clearance(500.0, at(500 * FOOT), table).distance_m == pytest.approx(7.0 * FOOT)
    assert required_clearance(500.0, at(500 * FOOT + 1e-6), table).distance_m == pytest.approx(7.1 * FOOT)
    for distances in table.distances_m.values():
        assert list(distances) == sorted(distances)


def test_a_voltage_that_is_no_class_is_not_interpolated() -> None:
    with pytest.raises(SurveyError, match=r"no class of 400 kV. Its classes are 230, 345, 500, 765 kV"):
        required_clearance(400.0, at(0.0), load_table())
    with pytest.raises(SurveyError, match="up to 1524 m above sea level, but the line is at 1600 m"):
        required_clearance(230.0, at(1600.0), load_table())


def test_a_table_of_the_user(tmp_path: Path) -> None:
    table = load_table(own(tmp_path))
    found = required_clearance(27.5, at(1001.0), table)
    assert found.distance_m == 2.25 and found.applies_to == ("ground", "vegetation")
    assert found.name == "Works standard 7: 27.5 kV, up to 2000 m above sea level"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('source = "of the works"', "", "does not say source. Copy nerc-fac-003-5.toml"),
        ('unit = "m"', 'unit = "yd"', "its unit is 'yd', but must be one of ft, m"),
        ('["ground", "vegetation"]', '["trees"]', "it applies to trees, but knows only ground, vegetation,"),
        ("[1000, 2000]", "[2000, 1000]", "must be finite and rise"),
        ("[3.0, 3.5]", "[3.0]", "110 kV has 1 distances for 2 altitudes"),
        ("[1000, 2000]", "[1000, inf]", "must be finite and rise"),
        ("[1000, 2000]", f"[1000, 1{'0' * 400}]", "int too large to convert to float"),
        ("nominal_kv = 27.5", "nominal_kv = nan", "it has a class of nan kV"),
        ("[3.0, 3.5]", "[3.0, -1.0]", "110 kV has distances that are not greater than 0"),
        ("nominal_kv = 27.5", "nominal_kv = 110", "it has 110 kV twice"),
        ("nominal_kv = 27.5, ", "", "has a class that does not say 'nominal_kv'"),
        ("[1000, 2000]", "7", "is no table of clearances: 'int' object is not iterable"),
        ('unit = "m"', "unit =", "is not valid TOML"),
    ],
)
def test_what_is_wrong_with_a_table_is_reported(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in TABLE
    with pytest.raises(SurveyError) as raised:
        load_table(own(tmp_path, TABLE.replace(old, new)))
    assert said in str(raised.value) and "own.toml" in str(raised.value)


def test_a_table_that_is_not_there_is_reported(tmp_path: Path) -> None:
    with pytest.raises(SurveyError, match=r"none.toml cannot be read \(No such file or directory\)"):
        load_table(tmp_path / "none.toml")


def test_one_distance_of_the_user_is_for_everything() -> None:
    assert own_requirement(7.5).distance_m == 7.5 and own_requirement(7.5).applies_to == GROUPS
    for bad in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(SurveyError, match="must be greater than 0 m"):
            own_requirement(bad)


def test_a_verdict_knows_its_uncertainty() -> None:
    required = own_requirement(5.0)
    assert required.verdict(4.0, 0.1) == "closer than required"
    assert required.verdict(6.0, 0.1) == "clear"
    assert required.verdict(4.9, 0.1) == required.verdict(5.1, 0.1) == "within its uncertainty"
    assert required.verdict(5.0, 0.0) == "within its uncertainty"
    assert required.verdict(4.999, 0.0) == "closer than required"


def test_settings_that_require_nothing_meaningful_are_refused_before_a_survey(tmp_path: Path) -> None:
    with pytest.raises(SurveyError, match="no voltage is given"):
        ClearanceConfig(thresholds=own(tmp_path))
    with pytest.raises(SurveyError, match="no class of 110 kV"):
        ClearanceConfig(voltage_kv=110.0)
    with pytest.raises(SurveyError, match="must be greater than 0 m"):
        ClearanceConfig(clearance_m=-1.0)
    ClearanceConfig(voltage_kv=110.0, thresholds=own(tmp_path))
    ClearanceConfig(thresholds=tmp_path / "none.toml", clearance_m=2.0)  # the distance precedes the table


def test_what_is_required_is_the_distance_given_or_the_table_s_at_the_line_s_altitude(tmp_path: Path) -> None:
    """The highest end of a wire is 55 m above the LineFrame's origin."""
    low = above_sea(0.0)
    high = above_sea(980.0)
    in_local = replace(low, frame=replace(low.frame, origin_lon_lat_height=np.array([9.0, 51.0, 980.0])))
    assert altitude_of(low).low_m == altitude_of(low).high_m == pytest.approx(55, abs=0.1)
    assert altitude_of(high) == altitude_of(in_local)
    assert altitude_of(high).low_m == pytest.approx(1035, abs=0.1)
    assert altitude_of(replace(low, lines=())) == at(0.0)
    found = [requirement(one, 110.0, own(tmp_path), None) for one in (low, high, in_local)]
    assert [one and one.distance_m for one in found] == [3.0, 3.5, 3.5]
    assert requirement(low, 110.0, own(tmp_path), 9.0) == own_requirement(9.0)
    assert requirement(low, None, None, None) is None
    with pytest.raises(AboveTableError, match="goes up to 2000 m above sea level, but the line is at 2055 m"):
        requirement(above_sea(2000.0), 110.0, own(tmp_path), None)


def above_sea(height_m: float, crs: str | None = "EPSG:25832+7837") -> Survey:
    survey = corridor(UTM + np.array([0.0, 0.0, height_m]), count=50)
    return replace(survey, frame=replace(survey.frame, crs=crs))


@pytest.mark.parametrize(
    ("crs", "said"),
    [
        (None, "heights are above nothing that the input states"),
        ("EPSG:25832", "heights are above nothing that ETRS89 / UTM zone 32N states"),
        (CRS("EPSG:25832").to_3d().to_wkt(), "heights are above the ellipsoid of ETRS89, and no grid"),
    ],
)
def test_a_line_whose_height_above_the_sea_is_not_known_is_judged_by_the_worse_of_its_bands(
    crs: str | None, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The geoid lies 107 m below to 86 m above the ellipsoid: at 55 + 900 m the line may be above 1000 m."""
    monkeypatch.setattr(altitude, "geoid_height_m", lambda longitude, latitude: None)
    survey = above_sea(900.0, crs)
    found = requirement(survey, 110.0, own(tmp_path), None)
    assert found is not None and found.distance_m == 3.5
    assert found.caveats[0].startswith("The altitude above the sea is known to be 869 to 1062 m only, since ")
    assert said in found.caveats[0] and "the greatest distance of the 2 bands" in found.caveats[0]
    low = requirement(above_sea(0.0, crs), 110.0, own(tmp_path), None)
    assert low is not None and low.distance_m == 3.0 and "these are in one band" in low.caveats[0]
    known = requirement(above_sea(900.0), 110.0, own(tmp_path), None)
    assert known is not None and known.distance_m == 3.0 and known.caveats == ()


def test_a_geoid_s_grid_makes_an_altitude_of_an_ellipsoid_s_height(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(altitude, "geoid_height_m", lambda longitude, latitude: 47.0 + 0 * longitude)
    frame = above_sea(0.0, CRS("EPSG:25832").to_3d().to_wkt()).frame
    assert altitude_at(frame, np.array([0.0, 0.0, 100.0])) == at(53.0)


def test_a_line_above_the_table_fails_before_it_is_surveyed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the lower points of a cloud; where it is certain only afterwards, nothing is judged."""
    made = line(np.array([[0.0, 0.0], [110.0, 20.0]])).xyz
    monkeypatch.setattr(run, "find_lines", lambda *_: pytest.fail("the line was surveyed"))
    config = SurveyConfig(clearance=ClearanceConfig(voltage_kv=110.0, thresholds=own(tmp_path)))
    cloud = PointCloud(made + UTM + np.array([0.0, 0.0, 2100.0]), "EPSG:25832+7837", Path("line.laz"))
    with pytest.raises(SurveyError, match=r"up to 2000 m above sea level, but the line is at 20\d\d m"):
        run.survey_cloud(cloud, config)
    check_altitude(at(1999.0), 110.0, own(tmp_path), None)
    check_altitude(Altitude(1990.0, 2090.0), 110.0, own(tmp_path), None)
    check_altitude(at(9000.0), 110.0, own(tmp_path), 7.0)
    found, findings = measure_clearances(above_sea(1980.0), config.clearance)
    assert found.requirement is None and {found.verdict(place) for place in found.all_places()} == {None}
    (said,) = [one for one in findings if one.kind == "required clearance"]
    assert said.degree == "harms" and said.what.startswith("Nothing is judged. ") and "2035 m" in said.what


def test_both_standards_come_with_the_package_and_say_which_is_in_force() -> None:
    old, new = (load_table(Path(name)) for name in ("nerc-fac-003-4.toml", "nerc-fac-003-5.toml"))
    assert load_table() == replace(new, path=load_table().path)
    assert "no longer in force" in old.in_force and "2024-04-01" in old.in_force
    assert "is in force from 2024-04-01" in new.in_force
    assert new.distances_m == old.distances_m and "FAC-003-4" in old.source and "FAC-003-5" in new.source
    assert any("was not compared with NERC's own document" in caveat for caveat in new.caveats)
    assert required_clearance(230.0, at(0.0), new).caveats[0] == new.in_force
