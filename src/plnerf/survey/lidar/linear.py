"""Points of a cloud that lie on lines which run level or climb gently: the candidates for wires.

Letters: n points, m cells that stand for their points, l of them alone, k neighbours; metres, z up.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

THIN_M = 0.2
"""Side of the cells: more points in one tell no more about a line of metres."""
FAR_M = 8.0
"""Neighbours farther away are none."""
MOST, FEWEST = 48, 6
RADII_M = (1.0, 2.5)
"""Neighbourhoods within which points may make a line, besides the `NEAREST`: single wires side by side need
the short one, bundles the long one, and wires with a point every other metre the nearest."""
NEAREST = 8
STRAIGHT = 0.25
"""Largest spread across a line, as a share of that along it: leaves have 1/3 and more, twin conductors 0.45 m
apart 0.15."""
TRIED = slice(12, MOST, 3)
"""Neighbours towards which lines are tried, by their order in distance."""
THICK_M, THICK_SHARE, FULL, FULL_SHARE = 0.12, 0.1, 8, 0.3
"""Half the thickness of such a line, at most and as a share of the neighbourhood's radius, and how many
neighbours, and which share of them, it must hold: of a surface's a fifth are on a line by chance."""
LEAST_ALONG_M = 0.4
"""Least standard deviation along it."""
STEEPEST = 0.7
"""Slope of a wire: that of a span up a mountain."""
CHUNK = 20_000
ALIKE = np.cos(np.radians(15.0))
"""Cosine of the angle between neighbours of one line."""
JOIN_M, BESIDE_M = 5.0, 0.6
"""How far apart, and how far beside each other's direction, neighbours of one line may lie."""


@dataclass(frozen=True, eq=False)
class Lines:
    """Places on lines."""

    at: Float[np.ndarray, "m 3"]
    along: Float[np.ndarray, "m 3"]
    """Unit vectors."""
    loose: Float[np.ndarray, "l 3"]
    """Places with hardly a neighbour: they make no line, but may go on with one."""


def thinned(points: Float[np.ndarray, "n 3"], cell_m: float = THIN_M) -> Float[np.ndarray, "m 3"]:
    """The mean of the points in each cell of a cubic grid, so that density does not count."""
    cell = np.floor((points - points.min(0)) / cell_m).astype(np.int64)
    size = cell.max(0) + 1
    key = (cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2]
    _, which, count = np.unique(key, return_inverse=True, return_counts=True)
    sums = [np.bincount(which, points[:, k], len(count)) for k in range(3)]
    return np.stack(sums, 1) / count[:, None]


def lines(points: Float[np.ndarray, "n 3"]) -> Lines:
    """Where points make lines of at most `STEEPEST`, by the principal axes of several neighbourhoods."""
    at = thinned(points)
    tree = cKDTree(at)
    along, straight = np.zeros_like(at), np.full(len(at), np.inf)
    loose = np.zeros(len(at), np.bool_)
    for first in range(0, len(at), CHUNK):
        part = slice(first, first + CHUNK)
        apart, which = tree.query(at[part], MOST, distance_upper_bound=FAR_M, workers=-1)
        loose[part] = (apart <= RADII_M[-1]).sum(1) < FEWEST
        offset = at[np.minimum(which, len(at) - 1)] - at[part, None]
        nearest = np.broadcast_to(np.arange(MOST) < NEAREST, apart.shape)
        for near in (nearest & np.isfinite(apart), *(apart <= radius for radius in RADII_M)):
            axis, ratio = _axes(offset, near)
            better = ratio < straight[part]
            along[part][better], straight[part][better] = axis[better], ratio[better]
        crowded = np.flatnonzero(straight[part] > STRAIGHT)
        near = _on_one_line(offset[crowded], apart[crowded])
        along[part][crowded], straight[part][crowded] = _axes(offset[crowded], near)
    level = np.abs(along[:, 2]) <= STEEPEST * np.linalg.norm(along[:, :2], axis=1)
    keep = (straight <= STRAIGHT) & level
    return Lines(at[keep], along[keep], at[loose & ~keep])


def _on_one_line(
    offset: Float[np.ndarray, "m k 3"], apart: Float[np.ndarray, "m k"]
) -> Bool[np.ndarray, "m k"]:
    """The neighbours on the fullest of some lines through a place; none where it stands out too little.

    Of wires side by side, or beside a tree, no neighbourhood is long and thin, but such lines are full.
    """
    around = apart <= RADII_M[-1]
    towards = offset[:, TRIED] / np.maximum(apart[:, TRIED], 1e-9)[..., None]
    towards = np.where((around & np.isfinite(apart))[:, TRIED, None], towards, 0.0)
    along = np.einsum("mki,mji->mjk", offset, towards)
    squared = np.einsum("mki,mki->mk", offset, offset)[:, None]
    reach = np.max(apart, axis=1, initial=0.0, where=around)
    thick = np.minimum(THICK_M, THICK_SHARE * reach)[:, None, None]
    on = (squared - along**2 <= thick**2) & around[:, None]
    best = np.take_along_axis(on, on.sum(2).argmax(1)[:, None, None], axis=1)[:, 0]
    full = best.sum(1) >= np.maximum(FULL, FULL_SHARE * around.sum(1))
    return best & full[:, None]


def _axes(
    offset: Float[np.ndarray, "m k 3"], near: Bool[np.ndarray, "m k"]
) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, " m"]]:
    """Main axis of each neighbourhood, and its spread across as a share of that along it."""
    count = near.sum(1)
    weight = near / np.maximum(count, 1)[:, None]
    middle = np.einsum("mk,mki->mi", weight, offset)
    spread = np.einsum("mk,mki,mkj->mij", weight, offset, offset) - middle[:, :, None] * middle[:, None, :]
    values, vectors = np.linalg.eigh(spread)
    enough = (count >= FEWEST) & (values[:, 2] >= LEAST_ALONG_M**2)
    ratio = np.sqrt(np.maximum(values[:, 1], 0) / np.where(enough, values[:, 2], 1.0))
    return vectors[:, :, 2], np.where(enough, ratio, np.inf)


def pieces(found: Lines) -> list[np.ndarray]:
    """Indices of the places of each connected piece of a line, the piece with the most places first."""
    if not len(found.at):
        return []
    apart, other = cKDTree(found.at).query(found.at, 1 + NEAREST, distance_upper_bound=JOIN_M, workers=-1)
    one = np.repeat(np.arange(len(found.at)), 1 + NEAREST)
    other = other.ravel()
    linked = np.isfinite(apart.ravel()) & (one != other)
    one, other = one[linked], other[linked]
    offset = found.at[other] - found.at[one]
    along = np.einsum("mi,mi->m", offset, found.along[one])
    beside = np.linalg.norm(offset - along[:, None] * found.along[one], axis=1)
    alike = np.abs(np.einsum("mi,mi->m", found.along[one], found.along[other]))
    good = (alike >= ALIKE) & (beside <= BESIDE_M)
    graph = coo_array((np.ones(good.sum()), (one[good], other[good])), shape=(len(found.at),) * 2)
    count, piece = connected_components(graph, directed=False)
    order = np.argsort(piece, kind="stable")
    groups = np.split(order, np.cumsum(np.bincount(piece, minlength=count))[:-1])
    return sorted(groups, key=len, reverse=True)
