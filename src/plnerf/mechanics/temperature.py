"""The temperature of a conductor from its current and the weather: IEEE 738's steady state, by linerate."""

import math

from plnerf.errors import ConfigError
from plnerf.mechanics.conductor import Conductor
from plnerf.mechanics.loads import Weather

LEAST_C, MOST_C = -60.0, 350.0
"""Between which the temperature is sought."""


def conductor_temperature(conductor: Conductor, weather: Weather) -> float:
    """In degrees Celsius.  Raises ConfigError for a conductor whose file has no [thermal], and where the heat
    finds no balance.
    """
    import numpy as np
    from linerate import IEEE738
    from linerate import types as linerate

    thermal = conductor.thermal
    if thermal is None:
        raise ConfigError(
            f"The temperature of {conductor.name} cannot be computed from current and weather: its file has "
            "no [thermal] with ohm_per_km_25, ohm_per_km_75, emissivity and absorptivity. Give these, or "
            "--temperature-c."
        )

    class GivenSun(IEEE738):  # type: ignore[misc]  # its types are skipped: see pyproject.toml
        """With the sun's intensity as it is given, in place of that of a clear sky at a time and place."""

        def compute_global_radiation_intensity(self) -> float:
            return weather.sun_w_m2

    made_of = linerate.Conductor(
        core_diameter=0.0,
        conductor_diameter=conductor.diameter_mm / 1e3,
        outer_layer_strand_diameter=0.0,
        emissivity=thermal.emissivity,
        solar_absorptivity=thermal.absorptivity,
        temperature1=25.0,
        temperature2=75.0,
        resistance_at_temperature1=thermal.ohm_per_km_25 / 1e3,
        resistance_at_temperature2=thermal.ohm_per_km_75 / 1e3,
        aluminium_cross_section_area=conductor.area_mm2 / 1e6,
        constant_magnetic_effect=1.0,
        current_density_proportional_magnetic_effect=0.0,
        max_magnetic_core_relative_resistance_increase=1.0,
    )
    # A span that runs north, so that the wind's direction is its angle to the line.
    south, north = (
        linerate.Tower(longitude=0.0, latitude=at, altitude=weather.altitude_m) for at in (0.0, 0.003)
    )
    angle = math.radians(weather.wind_angle_deg)
    blowing = linerate.Weather(weather.air_c, angle, weather.wind_m_s, 0.0)
    model = GivenSun(linerate.Span(made_of, south, north, 1), blowing, np.datetime64("2000-01-01T12:00"))
    found = float(
        model.compute_conductor_temperature(
            weather.current_a, min_temperature=LEAST_C, max_temperature=MOST_C, tolerance=1e-4
        )
    )
    if not LEAST_C + 1 < found < MOST_C - 1:
        raise ConfigError(
            f"{conductor.name} finds no balance of heat between {LEAST_C:g} and {MOST_C:g} °C with "
            f"{weather.current_a:g} A at {weather.air_c:g} °C. Check the current, which is that of one "
            "subconductor, and the resistances."
        )
    return found
