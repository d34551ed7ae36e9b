"""Which points of a surface lie on a wire, and which may lie on one.

The place of a point is uncertain along its line of sight, and along it what images show of a wire is smeared.

Letters: n points, w wires; s steps along a line of sight; LineFrame, metres.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from plnerf.line.wire import Wire
from plnerf.survey.config_ground import OnWiresConfig
from plnerf.survey.surface import Surface

NONE = -1
"""Index of the wire of points on no wire."""


def on_wires(
    surface: Surface, wires: Sequence[Wire], config: OnWiresConfig
) -> tuple[Int[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """The index of the wire that each point lies on, `NONE` elsewhere; and which other points may lie on one.

    Those have a line of sight that passes a wire as near, within `reach_sigmas` of the point.
    """
    wire, doubtful = np.full(len(surface.xyz), NONE), np.zeros(len(surface.xyz), np.bool_)
    if not wires or not len(surface.xyz):
        return wire, doubtful
    lines = [one.polyline() for one in wires]
    owner = np.repeat(np.arange(len(lines)), [len(line) for line in lines])
    tree, near = cKDTree(np.concatenate(lines)), config.near_m
    reach: Float[np.ndarray, " n"] = np.minimum(config.reach_sigmas * surface.sigma_m, config.max_reach_m)
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


def may_be_on(surface: Surface, wires: Sequence[Wire], config: OnWiresConfig) -> Bool[np.ndarray, " n"]:
    """The points that lie on one of some wires, or may."""
    nearest, doubtful = on_wires(surface, wires, config)
    return (nearest != NONE) | doubtful
