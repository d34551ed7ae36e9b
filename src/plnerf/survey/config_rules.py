"""What decides the clearances by rule."""

from dataclasses import dataclass
from pathlib import Path

from plnerf.errors import ConfigError


@dataclass(frozen=True)
class RulesConfig:
    """Which matrix of clearances applies, and maps of what it is about.

    Raises SurveyError and ConfigError for a file that is missing or no file of its kind.
    """

    matrix: Path | None = None
    """A TOML file of rules, or the name of one of the package; None: none applies."""
    voltage_kv: float | None = None
    """Nominal voltage of the line."""
    objects: tuple[Path, ...] = ()
    """Maps of roads, rail, water and buildings: GeoJSON, GeoPackage or another format that GDAL reads."""
    object_field: str = "class"
    """The attribute that says what each object is: road, rail, water or building."""
    areas: tuple[str, ...] = ()
    """Areas that the line runs through, of those that rules are for."""
    under_m: float = 1.0
    """Vertical clearances to plants, buildings and other things: to what is within so much of straight below
    or above the wire."""

    def __post_init__(self) -> None:
        if not self.under_m > 0:
            raise ConfigError(f"Clearances by rule need under_m > 0, but got under_m={self.under_m}.")
        if self.objects and self.matrix is None:
            raise ConfigError(
                f"The map {self.objects[0]} is for clearances by rule, but no rules are given. Give --rules."
            )
        if self.matrix is None:
            return
        from plnerf.survey.map_objects import check_maps
        from plnerf.survey.rule_file import load_matrix  # bring NumPy

        matrix = load_matrix(self.matrix)
        matrix.number_of(self.kv)
        matrix.check_areas(self.areas)
        check_maps(self.objects, self.object_field)

    @property
    def kv(self) -> float:
        """Nominal voltage.  Raises ConfigError where none is given."""
        if self.voltage_kv is None:
            raise ConfigError(
                f"The rules of {self.matrix} are by voltage, but none is given. Give --voltage-kv."
            )
        return self.voltage_kv
