"""Tables of clearances say what they say, for voltages they have, and nothing in between."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.support.catenary_surveys import UTM, corridor

from plnerf.errors import SurveyError
from plnerf.line.clearances import GROUPS
from plnerf.survey.config_ground import ClearanceConfig
from plnerf.survey.thresholds import (
    altitude_m,
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


def own(tmp_path: Path, text: str = TABLE) -> Path:
    path = tmp_path / "own.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_table_of_the_package_says_what_the_standard_does_and_where_it_is_from() -> None:
    table = load_table()
    feet = {230: 4.0, 345: 4.3, 500: 7.0, 765: 11.6}
    for voltage, distance in feet.items():
        assert required_clearance(float(voltage), 0.0, table).distance_m == pytest.approx(distance * FOOT)
    assert required_clearance(765.0, 1500.0, table).distance_m == pytest.approx(12.4 * FOOT)
    found = required_clearance(345.0, -20.0, table)  # below the sea there is more air, not less
    assert found.applies_to == ("vegetation",) and found.date == "2016-04-26"
    assert "FAC-003-4" in found.source and "345 kV" in found.name
    assert any("flash-over distance" in caveat for caveat in found.caveats)


def test_bands_of_altitude_hold_their_upper_bound_and_never_ask_for_less_above() -> None:
    table = load_table()
    assert required_clearance(500.0, 500 * FOOT, table).distance_m == pytest.approx(7.0 * FOOT)
    assert required_clearance(500.0, 500 * FOOT + 1e-6, table).distance_m == pytest.approx(7.1 * FOOT)
    for distances in table.distances_m.values():
        assert list(distances) == sorted(distances)


def test_a_voltage_that_is_no_class_is_not_interpolated() -> None:
    with pytest.raises(SurveyError, match=r"no class of 400 kV. Its classes are 230, 345, 500, 765 kV"):
        required_clearance(400.0, 0.0, load_table())
    with pytest.raises(SurveyError, match="up to 1524 m above sea level, but the line is at 1600 m"):
        required_clearance(230.0, 1600.0, load_table())


def test_a_table_of_the_user(tmp_path: Path) -> None:
    table = load_table(own(tmp_path))
    found = required_clearance(27.5, 1001.0, table)
    assert found.distance_m == 2.25 and found.applies_to == ("ground", "vegetation")
    assert found.name == "Works standard 7: 27.5 kV, up to 2000 m above sea level"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('source = "of the works"', "", "does not say source. Copy nerc-fac-003-4.toml"),
        ('unit = "m"', 'unit = "yd"', "its unit is 'yd', but must be one of ft, m"),
        ('["ground", "vegetation"]', '["trees"]', "it applies to trees, but knows only ground, vegetation,"),
        ("[1000, 2000]", "[2000, 1000]", "must rise"),
        ("[3.0, 3.5]", "[3.0]", "110 kV has 1 distances for 2 altitudes"),
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
    low = corridor(UTM, count=50)
    high = corridor(UTM + np.array([0.0, 0.0, 980.0]), count=50)
    in_local = replace(low, frame=replace(low.frame, origin_lon_lat_height=np.array([9.0, 51.0, 980.0])))
    assert altitude_m(low) == pytest.approx(55, abs=0.1)
    assert altitude_m(high) == altitude_m(in_local) == pytest.approx(1035, abs=0.1)
    assert altitude_m(replace(low, lines=())) == 0.0
    found = [requirement(one, 110.0, own(tmp_path), None) for one in (low, high, in_local)]
    assert [one and one.distance_m for one in found] == [3.0, 3.5, 3.5]
    assert requirement(low, 110.0, own(tmp_path), 9.0) == own_requirement(9.0)
    assert requirement(low, None, None, None) is None
    with pytest.raises(SurveyError, match="goes up to 2000 m above sea level, but the line is at 2055 m"):
        requirement(corridor(UTM + np.array([0.0, 0.0, 2000.0]), count=50), 110.0, own(tmp_path), None)
