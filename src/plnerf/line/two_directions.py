"""Wires that cameras look at from two directions only: which from which, and where lines of sight meet.

Lines of sight from two directions cross beside two wires as well as on them, so that images alone may not say
which of their lines is which wire's.  All in the plane across the wires: y to the side, z up.
"""

import numpy as np
from jaxtyping import Bool, Float

HALF_TURN = 180.0
SIGHT_RAD = 1e-3
"""To about which angle lines of sight are known to which wires were fitted."""


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


def by_ends_and_middle(s: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k 3"]:
    """Places s in [0, 1] along a parabola, by its values at both ends and its middle's from their mean."""
    return np.column_stack([1 - s, s, 4 * s * (1 - s)])


def through_sights(
    eyes: Float[np.ndarray, "t 2"],
    sees: Bool[np.ndarray, "t k"],
    targets: Float[np.ndarray, "t k 2"],
    s: Float[np.ndarray, " k"],
    middle: Float[np.ndarray, "2"],
    tie: float,
) -> Float[np.ndarray, "2 3"]:
    """y and z of the parabola through lines of sight from eyes to targets, as `by_ends_and_middle` has them.

    By least squares of angles.  A short piece tells little of its middle's offset, held near `middle`
    with the standard deviation `tie`.
    """
    to = (targets - eyes[:, None])[sees]
    normals = np.column_stack([-to[:, 1], to[:, 0]]) / (to**2).sum(1, keepdims=True) / SIGHT_RAD
    by_place = np.broadcast_to(by_ends_and_middle(s), (*sees.shape, 3))[sees]
    rows = (normals[:, :, None] * by_place[:, None]).reshape(-1, 6)
    values = (normals * targets[sees]).sum(1)
    near = np.array([[0, 0, 1, 0, 0, 0], [0, 0, 0, 0, 0, 1]]) / tie
    curve, *_ = np.linalg.lstsq(
        np.concatenate([rows, near]), np.concatenate([values, middle / tie]), rcond=None
    )
    return curve.reshape(2, 3)
