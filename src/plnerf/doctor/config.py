"""What decides a diagnosis: of photos, and of a scene's poses."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from plnerf.detect.config import DEFAULT as DETECT
from plnerf.errors import ConfigError

DIAMETER_M = 0.03
"""Of the conductors of high-voltage lines: 20 to 40 mm."""


@dataclass(frozen=True)
class PhotoDoctorConfig:
    """When something is wrong with photos (`photo_rules.py`)."""

    wire_diameter_m: float = DIAMETER_M
    """Diameter of the conductors, in metres."""
    judged_px: int = 1000
    """Longer side of the pictures that are judged, in pixels."""
    bright: int = 250
    """Grey value from which on a pixel is saturated,"""
    dark: int = 5
    """and up to which it is black."""
    clipped: float = 0.25
    """Share of such pixels from which a photo is called over- or under-exposed."""
    alike: float = 2.0
    """Mean difference in grey values of thumbnails below which two photos are one."""
    fastest_m_s: float = 60.0
    """Speed that no drone flies, in m/s."""
    stray: float = 20.0
    """A step so many times as long as the median one is called a jump, where no times are known,"""
    least_jump_m: float = 100.0
    """if it is longer than this, in metres."""
    least_wire_px: float = 1.0
    """Width of a conductor in pixels below which it is not found,"""
    good_wire_px: float = 3.0
    """and from which on it is found well."""

    def __post_init__(self) -> None:
        _check_positive(
            self, ("wire_diameter_m", "judged_px", "fastest_m_s", "stray", "least_wire_px", "good_wire_px")
        )
        if not 0 <= self.dark < self.bright <= 255 or not 0 < self.clipped <= 1:
            raise ConfigError(
                f"The doctor needs 0 <= dark < bright <= 255 and clipped within (0, 1], but has dark "
                f"{self.dark}, bright {self.bright} and clipped {self.clipped}. Correct them."
            )


@dataclass(frozen=True)
class SceneDoctorConfig:
    """When views place a wire (`coverage.py`)."""

    wire_diameter_m: float = DIAMETER_M
    """Diameter of the conductors, in metres."""
    sigma_px: float = 0.5
    """Standard deviation of a wire's axis as it is found in an image, in pixels."""
    pose_sigma_m: float = 0.0
    """Standard deviation of a camera's centre, independent between views, in metres."""
    good_px: float = DETECT.certainty.certain_px
    """Greatest standard deviation of a wire's place for a stretch to be good, in pixels of the view that
    magnifies it most: that up to which a detected wire is certain."""
    unobservable_m: float = 1.0
    """Standard deviation from which on a wire's place is called unobservable, in metres."""
    distance_m: float = 10.0
    """Distance between cameras and wires, in metres, where neither the scene nor the user states one.  In an
    unscaled scene it stands for the distance that is assumed there, so that what is unobservable is a share
    of it: 10 %."""
    spacings: float = 10.0
    """That assumption: as many times the typical distance between two photos."""
    least_px: float = 0.5
    """Width of a wire in pixels below which it is not found in an image, so that the view does not count."""
    stretches: int = 20
    """Most stretches that a line is cut into."""
    least_stretch_m: float = 2.0
    """Shortest length of a stretch, in metres."""
    depths: tuple[float, ...] = (0.7, 1.0, 1.4)
    """Points on every camera's optical axis that stand for wires, at these shares of the distance."""

    def __post_init__(self) -> None:
        names = ("wire_diameter_m", "sigma_px", "good_px", "unobservable_m", "distance_m", "spacings",
                 "least_px", "stretches", "least_stretch_m")  # fmt: skip
        _check_positive(self, names)
        if not self.depths or min(self.depths) <= 0:
            raise ConfigError(
                f"The doctor needs depths greater than 0, but has {self.depths}. Give one or more."
            )


def _check_positive(config: PhotoDoctorConfig | SceneDoctorConfig, names: Sequence[str]) -> None:
    for name in names:
        value = getattr(config, name)
        if not 0 < value < math.inf:
            raise ConfigError(
                f"The doctor's {name} must be a positive number, but is {value:g}. Give another."
            )


PHOTOS, SCENES = PhotoDoctorConfig(), SceneDoctorConfig()
