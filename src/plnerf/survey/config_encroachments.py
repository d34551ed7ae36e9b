"""What decides the encroachments."""

import math
from dataclasses import dataclass

from plnerf.errors import ConfigError


@dataclass(frozen=True)
class EncroachmentConfig:
    """Which ways are examined, and how points become objects."""

    growth_m: float | None = None
    """Growth of plants in a year, metres, towards the wire from wherever they stand; None: not known, and
    growth is not examined."""
    growth_years: float = 3.0
    """Until when growth is examined, years after the survey."""
    growth_sigma: float = 0.3
    """Standard deviation of the growth, as a share of it."""
    cell_m: float = 0.5
    """Side of the cells by which points are grouped into objects."""
    reach_cells: int = 2
    """Cells that are so near to each other along each axis belong together."""
    prominence_m: float = 1.0
    """A crown is one of its own where it rises so far above the way to a higher one, or"""
    prominence_share: float = 0.15
    """by this share of its height where that is more."""
    min_around: int = 16
    """Of a plant in a cloud from images half of the points have so many others within `around_m`: what is
    sparser are wrong matches, scattered in the air."""
    around_m: float = 1.0
    """The distance that this means where the ground's points are dense,"""
    around_spacings: float = 3.0
    """and in spacings of the ground's points where that is more."""
    stem_sigma_m: float = 0.7
    """Standard deviation of a tree's foot in plan, which is taken to be below the middle of its crown."""
    pictures: int = 12
    """Encroachments, the most urgent, of which the report shows parts of photos."""

    def __post_init__(self) -> None:
        if self.growth_m is not None and not 0 <= self.growth_m < math.inf:
            raise ConfigError(f"Encroachments need a finite growth_m of 0 or more, but got {self.growth_m}.")
        shares = (self.growth_years, self.growth_sigma, self.stem_sigma_m, self.prominence_share)
        if not all(0 <= one < math.inf for one in shares):
            raise ConfigError(
                "Encroachments need growth_years, growth_sigma, stem_sigma_m and prominence_share of 0 or "
                f"more, but got {self.growth_years}, {self.growth_sigma}, {self.stem_sigma_m} and "
                f"{self.prominence_share}."
            )
        if not (self.cell_m > 0 and self.prominence_m > 0) or self.reach_cells < 1 or self.pictures < 0:
            raise ConfigError(
                "Encroachments need cell_m and prominence_m greater than 0, reach_cells of 1 or more and "
                f"pictures of 0 or more, but got {self.cell_m}, {self.prominence_m}, {self.reach_cells} and "
                f"{self.pictures}."
            )
        around = 0 < self.around_m < math.inf and 0 <= self.around_spacings < math.inf
        if self.min_around < 0 or not around:
            raise ConfigError(
                "Encroachments need min_around and around_spacings of 0 or more and around_m greater than 0, "
                f"but got {self.min_around}, {self.around_spacings} and {self.around_m}."
            )
