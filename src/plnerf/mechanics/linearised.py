"""How certain a section's state is: what is unknown of curves, ends, temperature and conductor goes through
to first order.

The ratio r of the tensions depends on all spans by F(r, x) = 0, so that dr/dx = -F_x / F_r: no equation is
solved again.  x holds for each span theta (6) and ends (2), and for all m (4); a span's outputs depend on its
own part, on m, and on the others' through r alone.  Two spans' shares of what is unknown of one attachment
are taken as independent, which is on the safe side: what one gains the other loses.
"""

import numpy as np
from jaxtyping import Float

from plnerf.mechanics.change import OUTPUTS, SectionModel

STEPS = np.array([1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-3, 1e-3])
"""Of central differences in theta and ends, metres and radians."""
RELATIVE_STEP = 1e-4
"""In m, but for the temperature, whose step is in degrees."""


def covariances(
    model: SectionModel,
    theta: Float[np.ndarray, "n 6"],
    m: Float[np.ndarray, "4"],
    ratio: float,
    of_spans: Float[np.ndarray, "n 8 8"],
    of_m: Float[np.ndarray, "4 4"],
) -> Float[np.ndarray, "n 10 10"]:
    """Covariance of `SectionModel.outputs` of each span, at ends 0."""
    n = len(theta)
    own = np.zeros((n, OUTPUTS, 8))  # outputs by the span's own theta and ends
    ratio_by = np.zeros((n, 8))  # F by the same; then dr/dx
    zero = np.zeros((n, 2))

    def both(x: np.ndarray, of: np.ndarray, r: float) -> tuple[np.ndarray, np.ndarray]:
        """Outputs and residuals of all spans, each of which depends on its own row of x."""
        return model.outputs(x[:, :6], x[:, 6:], of, r), model.residual(x[:, :6], x[:, 6:], of, r)

    at = np.concatenate([theta, zero], 1)
    for k, step in enumerate(STEPS):
        high, low = at.copy(), at.copy()
        high[:, k] += step
        low[:, k] -= step
        (more, f_more), (less, f_less) = both(high, m, ratio), both(low, m, ratio)
        own[:, :, k] = (more - less) / (2 * step)
        ratio_by[:, k] = (f_more - f_less) / (2 * step)
    by_m, f_m = np.zeros((n, OUTPUTS, 4)), np.zeros(4)
    for k in range(4):
        step = 0.01 if k == 0 else RELATIVE_STEP * m[k]
        high, low = m.copy(), m.copy()
        high[k] += step
        low[k] -= step
        (more, f_more), (less, f_less) = both(at, high, ratio), both(at, low, ratio)
        by_m[:, :, k] = (more - less) / (2 * step)
        f_m[k] = (f_more - f_less).sum() / (2 * step)
    step = RELATIVE_STEP * ratio
    (more, f_more), (less, f_less) = both(at, m, ratio + step), both(at, m, ratio - step)
    by_r, f_r = (more - less) / (2 * step), (f_more - f_less).sum() / (2 * step)
    ratio_by, m_ratio = -ratio_by / f_r, -f_m / f_r

    through_r = np.einsum("na,nab,nb->n", ratio_by, of_spans, ratio_by)
    found = np.zeros((n, OUTPUTS, OUTPUTS))
    for k in range(n):
        J = own[k] + np.outer(by_r[k], ratio_by[k])
        M = by_m[k] + np.outer(by_r[k], m_ratio)
        others = float(through_r.sum() - through_r[k])
        found[k] = J @ of_spans[k] @ J.T + M @ of_m @ M.T + others * np.outer(by_r[k], by_r[k])
    return found
