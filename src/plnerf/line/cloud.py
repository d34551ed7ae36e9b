"""A classified point cloud in the LineFrame."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, Shaped, UInt8

UNCLASSIFIED, GROUND, LOW_VEGETATION, VEGETATION, HIGH_VEGETATION, BUILDING = 1, 2, 3, 4, 5, 6
LOW_NOISE, SHIELD, CONDUCTOR, TOWER, CONNECTOR, NOISE = 7, 13, 14, 15, 16, 18
"""Classes of LAS 1.4 (ASPRS); NOISE is high noise."""
NO_WIRE = 0
"""Wire id of points on no wire; wires count from 1."""
NOT_JUDGED = -1
"""In place of a number of images, of points that are not judged by what images see."""


@dataclass(frozen=True, eq=False)
class Extra:
    """What extra bytes of a LAS file mean."""

    name: str
    type: str
    """As NumPy writes it, such as "i4" or "3f8"."""
    description: str
    scales: Float[np.ndarray, " _"] | None
    offsets: Float[np.ndarray, " _"] | None
    no_data: Shaped[np.ndarray, " _"] | None


@dataclass(frozen=True, eq=False)
class Attributes:
    """What a LAS file says of its n points beside their places; files have it as it came."""

    columns: Mapping[str, Shaped[np.ndarray, " n"]]
    """By the names of LAS 1.4's point formats 7 and 8."""
    label: UInt8[np.ndarray, " n"]
    """Its own classes."""
    extra: tuple[Extra, ...] = ()
    values: tuple[Shaped[np.ndarray, "n *_"], ...] = ()
    """Of the extra bytes, as they are stored."""
    standard_time: bool = False
    """Whether GPS times are standard ones, not those of a week."""
    keep_classes: bool = False
    """Whether files hold its own classes, and those of the survey beside them."""


@dataclass(frozen=True, eq=False)
class Cloud:
    """n points."""

    xyz: Float[np.ndarray, "n 3"]
    label: UInt8[np.ndarray, " n"]
    """ASPRS class."""
    wire: Int[np.ndarray, " n"]
    """Id of the wire, NO_WIRE elsewhere."""
    rgb: UInt8[np.ndarray, "n 3"] | None = None
    sigma_m: Float[np.ndarray, " n"] | None = None
    """Standard deviation of the place."""
    attributes: Attributes | None = None
    """Of clouds out of LAS files."""
    seen: Int[np.ndarray, " n"] | None = None
    """Of clouds from images, how many images see a thing where the point is; NOT_JUDGED of ground, wires and
    structures."""
    past: Int[np.ndarray, " n"] | None = None
    """How many see past it, likewise."""

    @classmethod
    def empty(cls) -> "Cloud":
        """Without points."""
        return cls(np.zeros((0, 3)), np.zeros(0, np.uint8), np.zeros(0, np.int64))
