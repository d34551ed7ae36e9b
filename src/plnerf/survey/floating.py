"""What is thin and in the air, with nothing seen below it: of plants in clouds from images.

A wire that was not found leaves points along it, and blurred ground without texture a handful on which many
images agree.  Both lie along a straight line, or in one place.  A crown is seen over a metre or more in all
directions, and mostly down to the ground; of a conifer only the tip may be, a line that stands upright, and
of a sparse one some branches, bits beside the rest of it.

Letters: n points of the cloud, m those that are asked about, c clumps, which hang together.
"""

import math

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from plnerf.line.cloud import GROUND, Cloud
from plnerf.survey.config_obstacles import FloatingConfig


def floats(cloud: Cloud, index: Int[np.ndarray, " m"], config: FloatingConfig) -> Bool[np.ndarray, " m"]:
    """Which of the indexed points are in clumps of them, without others, that are thin and in the air."""
    ground = cloud.xyz[cloud.label == GROUND]
    if not len(index) or not len(ground):
        return np.zeros(len(index), np.bool_)
    points = cloud.xyz[index]
    clump = _clumps(points, config)
    _, below = cKDTree(ground[:, :2]).query(points[:, :2], workers=-1)
    height = np.full(clump.max() + 1, np.inf)
    np.minimum.at(height, clump, points[:, 2] - ground[below, 2])
    off, axis = _along_axes(points, clump)
    along = (off * axis[clump]).sum(1)
    across = np.linalg.norm(off - along[:, None] * axis[clump], axis=1)
    wide, half = _reached(across, clump, config.share), _reached(np.abs(along), clump, config.share)
    thin: Bool[np.ndarray, " c"] = (height > config.above_ground_m) & (wide < config.thin_m)
    small = half < config.thin_m
    upright = ~small & (np.abs(axis[:, 2]) > math.sin(math.radians(config.upright_deg)))
    thin &= ~upright
    thin[_beside(points, clump, thin & small, ~thin, config.bit_m)] = False
    return thin[clump]


def _beside(
    points: Float[np.ndarray, "m 3"],
    clump: Int[np.ndarray, " m"],
    bits: Bool[np.ndarray, " c"],
    plants: Bool[np.ndarray, " c"],
    near_m: float,
) -> Int[np.ndarray, " b"]:
    """Which of the bits are near to a plant: their numbers, one for each point that is."""
    some, of_plants = points[bits[clump]], points[plants[clump]]
    if not len(some) or not len(of_plants):
        return clump[:0]
    near = cKDTree(of_plants).query(some, distance_upper_bound=near_m)[0] < near_m
    return clump[bits[clump]][near]


def _clumps(points: Float[np.ndarray, "m 3"], config: FloatingConfig) -> Int[np.ndarray, " m"]:
    """Of each point the number of its clump, from 0."""
    cells = np.floor(points / config.cell_m).astype(np.int64)
    _, cell = np.unique(cells, axis=0, return_inverse=True)
    middles = _means(points, cell.reshape(-1))
    pairs = cKDTree(middles).query_pairs(config.gap_m, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(middles), len(middles)))
    clump: Int[np.ndarray, " m"] = connected_components(graph, directed=False)[1][cell.reshape(-1)]
    return clump


def _along_axes(
    points: Float[np.ndarray, "m 3"], clump: Int[np.ndarray, " m"]
) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, "c 3"]]:
    """Each point from its clump's middle, and of each clump the direction of the straight line that fits it
    best."""
    off = points - _means(points, clump)[clump]
    spread = _means((off[:, :, None] * off[:, None]).reshape(-1, 9), clump).reshape(-1, 3, 3)
    return off, np.linalg.eigh(spread)[1][:, :, -1]


def _reached(
    values: Float[np.ndarray, " m"], of: Int[np.ndarray, " m"], share: float
) -> Float[np.ndarray, " g"]:
    """The value in each group up to which the share of its values lies; the largest of a few."""
    order, count = np.lexsort((values, of)), np.bincount(of)
    last = np.cumsum(count) - count + np.ceil(share * (count - 1)).astype(np.int64)
    reached: Float[np.ndarray, " g"] = values[order][last]
    return reached


def _means(values: Float[np.ndarray, "m k"], of: Int[np.ndarray, " m"]) -> Float[np.ndarray, "g k"]:
    """Of each group."""
    return np.stack([np.bincount(of, x) for x in values.T], 1) / np.bincount(of)[:, None]
