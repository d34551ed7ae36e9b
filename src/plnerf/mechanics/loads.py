"""The states that are asked for, and the weather at the survey where the conductors' temperature is not
known: read from one TOML file.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plnerf.errors import ConfigError
from plnerf.line.states import SURVEYED, Load
from plnerf.scene.toml_files import Fields, read_toml

FOLDER = "states"
"""In the package's data."""
DEFAULT = Path("temperatures")
AIR_KG_M3 = 1.225
"""Of the pressure of a wind, 0.5 rho v^2 with a drag coefficient of 1, as of a round wire."""


@dataclass(frozen=True)
class Weather:
    """At the survey, from which IEEE 738 has the conductors' temperature."""

    current_a: float
    """In each subconductor."""
    air_c: float
    wind_m_s: float
    wind_angle_deg: float
    """Between wind and line."""
    sun_w_m2: float
    """On the conductor's projected area."""
    altitude_m: float
    sigma_c: float
    """Standard deviation of the temperature that comes out."""


@dataclass(frozen=True)
class StateTable:
    """A file's content."""

    loads: tuple[Load, ...]
    weather: Weather | None = None
    strain: tuple[int, ...] = ()
    """Structures, by the numbers of the survey, that are known to end a tension section."""


def load_states(path: Path) -> StateTable:
    """Reads states from a TOML file of the form of `data/states/`, or by the name of one of these.

    A wind without a direction makes two states, to either side.  Raises ConfigError where there is no such
    file, or it lacks a value or has one out of bounds.
    """
    fields = Fields(read_toml(path, FOLDER, "state"), f"The state file {path}")
    loads: list[Load] = []
    for number, values in enumerate(fields.tables("state"), 1):
        loads += _loads(values, f"State {number} of {path}")
    weather = fields.table("weather")
    strain = fields.numbers("strain")
    for name in ("source", "note"):  # for people
        if fields.has(name):
            fields.text(name)
    fields.done()
    names = [one.name for one in loads]
    if SURVEYED in names:
        raise ConfigError(f"A state of {path} is named {SURVEYED!r}, as the survey itself is. Rename it.")
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ConfigError(f"The state file {path} has two states named {twice!r}. Give each its own name.")
    return StateTable(tuple(loads), None if weather is None else _weather(weather, path), strain)


def _loads(values: dict[str, Any], where: str) -> list[Load]:
    fields = Fields(values, where)
    name = fields.text("name")
    temperature_c = fields.number("temperature_c", least=-80.0, most=300.0)
    ice_mm = fields.number("ice_mm", 0.0, least=0.0, most=200.0)
    density = fields.number("ice_kg_m3", 900.0, least=50.0, most=920.0)
    if fields.has("wind_pa") and fields.has("wind_m_s"):
        raise ConfigError(f"{where} gives its wind twice. Give wind_pa or wind_m_s.")
    pressure = fields.number("wind_pa", 0.0, least=0.0, most=5000.0)
    speed = fields.number("wind_m_s", 0.0, least=0.0, most=90.0)
    pressure = pressure or 0.5 * AIR_KG_M3 * speed**2
    to = fields.one_of("wind_to", ("left", "right", "both"), "both")
    fields.done()
    if not pressure:
        return [Load(name, temperature_c, 0.0, ice_mm, density)]
    sides = {"left": pressure, "right": -pressure}
    return [
        Load(f"{name}, to the {side}" if to == "both" else name, temperature_c, sides[side], ice_mm, density)
        for side in sides
        if to in {side, "both"}
    ]


def _weather(values: dict[str, Any], path: Path) -> Weather:
    fields = Fields(values, f"[weather] of {path}")
    found = Weather(
        current_a=fields.number("current_a", least=0.0, most=10000.0),
        air_c=fields.number("air_c", least=-60.0, most=60.0),
        wind_m_s=fields.number("wind_m_s", least=0.0, most=60.0),
        wind_angle_deg=fields.number("wind_angle_deg", 90.0, least=0.0, most=180.0),
        sun_w_m2=fields.number("sun_w_m2", least=0.0, most=1500.0),
        altitude_m=fields.number("altitude_m", 0.0, least=-500.0, most=6000.0),
        sigma_c=fields.number("sigma_c", 4.0, least=0.0, most=30.0),
    )
    fields.done()
    return found
