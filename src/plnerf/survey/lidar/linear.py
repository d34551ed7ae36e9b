"""Points of a cloud that lie on lines which run level or climb gently: the candidates for wires.

Letters: n points, m cells that stand for their points, l of them alone, k neighbours; metres, z up.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from plnerf.survey.lidar.config import LinearConfig

CHUNK = 20_000
"""Cells whose neighbours are held in memory at once."""


@dataclass(frozen=True, eq=False)
class Linear:
    """Places on lines."""

    at: Float[np.ndarray, "m 3"]
    along: Float[np.ndarray, "m 3"]
    """Unit vectors."""
    loose: Float[np.ndarray, "l 3"]
    """Places with hardly a neighbour: they make no line, but a line may continue through them."""


def thinned(points: Float[np.ndarray, "n 3"], cell_m: float) -> Float[np.ndarray, "m 3"]:
    """The mean of the points in each cell of a cubic grid, so that density has no influence.

    The grid is that of the frame, so that a part of a cloud has the cells of the whole.
    """
    cell = np.floor(points / cell_m).astype(np.int64)
    cell -= cell.min(0)
    size = cell.max(0) + 1
    key = (cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2]
    _, which, count = np.unique(key, return_inverse=True, return_counts=True)
    sums = [np.bincount(which, points[:, k], len(count)) for k in range(3)]
    return np.stack(sums, 1) / count[:, None]


def find_linear(points: Float[np.ndarray, "n 3"], config: LinearConfig) -> Linear:
    """Where points lie on lines that are not too steep, by the principal axes of several neighbourhoods.

    No points, as of a cloud that shows nothing above the ground, have no places.
    """
    if not len(points):
        return Linear(points, points, points)
    at = thinned(points, config.cell_m)
    tree = cKDTree(at)
    along, straight = np.zeros_like(at), np.full(len(at), np.inf)
    loose = np.zeros(len(at), np.bool_)
    for first in range(0, len(at), CHUNK):
        part = slice(first, first + CHUNK)
        apart, which = tree.query(
            at[part], config.max_neighbours, distance_upper_bound=config.max_distance_m, workers=-1
        )
        loose[part] = (apart <= config.radii_m[-1]).sum(1) < config.min_neighbours
        offset = at[np.minimum(which, len(at) - 1)] - at[part, None]
        nearest = np.broadcast_to(np.arange(config.max_neighbours) < config.nearest, apart.shape)
        for near in (nearest & np.isfinite(apart), *(apart <= radius for radius in config.radii_m)):
            axis, ratio = _axes(offset, near, config)
            better = ratio < straight[part]
            along[part][better], straight[part][better] = axis[better], ratio[better]
        crowded = np.flatnonzero(straight[part] > config.max_spread_ratio)
        near = _on_one_line(offset[crowded], apart[crowded], config)
        along[part][crowded], straight[part][crowded] = _axes(offset[crowded], near, config)
    level = np.abs(along[:, 2]) <= config.max_slope * np.linalg.norm(along[:, :2], axis=1)
    keep = (straight <= config.max_spread_ratio) & level
    return Linear(at[keep], along[keep], at[loose & ~keep])


def _on_one_line(
    offset: Float[np.ndarray, "m k 3"], apart: Float[np.ndarray, "m k"], config: LinearConfig
) -> Bool[np.ndarray, "m k"]:
    """The neighbours on the fullest of several lines through a place; none where it stands out too little.

    No neighbourhood of wires side by side, or beside a tree, is long and thin, but such lines are full.
    """
    around = apart <= config.radii_m[-1]
    tried = slice(config.tried_from, config.max_neighbours, config.tried_every)
    towards = offset[:, tried] / np.maximum(apart[:, tried], 1e-9)[..., None]
    towards = np.where((around & np.isfinite(apart))[:, tried, None], towards, 0.0)
    along = np.einsum("mki,mji->mjk", offset, towards)
    squared = np.einsum("mki,mki->mk", offset, offset)[:, None]
    reach = np.max(apart, axis=1, initial=0.0, where=around)
    thick = np.minimum(config.max_half_thickness_m, config.max_half_thickness_share * reach)[:, None, None]
    on = (squared - along**2 <= thick**2) & around[:, None]
    best = np.take_along_axis(on, on.sum(2).argmax(1)[:, None, None], axis=1)[:, 0]
    full = best.sum(1) >= np.maximum(config.min_on_line, config.min_on_line_share * around.sum(1))
    return best & full[:, None]


def _axes(
    offset: Float[np.ndarray, "m k 3"], near: Bool[np.ndarray, "m k"], config: LinearConfig
) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, " m"]]:
    """Main axis of each neighbourhood, and its spread across as a share of that along it."""
    count = near.sum(1)
    weight = near / np.maximum(count, 1)[:, None]
    middle = np.einsum("mk,mki->mi", weight, offset)
    spread = np.einsum("mk,mki,mkj->mij", weight, offset, offset) - middle[:, :, None] * middle[:, None, :]
    values, vectors = np.linalg.eigh(spread)
    enough = (count >= config.min_neighbours) & (values[:, 2] >= config.min_sigma_along_m**2)
    ratio = np.sqrt(np.maximum(values[:, 1], 0) / np.where(enough, values[:, 2], 1.0))
    return vectors[:, :, 2], np.where(enough, ratio, np.inf)


def pieces(found: Linear, config: LinearConfig) -> list[np.ndarray]:
    """Indices of the places of each connected piece of a line, the piece with the most places first."""
    if not len(found.at):
        return []
    k = 1 + config.nearest
    apart, other = cKDTree(found.at).query(found.at, k, distance_upper_bound=config.max_gap_m, workers=-1)
    one = np.repeat(np.arange(len(found.at)), k)
    other = other.ravel()
    linked = np.isfinite(apart.ravel()) & (one != other)
    one, other = one[linked], other[linked]
    offset = found.at[other] - found.at[one]
    along = np.einsum("mi,mi->m", offset, found.along[one])
    beside = np.linalg.norm(offset - along[:, None] * found.along[one], axis=1)
    alike = np.abs(np.einsum("mi,mi->m", found.along[one], found.along[other]))
    good = (alike >= np.cos(np.radians(config.max_angle_deg))) & (beside <= config.max_beside_m)
    graph = coo_array((np.ones(good.sum()), (one[good], other[good])), shape=(len(found.at),) * 2)
    count, piece = connected_components(graph, directed=False)
    order = np.argsort(piece, kind="stable")
    groups = np.split(order, np.cumsum(np.bincount(piece, minlength=count))[:-1])
    return sorted(groups, key=len, reverse=True)
