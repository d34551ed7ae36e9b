"""What the refit seeks, what is known of it before, and in which order it stands in one vector.

Letters: w wires, n images; v directions times stretches, see `adjust.py`.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from plnerf.survey.refine.pose_prior import PosePrior
from plnerf.survey.refine.projection import MOVES
from plnerf.survey.refine.twins import Twins

FREE = 6
"""Numbers of theta."""
SWING = 5
"""The swing's place in theta."""


@dataclass(frozen=True, eq=False)
class State:
    """What is sought."""

    theta: Float[np.ndarray, "w 6"]
    pose: Float[np.ndarray, "n 6"]
    """Pose residuals, see `Projection.by_pose`."""
    bias: Float[np.ndarray, "w v"]
    """Brightness of a wire's edge beyond what the light explains, from each direction over each stretch; grey
    levels."""
    shading: Float[np.ndarray, "w 2"]
    """Brightness of a wire's edge towards y, and towards z, above that of its middle; grey levels."""
    common_shading: Float[np.ndarray, "2"]
    common_swing: float = 0.0


@dataclass(frozen=True, eq=False)
class Light:
    """How much brighter the edges of a span's wires are than their middles, by the light they stand in."""

    shading: Float[np.ndarray, "2"]
    """Towards y, and towards z; grey levels."""
    sigma: Float[np.ndarray, "2"]
    """Standard deviations of these."""


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known before."""

    theta: Float[np.ndarray, "w 6"]
    trust_m: Float[np.ndarray, " w"]
    """Standard deviation of a wire's place."""
    poses: PosePrior
    twins: tuple[Twins, ...] = ()
    light: Light | None = None
    """None: nothing is known of it."""


class Layout:
    """Where the unknowns of W wires and N images begin in their vector."""

    def __init__(self, W: int, N: int) -> None:
        self.pose = FREE * W
        self.shading = self.pose + MOVES * N
        self.common = self.shading + 2 * W
        self.common_swing = self.common + 2
        self.size = self.common_swing + 1

    def columns(self, w: int, n: int) -> np.ndarray:
        """Those that a measurement of wire w in image n depends on."""
        return np.concatenate([
            FREE * w + np.arange(FREE),
            self.pose + MOVES * n + np.arange(MOVES),
            self.shading + 2 * w + np.arange(2),
        ])
