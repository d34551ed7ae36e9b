"""The depth map of an image from what its stereo pairs show.

A pixel has a depth where two pairs agree, or where one pair alone has a match: that is less sure, and
`consistency.py` checks it against other images.

Letters: w = 1/t inverse distance along a pixel's ray; k pairs; h x w pixels, of which n have a match.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Float

from plnerf.ops.kernel_cache import njit
from plnerf.survey.stereo.config import MatchConfig
from plnerf.survey.stereo.pair import Shown


@dataclass(frozen=True, eq=False)
class DepthMap:
    """Distances along the rays of a view, and their standard deviations, LineFrame; NaN where unknown."""

    t: Float[np.ndarray, "h w"]
    sigma: Float[np.ndarray, "h w"]


def agreed(shown: Sequence[Shown], config: MatchConfig) -> DepthMap:
    """Depths where two pairs agree, or one of several alone has a match."""
    t, deviation = np.full(shown[0].w.shape, np.nan), np.full(shown[0].w.shape, np.nan)
    if len(shown) > 1:
        w, sigma = np.stack([one.w for one in shown]), np.stack([one.sigma for one in shown])
        limits = (config.agree_px / config.sigma_px, config.max_relative_sigma)
        widest = max(float(np.nanmax(sigma, initial=0.0)), 1e-12)
        _agree(w, sigma, widest, *limits, t, deviation)
    return DepthMap(t, deviation)


@njit(cache=True, error_model="numpy", nogil=True)
@no_type_check
def _agree(w, sigma, widest, agree, max_relative, t, deviation):
    """Into t and deviation (h, w): the weighted mean of the pairs that agree with the one with which most
    agree (of equals, the most exact), or of the only pair that has a match: near things leave most images.

    w, sigma: (k, h, w); widest: the greatest sigma.  The deviation is the least of theirs, for all share one
    image, or their spread where that is more.
    """
    count = len(w)
    for row in range(w.shape[1]):
        for column in range(w.shape[2]):
            known, best, most = 0, -1, -1.0
            for i in range(count):
                mine, own = w[i, row, column], sigma[i, row, column]
                if np.isnan(mine):
                    continue
                known += 1
                votes = -own / (2 * widest)
                for j in range(count):  # False with NaN
                    votes += abs(mine - w[j, row, column]) <= agree * max(own, sigma[j, row, column])
                if votes > most:
                    best, most = i, votes
            if best < 0:
                continue
            chosen, total, mean, square, exact = 0, 0.0, 0.0, 0.0, np.inf
            mine, own = w[best, row, column], sigma[best, row, column]
            for j in range(count):
                off, their = w[j, row, column] - mine, sigma[j, row, column]
                if abs(off) <= agree * max(own, their):
                    weight = 1 / (np.float64(their) * their)
                    chosen += 1
                    total += weight
                    mean += weight * off
                    square += weight * off * off
                    exact = min(exact, their)
            if chosen < 2 and known > 1:
                continue
            mean /= total
            spread = max(exact, np.sqrt(max(square / total - mean * mean, 0.0)))
            mean += mine
            if spread <= max_relative * mean:
                t[row, column] = 1 / mean
                deviation[row, column] = spread / (mean * mean)
