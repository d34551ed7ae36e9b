"""A classified point cloud in the LineFrame."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8

UNCLASSIFIED, GROUND, LOW_VEGETATION, VEGETATION, HIGH_VEGETATION, BUILDING = 1, 2, 3, 4, 5, 6
SHIELD, CONDUCTOR, TOWER, CONNECTOR, NOISE = 13, 14, 15, 16, 18
"""Classes of LAS 1.4 (ASPRS)."""
NO_WIRE = 0
"""Wire id of points on no wire; wires count from 1."""


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

    @classmethod
    def empty(cls) -> "Cloud":
        """Without points."""
        return cls(np.zeros((0, 3)), np.zeros(0, np.uint8), np.zeros(0, np.int64))
