"""Points on surfaces, as images or a field show them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8


@dataclass(frozen=True, eq=False)
class Surface:
    """n points, LineFrame."""

    xyz: Float[np.ndarray, "n 3"]
    rgb: UInt8[np.ndarray, "n 3"]
    sigma_m: Float[np.ndarray, " n"]
    """Standard deviation along the line of sight."""
    sight: Float[np.ndarray, "n 3"]
    """The direction in which each is seen, unit length."""

    @classmethod
    def empty(cls) -> "Surface":
        """Without points."""
        return cls(np.zeros((0, 3)), np.zeros((0, 3), np.uint8), np.zeros(0), np.zeros((0, 3)))

    def chosen(self, use: Bool[np.ndarray, " n"]) -> "Surface":
        """Those of its points."""
        return Surface(self.xyz[use], self.rgb[use], self.sigma_m[use], self.sight[use])

    @property
    def upright_sigma_m(self) -> Float[np.ndarray, " n"]:
        """Standard deviation of the height: along flat ground a point may move as it will."""
        upright: Float[np.ndarray, " n"] = self.sigma_m * np.abs(self.sight[:, 2])
        return upright


def joined(parts: Sequence[Surface]) -> Surface:
    """All points of several surfaces, in their order."""
    if not parts:
        return Surface.empty()
    columns = zip(*((one.xyz, one.rgb, one.sigma_m, one.sight) for one in parts), strict=True)
    return Surface(*(np.concatenate(column) for column in columns))
