"""What decides which names structures and wires get."""

from dataclasses import dataclass
from pathlib import Path

from plnerf.errors import ConfigError


@dataclass(frozen=True)
class NamesConfig:
    """A list of named places, and how near to them a structure or a wire must be.

    Raises ConfigError for a file that is missing or no list of names.
    """

    places: Path | None = None
    """CSV, KML, GeoPackage or another map that GDAL reads; None: nothing is named."""
    structure_m: float = 10.0
    """Greatest distance in plan between a structure and the place of its name."""
    wire_m: float = 2.0
    """Greatest distance between a wire and the place of its phase's name: in space where that has a height,
    else in plan."""

    def __post_init__(self) -> None:
        if not (self.structure_m > 0 and self.wire_m > 0):
            raise ConfigError(
                "Names need structure_m and wire_m greater than 0, but got "
                f"{self.structure_m} and {self.wire_m}."
            )
        if self.places is not None:
            from plnerf.survey.named_places import check_places  # brings NumPy

            check_places(self.places)
