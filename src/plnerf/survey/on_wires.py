"""Which points of a surface are a conductor's, and which cannot be told from one.

A point is uncertain along its line of sight: along it, what is seen of a wire is smeared.

Letters: n points, w wires; s steps along a line of sight.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from plnerf.line.old_catenary import Catenary
from plnerf.survey.field_surface import Surface
from plnerf.survey.obstacles import sampled

ON_WIRE_M = 0.25
"""A point this near to a conductor is on it."""
REACH_SIGMAS = 3.0
"""A point may be so far along its line of sight from where it is said to be."""
FARTHEST_M = 10.0
"""No line of sight is followed further."""
NONE = -1


def on_wires(
    surface: Surface, wires: Sequence[Catenary], metre: float = 1.0
) -> tuple[Int[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Index of the wire that each point is on, `NONE` elsewhere; and which of the other points may be on one.

    Those have a line of sight that comes as near to a wire within `REACH_SIGMAS`.  metre: its length in the
    surface's units.
    """
    wire, doubtful = np.full(len(surface.xyz), NONE), np.zeros(len(surface.xyz), np.bool_)
    if not wires or not len(surface.xyz):
        return wire, doubtful
    lines = [sampled(one) for one in wires]
    owner = np.repeat(np.arange(len(lines)), [len(line) for line in lines])
    tree, near = cKDTree(np.concatenate(lines)), ON_WIRE_M * metre
    reach: Float[np.ndarray, " n"] = np.minimum(REACH_SIGMAS * surface.sigma, FARTHEST_M * metre)
    apart, at = tree.query(surface.xyz, distance_upper_bound=near + float(reach.max()), workers=-1)
    wire[apart <= near] = owner[at[apart <= near]]
    may = np.flatnonzero((apart > near) & (apart <= near + reach))
    for s in np.arange(near, float(reach.max()) + near, near):
        for step in (s, -s):
            some = may[s < reach[may] + near]
            apart, _ = tree.query(
                surface.xyz[some] + step * surface.sight[some], distance_upper_bound=near, workers=-1
            )
            doubtful[some[np.isfinite(apart)]] = True
    return wire, doubtful
