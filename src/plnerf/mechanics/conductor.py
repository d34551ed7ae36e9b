"""What a conductor is made of, as far as its sag depends on it: read from a TOML file.

    weight       w, N/m              E A          N: a final modulus, as of wire that has long hung
    diameter     mm                  expansion    1/K
"""

from dataclasses import dataclass
from pathlib import Path

from plnerf.errors import ConfigError
from plnerf.scene.toml_files import Fields, read_toml

FOLDER = "conductors"
"""In the package's data."""


@dataclass(frozen=True)
class Thermal:
    """What its temperature depends on (IEEE 738)."""

    ohm_per_km_25: float
    """Resistance to alternating current at 25 degrees Celsius."""
    ohm_per_km_75: float
    emissivity: float
    absorptivity: float


@dataclass(frozen=True)
class Conductor:
    """One kind of wire; of a bundle, one of its subconductors."""

    name: str
    source: str
    weight_n_m: float
    diameter_mm: float
    area_mm2: float
    modulus_gpa: float
    """Final: the slope by which wire that has been loaded before lengthens."""
    expansion_per_k: float
    rated_strength_kn: float | None = None
    weight_sigma: float = 0.01
    """Relative standard deviations of the three that a sag's change depends on."""
    modulus_sigma: float = 0.05
    expansion_sigma: float = 0.03
    caveats: tuple[str, ...] = ()
    thermal: Thermal | None = None

    @property
    def ea_n(self) -> float:
        """Newtons per unit of strain."""
        return self.modulus_gpa * 1e3 * self.area_mm2


def load_conductor(path: Path) -> Conductor:
    """Reads a conductor from a TOML file of the form of `data/conductors/`, or by the name of one of these.

    Raises ConfigError where there is none, or it lacks a value or has one out of bounds.
    """
    fields = Fields(read_toml(path, FOLDER, "conductor"), f"The conductor file {path}")
    tolerance = Fields(fields.table("tolerance") or {}, f"[tolerance] of {path}")
    thermal = fields.table("thermal")
    strength = fields.number("rated_strength_kn", above=0.0) if fields.has("rated_strength_kn") else None
    found = Conductor(
        name=fields.text("name"),
        source=fields.text("source"),
        weight_n_m=fields.number("weight_n_m", above=0.0, most=200.0),
        diameter_mm=fields.number("diameter_mm", above=0.0, most=100.0),
        area_mm2=fields.number("area_mm2", above=0.0, most=5000.0),
        modulus_gpa=fields.number("modulus_gpa", least=20.0, most=250.0),
        expansion_per_k=fields.number("expansion_per_k", above=0.0, most=5e-5),
        rated_strength_kn=strength,
        weight_sigma=tolerance.number("weight", 0.01, least=0.0, most=0.5),
        modulus_sigma=tolerance.number("modulus", 0.05, least=0.0, most=0.5),
        expansion_sigma=tolerance.number("expansion", 0.03, least=0.0, most=0.5),
        caveats=fields.texts("caveats"),
        thermal=None if thermal is None else _thermal(thermal, path),
    )
    tolerance.done()
    fields.done()
    if found.area_mm2 > found.diameter_mm**2:  # more than a square of its diameter
        raise ConfigError(
            f"The conductor file {path} says area_mm2 = {found.area_mm2:g} for a diameter of "
            f"{found.diameter_mm:g} mm, which it cannot have. Check the units of both."
        )
    return found


def _thermal(values: dict[str, object], path: Path) -> Thermal:
    fields = Fields(values, f"[thermal] of {path}")
    found = Thermal(
        ohm_per_km_25=fields.number("ohm_per_km_25", above=0.0, most=100.0),
        ohm_per_km_75=fields.number("ohm_per_km_75", above=0.0, most=100.0),
        emissivity=fields.number("emissivity", above=0.0, most=1.0),
        absorptivity=fields.number("absorptivity", above=0.0, most=1.0),
    )
    fields.done()
    return found
