"""Pairs of chains that may be of one line: those that some plane through both cameras shows in both views.

What a view sees in such a plane the other sees in it too (epipolar geometry).  Each plane has an angle about
the line through both cameras.  A chain has the angles of its lines of sight, and of all pairs of chains four
in five have none in common.

Letters: n views, k partners of each, m pairs.
"""

import math
from typing import no_type_check

import numpy as np
from jaxtyping import Int

from plnerf.detect.chains import Chains
from plnerf.detect.views import Views
from plnerf.ops.kernel_cache import njit
from plnerf.ops.threads import share

PLACES = 5
"""Places along a chain at which its lines of sight are compared."""
BETWEEN = 0.05
"""Between these its angles may lie farther out, by this part of their range"""
LEAST_RAD = 1e-3
"""and by so much."""


def pairs_that_may_meet(
    chains: Chains, views: Views, partners: Int[np.ndarray, "n k"], spare: float
) -> Int[np.ndarray, "m 2"]:
    """Each a view's chain and one of a partner's, view after view.

    partners: of each view, -1 for none.  spare: by which part of its length the second chain may be longer.
    """
    counts, nothing = np.zeros(len(partners), np.int64), np.zeros((0, 2), np.int64)
    share(_pairs, chains, views, partners, spare, counts, nothing, of=len(partners))
    pairs = np.empty((int(counts.sum()), 2), np.int64)
    share(_pairs, chains, views, partners, spare, np.cumsum(counts) - counts, pairs, of=len(partners))
    return pairs


@njit(cache=True, error_model="numpy")
@no_type_check
def _pairs(chains, views, partners, spare, places, out, start, stop):
    """Into out (m, 2): the pairs, those of each view from its place on.  Where out has no room, into places
    (n,): how many pairs each view has."""
    first = chains.first
    for n in range(start, stop):
        at = 0 if len(out) == 0 else places[n]
        mine = np.empty((first[n + 1] - first[n], 2))
        for other in partners[n]:
            if other < 0:
                continue
            across, up = axes_about(views, n, other)
            for a in range(first[n], first[n + 1]):
                mine[a - first[n]] = angles_of(chains, views, a, 0.0, across, up)
            theirs = np.empty((first[other + 1] - first[other], 2))
            for b in range(first[other], first[other + 1]):
                theirs[b - first[other]] = angles_of(chains, views, b, spare, across, up)
            for a in range(len(mine)):
                for b in range(len(theirs)):
                    if mine[a, 0] <= theirs[b, 1] and theirs[b, 0] <= mine[a, 1]:
                        if len(out):
                            out[at, 0], out[at, 1] = first[n] + a, first[other] + b
                        at += 1
        if len(out) == 0:
            places[n] = at


@njit(cache=True, error_model="numpy")
@no_type_check
def axes_about(views, n, other):
    """Two axes across the line through two cameras, the first the way in which they look."""
    along = views.centre[other] - views.centre[n]
    along = along / max(np.sqrt((along * along).sum()), 1e-12)
    ahead = views.R[n, 2] + views.R[other, 2]
    ahead = ahead - (ahead * along).sum() * along
    ahead = ahead / max(np.sqrt((ahead * ahead).sum()), 1e-12)
    return ahead, np.cross(along, ahead)


@njit(cache=True, error_model="numpy")
@no_type_check
def angles_of(chains, views, c, spare, ahead, up):
    """Least and greatest angle of a chain's lines of sight about two axes; all where they are around the line
    through the cameras."""
    n, R = chains.owner[c], views.R
    u, v, begin, end = chains.along[c, 0], chains.along[c, 1], chains.ends[c, 0], chains.ends[c, 1]
    low, high, beyond = math.inf, -math.inf, spare * (end - begin)
    for k in range(PLACES):
        t = begin - beyond + (end - begin + 2 * beyond) * k / (PLACES - 1)
        across = chains.bend[c, 0] + t * (chains.bend[c, 1] + t * chains.bend[c, 2])
        x, y, side, height = t * u - across * v, t * v + across * u, 0.0, 0.0
        for axis in range(3):
            ray = R[n, 0, axis] * x + R[n, 1, axis] * y + R[n, 2, axis]
            side += ray * ahead[axis]
            height += ray * up[axis]
        angle = math.atan2(height, side)
        low, high = min(low, angle), max(high, angle)
    if high - low > math.pi / 2:
        return -math.inf, math.inf
    more = BETWEEN * (high - low) + LEAST_RAD
    return low - more, high + more
