"""Cuts a corridor into blocks by how far along it places lie, whatever its bends and branches.

Places (cameras, or squares of a cloud) that are near to each other are linked; the way from an end of the
corridor to a place along these links is its station.  Blocks are the connected parts between even stations:
where the line branches, each branch has its own.  (This is how Mapper simplifies shapes: Singh, Memoli,
Carlsson, 2007.)

Letters: n places, plan coordinates in metres.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from plnerf.corridor.config import CutConfig
from plnerf.errors import SceneError

THINNED = 16
"""Places are gathered in squares of so much of a block, so that many images in one place cost nothing."""
LINKED = 3.0
"""Squares that are no more of their sides apart are neighbours in any case."""
MOST_BLOCKS = 100_000


@dataclass(frozen=True, eq=False)
class Block:
    """A part of a corridor, by the indices of places."""

    core: Int[np.ndarray, " c"]
    """Places that belong to this block alone."""
    every: Int[np.ndarray, " e"]
    """The core, and what lies near to it along the corridor."""


def cut(places: Float[np.ndarray, "n 2"], config: CutConfig) -> tuple[Block, ...]:
    """Blocks in the order of their stations.  Raises SceneError for more than any corridor has."""
    side = config.block_m / THINNED
    _, of = np.unique(np.floor(places / side).astype(np.int64), axis=0, return_inverse=True)
    of = of.ravel()
    middles = np.stack([np.bincount(of, places[:, k]) for k in (0, 1)], 1) / np.bincount(of)[:, None]
    links = _links(middles, max(config.link_m, LINKED * side))
    blocks = []
    _, flight = connected_components(links, directed=False)
    for k in range(flight.max() + 1):
        mine = np.flatnonzero(flight == k)
        station = _stations(links[mine][:, mine])
        if station.max() > MOST_BLOCKS * config.block_m:
            raise SceneError(
                f"The corridor is {station.max() / 1000:,.0f} km long, which makes more than {MOST_BLOCKS:,} "
                f"blocks of {config.block_m:g} m. Are its coordinates metres?"
            )
        for core in _between(station, links[mine][:, mine], config.block_m):
            near = _reached(links, mine[core], config.overlap_m)
            blocks.append(Block(np.flatnonzero(np.isin(of, mine[core])), np.flatnonzero(near[of])))
    return tuple(blocks)


def _links(middles: Float[np.ndarray, "n 2"], reach: float) -> csr_array:
    """Distances between neighbours."""
    pairs = cKDTree(middles).query_pairs(reach, output_type="ndarray")
    apart = np.linalg.norm(middles[pairs[:, 0]] - middles[pairs[:, 1]], axis=1)
    size = (len(middles), len(middles))
    return csr_array(coo_array((apart, (pairs[:, 0], pairs[:, 1])), shape=size))


def _stations(links: csr_array) -> Float[np.ndarray, " n"]:
    """The way of each place from one end: from the place that is farthest from the one farthest from any."""
    first = int(dijkstra(links, directed=False, indices=0).argmax())
    from_end: Float[np.ndarray, " n"] = dijkstra(links, directed=False, indices=first)
    return from_end


def _between(
    station: Float[np.ndarray, " n"], links: csr_array, block_m: float
) -> Sequence[Int[np.ndarray, " _"]]:
    """The connected parts of even stretches, in their order."""
    count = max(1, round(float(station.max()) / block_m))
    stretch = np.minimum((station / max(float(station.max()), 1e-9) * count).astype(np.int64), count - 1)
    parts = []
    for k in range(count):
        inside = np.flatnonzero(stretch == k)
        if not len(inside):
            continue
        number, group = connected_components(links[inside][:, inside], directed=False)
        parts += [inside[group == one] for one in range(number)]
    return parts


def _reached(links: csr_array, core: Int[np.ndarray, " c"], overlap_m: float) -> Bool[np.ndarray, " n"]:
    """Which places lie no farther from a block than its overlap, along the links."""
    away = dijkstra(links, directed=False, indices=core, limit=overlap_m, min_only=True)
    near: Bool[np.ndarray, " n"] = np.isfinite(away)
    return near
