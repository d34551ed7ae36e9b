"""Files of conductors and states are read whole, those of the package too; what is wrong is named."""

import re
from importlib.resources import files
from pathlib import Path

import pytest

from plnerf.errors import ConfigError
from plnerf.line.states import Load
from plnerf.mechanics.conductor import load_conductor
from plnerf.mechanics.config import MechanicsConfig
from plnerf.mechanics.loads import Weather, load_states

GOOD = """name = "wire"
source = "a sheet"
weight_n_m = 9.6
diameter_mm = 21.8
area_mm2 = 282.5
modulus_gpa = 77
expansion_per_k = 18.9e-6
"""
HOT = "[[state]]\nname = 'hot'\ntemperature_c = 75\n"
OWN = files("plnerf") / "data"


def put(tmp: Path, text: str) -> Path:
    path = tmp / "file.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("name", [one.name for one in (OWN / "conductors").iterdir()])
def test_the_packages_conductors_are_of_a_metal_and_say_that_they_are_unverified(name: str) -> None:
    found = load_conductor(Path(name))
    density = found.weight_n_m / 9.80665 / (found.area_mm2 * 1e-6)
    assert 2600 < density < 8100 and 0.6 < found.area_mm2 / (0.785 * found.diameter_mm**2) < 0.9
    assert found.rated_strength_kn is not None and 100 < found.rated_strength_kn * 1e3 / found.area_mm2 < 1500
    assert any("nverified" in text for text in found.caveats) and found.source


@pytest.mark.parametrize("name", [one.name for one in (OWN / "states").iterdir()])
def test_the_packages_states_are_read(name: str) -> None:
    assert load_states(Path(name)).loads


def test_a_name_in_any_case_and_without_its_suffix_is_the_packages() -> None:
    assert load_conductor(Path("ACSR-Drake")) == load_conductor(Path("acsr-drake.toml"))


def test_a_conductor_of_ones_own_is_read(tmp_path: Path) -> None:
    found = load_conductor(put(tmp_path, GOOD + "[tolerance]\nmodulus = 0.1\n"))
    assert found.ea_n == pytest.approx(77e3 * 282.5) and found.modulus_sigma == 0.1
    assert found.rated_strength_kn is None and found.thermal is None


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("weight_n_m = 9.6", ""), "needs weight_n_m, a number greater than 0 and at most 200: it is miss"),
        (("weight_n_m = 9.6", "weight_n_m = 980"), "needs weight_n_m.* at most 200: got '980'"),
        (("weight_n_m = 9.6", "weight_n_m = true"), "needs weight_n_m.*: got 'True'"),
        (("weight_n_m = 9.6", "weight_n_m = nan"), "needs weight_n_m.*: got 'nan'"),
        (("modulus_gpa = 77", "modulus_gpa = 77000"), "needs modulus_gpa, .* at most 250: got '77000'"),
        (("area_mm2 = 282.5", "area_mm2 = 2825"), "area_mm2 = 2825 for a diameter of 21.8 mm.*units of both"),
        (("modulus_gpa = 77", "modulus = 77\nmodulus_gpa = 77"), "has modulus, which is not known there"),
        (("name =", "name"), "is not valid TOML"),
        (("name = \"wire\"", "name = 3"), "needs name, a text: got '3'"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_conductor_is_named(tmp_path: Path, change: tuple[str, str], says: str) -> None:
    path = put(tmp_path, GOOD.replace(*change))
    with pytest.raises(ConfigError, match=f"{re.escape(str(path))}.*{says}"):
        MechanicsConfig(conductor=path)


def test_a_conductor_that_is_not_there_is_answered_with_those_there_are() -> None:
    with pytest.raises(ConfigError, match=r"no conductor file drake.*243-al1-39-st1a, acsr-drake"):
        load_conductor(Path("drake"))
    with pytest.raises(ConfigError, match=r"no conductor file elsewhere/acsr-drake"):
        load_conductor(Path("elsewhere/acsr-drake"))


def test_states_have_winds_from_both_sides_or_from_one(tmp_path: Path) -> None:
    text = HOT + "[[state]]\nname='storm'\ntemperature_c=5\nwind_m_s=30\nice_mm=4\nice_kg_m3=600\n"
    text += "[[state]]\nname='gale'\ntemperature_c=5\nwind_pa=200\nwind_to='right'\n"
    found = load_states(put(tmp_path, "strain = [1, 4]\n" + text))
    pressure = 0.5 * 1.225 * 30**2
    assert found.strain == (1, 4) and found.weather is None
    assert found.loads == (
        Load("hot", 75.0),
        Load("storm, to the left", 5.0, pressure, 4.0, 600.0),
        Load("storm, to the right", 5.0, -pressure, 4.0, 600.0),
        Load("gale", 5.0, -200.0),
    )


def test_the_weather_is_read(tmp_path: Path) -> None:
    text = HOT + "[weather]\ncurrent_a = 400\nair_c = 12\nwind_m_s = 1.5\nsun_w_m2 = 800\n"
    assert load_states(put(tmp_path, text)).weather == Weather(400.0, 12.0, 1.5, 90.0, 800.0, 0.0, 4.0)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "needs state, tables \\[\\[state\\]\\]: it is missing"),
        ("state = 3\n", "needs state, tables"),
        (HOT + HOT, "two states named 'hot'"),
        (HOT + "wind_pa = 3\nwind_m_s = 3\n", "gives its wind twice"),
        (HOT + "wind_pa = -3\n", "needs wind_pa, a number at least 0 and at most 5000: got '-3'"),
        (HOT + "wind_pa = 3\nwind_to = 'north'\n", "needs wind_to, one of left, right, both: got 'north'"),
        (HOT + "colour = 3\n", "State 1 of .* has colour, which is not known"),
        (HOT.replace("75", "750"), "needs temperature_c, a number at least -80 and at most 300: got '750'"),
        ("strain = ['A']\n" + HOT, "needs strain, whole numbers"),
        (HOT + "[weather]\nair_c = 3\n", "weather.* needs current_a"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_states_is_named(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        load_states(put(tmp_path, text))


def test_states_without_a_conductor_are_refused_before_anything_is_surveyed() -> None:
    with pytest.raises(ConfigError, match=r"depend on the conductor, but none is given. Give --conductor"):
        MechanicsConfig(states=Path("nesc-250b"))
