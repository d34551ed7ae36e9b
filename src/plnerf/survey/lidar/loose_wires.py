"""Pieces of wires beyond a structure that make no span: as far as the cloud goes on, they are conductors.

As points without a class they would be things beside every wire that ends at the structure.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from plnerf.line.wire import Wire
from plnerf.survey.lidar.config import LidarConfig
from plnerf.survey.lidar.linear import Linear, pieces
from plnerf.survey.lidar.structures import Outline


def loose_wires(
    points: Float[np.ndarray, "n 3"], linear: Linear, outlines: Sequence[Outline], wires: Sequence[Wire],
    config: LidarConfig,
) -> Int[np.ndarray, " m"]:  # fmt: skip
    """Indices of the points on straight pieces that begin at a structure, as high as its wires do, and are
    not beside one of the wires that were found."""
    begun = [
        linear.at[piece]
        for piece in pieces(linear, config.linear)
        if np.linalg.norm(np.ptp(linear.at[piece], axis=0)) >= config.things.straight_m
        and any(_begins(linear.at[piece], outline, config) for outline in outlines)
    ]
    if not begun or not wires or not len(points):
        return np.zeros(0, np.int64)
    at = np.concatenate(begun)
    at = at[cKDTree(np.concatenate([wire.polyline(0.5) for wire in wires])).query(at)[0] > config.explained_m]
    if not len(at):
        return np.zeros(0, np.int64)
    tree, reach_m = cKDTree(at), config.things.beside_m
    return np.flatnonzero(np.isfinite(tree.query(points, distance_upper_bound=reach_m)[0]))


def _begins(at: Float[np.ndarray, "k 3"], outline: Outline, config: LidarConfig) -> bool:
    """Whether one of a piece's places is where a wire of the structure would begin."""
    along, across = np.abs(outline.flat(at)).T
    near = (along <= config.wire.end_m) & (across <= outline.half_width_m + config.structure.beside_m)
    return bool((near & (at[:, 2] >= outline.lowest_wire_m - config.structure.top_m)).any())
