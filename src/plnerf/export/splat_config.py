"""What decides how a field is turned into Gaussians."""

from dataclasses import dataclass

from plnerf.errors import ConfigError


@dataclass(frozen=True)
class SplatConfig:
    """How many Gaussians, fitted to which renders, for how long."""

    count: int = 100_000
    """Gaussians at most, without those of wires."""
    degree: int = 2
    """Of the spherical harmonics of the colours: 0, 1 or 2."""
    steps: int = 300
    """Steps of the fit, each on one render of the field; 0 leaves the Gaussians as they are laid out."""
    views: int = 64
    """Training cameras at most whose renders are fitted, chosen evenly."""
    pixels: int = 200_000
    """Pixels of a render at most; larger ones are rendered smaller."""
    wires: bool = True
    """Draw the wires as Gaussians along their curves, for display."""
    seed: int = 0
    """Decides every random draw."""

    def __post_init__(self) -> None:
        if self.count < 1 or self.views < 1 or self.pixels < 1 or self.steps < 0 or self.seed < 0:
            raise ConfigError(
                "Splats need count, views and pixels of 1 or more, steps and a seed of 0 or more, but got "
                f"count={self.count}, views={self.views}, pixels={self.pixels}, steps={self.steps}, "
                f"seed={self.seed}."
            )
        if not 0 <= self.degree <= 2:
            raise ConfigError(f"Spherical harmonics here have degree 0 to 2, but got degree={self.degree}.")
