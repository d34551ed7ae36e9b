"""What a survey found: a classified cloud, towers, and conductors with what is known of each.

All in the world frame: metres, z up; local east-north-up of `origin` where there is one, else coordinates of
`crs` themselves (a LiDAR cloud's), float64.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int, UInt8

from plnerf.survey.fit import CatenaryFit

UNCLASSIFIED, GROUND, LOW_VEGETATION, VEGETATION, HIGH_VEGETATION, BUILDING = 1, 2, 3, 4, 5, 6
SHIELD, CONDUCTOR, TOWER, CONNECTOR, NOISE = 13, 14, 15, 16, 18
"""Classes of LAS 1.4 (ASPRS)."""
NO_WIRE = 0
"""Wire id of points on no wire; conductors count from 1."""
Kind = Literal["phase", "shield"]


@dataclass(frozen=True, eq=False)
class Tower:
    """A support: where spans meet."""

    foot: Float[np.ndarray, "3"]
    height_m: float


@dataclass(frozen=True, eq=False)
class Conductor:
    """One wire in one span, or one of a bundle."""

    id: int
    """From 1; what the cloud's points are labelled with."""
    span: int
    """From 0, along the line."""
    kind: Kind
    fit: CatenaryFit
    """Between its supports."""
    coverage: float
    """Share of its length with evidence."""
    longest_gap_m: float
    """Longest stretch without."""
    evidence: int
    """Points on it, or ridges in images."""
    source: str
    """What the fit rests on, in words: "1,204 points", "83 images"."""
    note: str | None = None
    """What a reader must know, such as a support that is not seen."""
    before: CatenaryFit | None = None
    """As it was before it was refitted to the images; None: not from images."""


@dataclass(frozen=True, eq=False)
class Cloud:
    """n points."""

    xyz: Float[np.ndarray, "n 3"]
    label: UInt8[np.ndarray, " n"]
    """ASPRS class."""
    wire: Int[np.ndarray, " n"]
    """Id of the conductor, NO_WIRE elsewhere."""
    rgb: UInt8[np.ndarray, "n 3"] | None = None
    sigma_m: Float[np.ndarray, " n"] | None = None
    """Standard deviation of the place."""


@dataclass(frozen=True, eq=False)
class Survey:
    """All of it."""

    conductors: tuple[Conductor, ...]
    towers: tuple[Tower, ...]
    cloud: Cloud
    unit: Literal["m", "unscaled"]
    crs: str | None
    """Of the survey, such as "EPSG:28992"; None: unknown."""
    origin: Float[np.ndarray, "3"] | None
    """Longitude, latitude (degrees) and height above the WGS 84 ellipsoid (m) of the world's origin, where
    the world is local; None: the world's coordinates are those of the CRS."""
    source: str
    """The run folder or the cloud's file."""
    notes: tuple[str, ...] = ()
    """What is missing or doubtful, in words."""
    temperature_c: float | None = None
    """Of the conductors when they were surveyed, if it is known."""
