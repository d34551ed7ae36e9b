"""How well a scene lies on the earth, by surveyed points: residuals, and their root mean squares.

In the terms of the ASPRS Positional Accuracy Standards for Digital Geospatial Data, edition 2 (2023): RMSE_H
is the root of the sum of the squared RMSEs east and north, RMSE_V that of heights, n the number of points.
Only points that did not hold the scene, check points, say how accurate it is; the standard asks for 30.
The points' own errors are in these figures and are not taken out of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

Role = Literal["control", "check"]
LEAST_CHECKS = 30
"""Check points that the standard asks for before an accuracy is claimed."""
LEAST_OFFSET_M = 1.0
"""Height references differ by more than this almost everywhere; less is an error of some survey."""
COMMON_SHARE = 0.1
"""An offset is one of heights if its horizontal part is below this share of the upright one."""
MAD_TO_SIGMA = 1.4826


@dataclass(frozen=True, eq=False)
class PointResidual:
    """A surveyed point and where the scene has it."""

    name: str
    role: Role
    off_m: Float[np.ndarray, "3"]
    """East, north and up: the scene's minus the survey's."""
    trusted: bool
    """Whether it agrees with the scene within its standard deviations."""

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        east, north, up = (float(value) for value in self.off_m)
        return {
            "name": self.name, "role": self.role, "east_m": east, "north_m": north, "up_m": up,
            "trusted": self.trusted,
        }  # fmt: skip


def accuracy(points: Sequence[PointResidual]) -> dict[str, Any] | None:
    """Figures of some points, all of them, trusted or not; None without any."""
    if not points:
        return None
    off = np.stack([point.off_m for point in points])
    east, north, up = (float(value) for value in np.sqrt((off**2).mean(0)))
    return {
        "n": len(off),
        "rmse_east_m": east,
        "rmse_north_m": north,
        "rmse_h_m": float(np.hypot(east, north)),
        "rmse_v_m": up,
        "mean_m": off.mean(0).tolist(),
        "worst_h_m": float(np.linalg.norm(off[:, :2], axis=1).max()),
        "worst_v_m": float(np.abs(off[:, 2]).max()),
    }


def accuracy_text(what: str, figures: dict[str, Any]) -> str:
    """Figures of some points in one sentence."""
    n = figures["n"]
    few = f" (the standard asks for {LEAST_CHECKS})" if what == "check" and n < LEAST_CHECKS else ""
    return (
        f"{what.capitalize()} points, n = {n}{few}: RMSE_H {figures['rmse_h_m']:.3f} m, RMSE_V "
        f"{figures['rmse_v_m']:.3f} m; worst {figures['worst_h_m']:.3f} m and {figures['worst_v_m']:.3f} m."
    )


@dataclass(frozen=True, eq=False)
class Offset:
    """An offset that several residuals share, such as between two vertical datums."""

    off_m: Float[np.ndarray, "3"]
    scatter_m: float
    """Greatest distance of a residual from it."""
    count: int

    @property
    def words(self) -> str:
        """Reads on after "they lie"."""
        up, flat = float(self.off_m[2]), float(np.linalg.norm(self.off_m[:2]))
        return (
            f"{abs(up):.2f} m {'higher' if up > 0 else 'lower'} and {flat:.2f} m aside, and within "
            f"{self.scatter_m:.2f} m of that each"
        )


def common_offset(
    off_m: Float[np.ndarray, "n 3"], sigma_m: Float[np.ndarray, "n 3"], sigmas: float
) -> Offset | None:
    """The upright offset that residuals have in common, as of heights above different things.

    sigmas: by so many standard deviations of their median it must differ from 0.  None where it is smaller,
    or below `LEAST_OFFSET_M`, where residuals point sideways, or scatter as much as they have in common.
    """
    if not len(off_m):
        return None
    middle = np.median(off_m, axis=0)
    scatter = np.median(np.abs(off_m - middle), axis=0) * MAD_TO_SIGMA
    of_median = sigmas * np.maximum(np.median(sigma_m, axis=0), scatter) / np.sqrt(len(off_m))
    up, flat = abs(float(middle[2])), float(np.linalg.norm(middle[:2]))
    common = up > max(LEAST_OFFSET_M, float(of_median[2]), 2 * float(scatter[2]))
    if not common or flat > max(COMMON_SHARE * up, float(of_median[:2].max())):
        return None
    return Offset(middle, float(np.linalg.norm(off_m - middle, axis=1).max()), len(off_m))
