"""What decides where wires are searched.

Letters and frames as in `config.py`.
"""

import math
from dataclasses import dataclass

from plnerf.detect.config_lines import check


@dataclass(frozen=True)
class WindowConfig:
    """Windows along a direction, and the volume of each that is searched (`windows.py`)."""

    whole: float = 40.0
    """A flight of so many distances between one image and the next is one window;"""
    spacings: float = 25.0
    """windows of a longer one are as long as so many,"""
    overlap: float = 0.34
    """and at least this part of each lies over the one before it.  With a half, the same wires of eight spans
    are found in 8 % more time."""
    least_step: float = 0.12
    """Images nearer to each other than this fraction of a footprint count as so far apart: a film shows no
    more of a line than photos that overlap, and its windows hold as much of it."""
    margin: float = 0.27
    """A direction is searched beyond the first and the last camera, as a fraction of their distance or of
    `whole` spacings, whichever is less."""
    follow: float = 0.33
    """Wires that are found are followed so far beyond the ends of a direction's windows, as a fraction of a
    window's length."""
    planes: int = 80
    """Planes across a window in which lines are looked for, for each stretch as long as what was flown past
    or as a window of a longer flight;"""
    shown: float = 16.0
    """and at least so many for each stretch that an image shows: a long lens near the wires shows little."""
    aside: float = 0.5
    """Wires are searched so far to either side of the cameras, as a fraction of the window's length,"""
    below: float = 0.5
    """below the lowest of them,"""
    above: float = 0.35
    """and above the highest."""
    near: float = 0.5
    """Views that stand within this fraction of a window's length before and behind it are used,"""
    places: tuple[int, int, int] = (12, 8, 6)
    """in windows of a longer flight if they see, of so many places along a window, across and upwards,"""
    least_shown: float = 0.05
    """at least this share: others would cost as much;"""
    enough: int = 48
    """or are among the so many that see most: through a long lens every view sees little."""

    def __post_init__(self) -> None:
        check(
            0 < self.spacings <= self.whole and 0 < self.overlap < 1
            and min(self.aside, self.below, self.above, self.near, *self.places) > 0
            and min(self.margin, self.follow, self.least_step, self.least_shown, self.shown) >= 0
            and min(self.planes, self.enough) >= 10,
            "detect.windows needs positive lengths and places, whole not below spacings, an overlap between "
            "0 and 1, margin, follow, least_step, least_shown and shown of 0 or more, and planes and enough "
            "of 10 or more",
            self,
        )


@dataclass(frozen=True)
class OnwardConfig:
    """The search for what begins where wires end (`onward.py`), in windows about their ends."""

    half_px: float = 500.0
    """Half a window's length, in pixels of the views that see it."""
    planes: int = 60
    """Planes across it."""
    step_rad: float = math.radians(10.0)
    """From the direction of one window to the next: curves may run askew by half of it and a little more."""
    least_views: int = 6
    """Views that must see the place;"""
    finest: float = 4.0
    """of more those in which a pixel is at most so many times as wide there as in the first so many."""
    around: float = 0.3
    """A wire may end so far before or behind the structure, in units of half a window's length,"""
    past: float = 0.03
    """and the next one's line run past it by so much."""
    places: tuple[int, int, int] = (12, 8, 6)
    """Places that views whose chains meet may have in common, as of `ChainConfig`: a window is no longer than
    an image.  With 8, 6 and 4, or with fewer partners, less is found (seeds 98 and 110)."""
    most: int = 3
    """Directions that are searched at a place, at most."""
    min_odds: float = 100.0
    """Nats that a line needs there, beside another that runs as it does: planes are near to each other."""

    def __post_init__(self) -> None:
        check(
            min(self.half_px, self.around, self.past, self.min_odds) > 0 and 0 < self.step_rad < 1
            and min(self.least_views, self.planes) >= 3
            and min(self.most, self.finest, *self.places) >= 1,
            "detect.onward needs half_px, around, past and min_odds above 0, a step_rad above 0 and below 1, "
            "least_views and planes of 3 or more, and finest, most and places of 1 or more",
            self,
        )
