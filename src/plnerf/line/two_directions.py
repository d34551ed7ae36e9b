"""Whether cameras look at a wire from two directions only, and which of them from which.

Lines of sight from two directions cross beside two wires as well as on them, so that images alone may not say
which of their lines is which wire's.
"""

import numpy as np
from jaxtyping import Bool, Float

HALF_TURN = 180.0


def second_direction(
    angles_deg: Float[np.ndarray, " t"], distinct: float, least_deg: float
) -> Bool[np.ndarray, " t"] | None:
    """Which lines of sight are of the second of two directions, where there are two that are distinct.

    angles_deg: of lines of sight across the wire; opposite ones are one direction.  Two are distinct if the
    angle between them is `distinct` times what either of them spans, which counts as least_deg at least.
    """
    if len(angles_deg) < 2:
        return None
    order = np.argsort(angles_deg % HALF_TURN)
    angles = angles_deg[order] % HALF_TURN
    gaps = np.diff(angles, append=angles[0] + HALF_TURN)
    widest = int(gaps.argmax())
    fan = np.concatenate([angles[widest + 1 :], angles[: widest + 1] + HALF_TURN])  # without a jump
    steps = np.diff(fan)
    cut = int(steps.argmax())
    widths = np.ptp(fan[: cut + 1]), np.ptp(fan[cut + 1 :])
    if steps[cut] < distinct * max(*widths, least_deg):
        return None
    beyond = np.zeros(len(order), bool)
    beyond[np.roll(order, -widest - 1)[cut + 1 :]] = True
    return beyond
