"""Settings of the search for crowns' tops.  Without NumPy: the command line shows them at once."""

import math
from dataclasses import dataclass, field

from plnerf.errors import ConfigError
from plnerf.survey.stereo.config import BackdropConfig


@dataclass(frozen=True)
class CrownTopConfig:
    """Which crowns are examined, and when one goes on."""

    reach_m: float = 15.0
    """Crowns whose highest point is so near to a wire in plan are examined, and those that could fall on
    it."""
    below_wire_m: float = 0.5
    """Nothing is looked for nearer below a wire than this."""
    most_m: float = 4.0
    """Crowns go on by so much at most."""
    least_m: float = 0.5
    """Less than this is in the deviations of the crown's own points."""
    step_m: float = 0.25
    """Between the heights that are examined."""
    top_m: float = 1.5
    """The axis of a crown's top is the middle of its points so far below the highest."""
    farthest_m: float = 60.0
    """Photos taken from farther away do not show single leaves."""
    photos: int = 24
    """Photos that are asked, at most: the nearest."""
    chance: float = 0.01
    """Greatest probability that as many photos show something at a height by chance, one of five each."""
    least_share: float = 0.5
    """Share of the photos that must show something: what stands before or behind, only some show there."""
    gap_m: float = 0.5
    """A crown ends where nothing is found over this height."""
    sigma_m: float = 0.3
    """Standard deviation of the places that are found: half a window, and a step."""
    longest_px: int = 1280
    """Larger photos are reduced by a whole number."""
    backdrop: BackdropConfig = field(default_factory=BackdropConfig)

    def __post_init__(self) -> None:
        if min(self.step_m, self.top_m, self.sigma_m) <= 0 or not self.most_m < math.inf:
            raise ConfigError(
                "Tops of crowns need step_m, top_m and sigma_m greater than 0 and a finite most_m, but got "
                f"{self.step_m}, {self.top_m}, {self.sigma_m} and {self.most_m}."
            )
        if not (0 < self.chance < 1 and 0 < self.least_share <= 1) or self.longest_px < 32:
            raise ConfigError(
                "Tops of crowns need chance and least_share between 0 and 1 and longest_px >= 32, but got "
                f"{self.chance}, {self.least_share} and {self.longest_px}."
            )
