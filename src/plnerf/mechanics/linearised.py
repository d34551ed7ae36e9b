"""How certain a section's state is: what is unknown of curves, ends, temperature and conductor goes through
to first order.

The ratio r of the tensions depends on all spans by F(r, x) = 0, so that dr/dx = -F_x / F_r: no equation is
solved again.  x holds for each span theta (6) and ends (2), and for all m (4); a span's outputs depend on its
own part, on m, and on the others' through r alone.  Two spans' shares of what is unknown of one attachment
are taken as independent, which is on the safe side: what one gains the other loses.
"""

import numpy as np
from jaxtyping import Float

from plnerf.mechanics.change_of_state import OUTPUTS, SectionModel, Spans

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

    def slopes(
        high: tuple[Spans, np.ndarray, float], low: tuple[Spans, np.ndarray, float], step: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Of outputs and residuals of all spans, each of which depends on its own part of x."""
        return (
            (model.outputs(*high) - model.outputs(*low)) / (2 * step),
            (model.residual(*high) - model.residual(*low)) / (2 * step),
        )

    def moved(k: int, by: float) -> Spans:
        x = np.concatenate([theta, np.zeros((n, 2))], 1)
        x[:, k] += by
        return model.spans(x[:, :6], x[:, 6:])

    for k, step in enumerate(STEPS):
        own[:, :, k], ratio_by[:, k] = slopes((moved(k, step), m, ratio), (moved(k, -step), m, ratio), step)
    surveyed = moved(0, 0.0)
    by_m, f_m = np.zeros((n, OUTPUTS, 4)), np.zeros(4)
    for k in range(4):
        step = 0.01 if k == 0 else RELATIVE_STEP * m[k]
        off = step * (np.arange(4) == k)
        by_m[:, :, k], by_span = slopes((surveyed, m + off, ratio), (surveyed, m - off, ratio), step)
        f_m[k] = by_span.sum()
    step = RELATIVE_STEP * ratio
    by_r, by_span = slopes((surveyed, m, ratio + step), (surveyed, m, ratio - step), step)
    f_r = by_span.sum()
    ratio_by, m_ratio = -ratio_by / f_r, -f_m / f_r

    through_r = np.einsum("na,nab,nb->n", ratio_by, of_spans, ratio_by)
    found = np.zeros((n, OUTPUTS, OUTPUTS))
    for k in range(n):
        J = own[k] + np.outer(by_r[k], ratio_by[k])
        M = by_m[k] + np.outer(by_r[k], m_ratio)
        others = float(through_r.sum() - through_r[k])
        found[k] = J @ of_spans[k] @ J.T + M @ of_m @ M.T + others * np.outer(by_r[k], by_r[k])
    return found
