"""Pieces of wires beyond a structure that make no span: as far as the cloud goes on, they are conductors.

As points without a class they would be things beside every wire that ends at the structure.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from plnerf.line.wire import Wire
from plnerf.survey.lidar.config import LidarConfig
from plnerf.survey.lidar.linear import Linear, pieces
from plnerf.survey.lidar.structures import Outline

LEAST_M = 2.0
"""Least length of a piece: it must also lead to where a structure's wires begin."""
STEP_M = 0.2
"""Spacing of places on the lines through pieces."""


def loose_wires(
    points: Float[np.ndarray, "n 3"], linear: Linear, outlines: Sequence[Outline], wires: Sequence[Wire],
    config: LidarConfig,
) -> Int[np.ndarray, " m"]:  # fmt: skip
    """Indices of the points on straight pieces that lead to a structure, as high as its wires begin, and are
    not beside one of the wires that were found; and of those in line with such a piece, from the structure
    on, which are too few to make pieces of their own."""
    if not wires or not len(points):
        return np.zeros(0, np.int64)
    found = cKDTree(np.concatenate([wire.polyline(0.5) for wire in wires]))
    loose = [np.zeros((0, 3))]
    for piece in pieces(linear, config.linear):
        at = linear.at[piece]
        at = at[found.query(at)[0] > config.explained_m]
        if len(at) > 1 and np.linalg.norm(np.ptp(at, axis=0)) >= LEAST_M:
            line = _extended(at, config.track.max_gap_m)
            loose += [np.concatenate([at, line[_beyond(line, at, one)]]) for one in outlines
                      if _begins(line, one, config)]  # fmt: skip
    near = cKDTree(np.concatenate(loose)).query(points, distance_upper_bound=config.things.beside_m)[0]
    return np.flatnonzero(np.isfinite(near))


def _extended(at: Float[np.ndarray, "k 3"], by_m: float) -> Float[np.ndarray, "j 3"]:
    """Places on the straight line through a piece's, from so far before its first to as far behind its last:
    over so few metres a wire bends by centimetres."""
    middle = at.mean(0)
    along = np.linalg.svd(at - middle, full_matrices=False)[2][0]
    s = (at - middle) @ along
    places: Float[np.ndarray, "j 3"] = (
        middle + np.arange(s.min() - by_m, s.max() + by_m, STEP_M)[:, None] * along
    )
    return places


def _begins(line: Float[np.ndarray, "k 3"], outline: Outline, config: LidarConfig) -> bool:
    """Whether one of the places is where a wire of the structure would begin."""
    along, across = np.abs(outline.flat(line)).T
    near = (along <= config.wire.end_m) & (across <= outline.half_width_m + config.structure.beside_m)
    return bool((near & (line[:, 2] >= outline.lowest_wire_m - config.structure.top_m)).any())


def _beyond(
    line: Float[np.ndarray, "k 3"], at: Float[np.ndarray, "j 3"], outline: Outline
) -> Bool[np.ndarray, " k"]:
    """Which places are on the same side of the structure as the piece."""
    side = np.sign(np.median(outline.flat(at)[:, 0]))
    same: Bool[np.ndarray, " k"] = outline.flat(line)[:, 0] * side >= 0
    return same
