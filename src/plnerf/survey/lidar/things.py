"""What stands on the ground and is no plant: buildings by their roofs, and what is straight over metres.

A roof is a smooth plane several metres wide, high above the ground; what is under it belongs to the building.
Nothing that grows is straight and level over metres, as booms, rails and undiscovered cables are: such things
are unclassified.  In doubt a point stays a plant, since what is none has no vegetation verdict.

Letters: k points that may be plants; m cells that stand for them; metres, z up.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from plnerf.line.cloud import BUILDING, UNCLASSIFIED
from plnerf.survey.lidar.config import LinearConfig
from plnerf.survey.lidar.config_things import ThingsConfig
from plnerf.survey.lidar.linear import CHUNK, Linear, thinned
from plnerf.survey.lidar.straight_things import of_straight, on_axes, straight_pieces

SQUARE = np.ones((3, 3), np.bool_)
AROUND = 18
"""Cells that a cell has around it, itself included, of two roofs that meet in it."""


def no_plants(
    points: Float[np.ndarray, "k 3"], above_m: Float[np.ndarray, " k"], linear: Linear,
    config: ThingsConfig, lines: LinearConfig,
) -> UInt8[np.ndarray, " k"]:  # fmt: skip
    """Classes of points that are no plants, 0 of the others.

    above_m: heights above the ground; linear: places on lines of the whole cloud.
    """
    label = np.zeros(len(points), np.uint8)
    long = straight_pieces(linear, config, lines)
    roofed = under_roofs(points, above_m, config)
    label[of_straight(points, long, config)] = UNCLASSIFIED
    label[roofed] = BUILDING
    label[on_axes(points, long, roofed, config)] = UNCLASSIFIED
    return label


def under_roofs(
    points: Float[np.ndarray, "k 3"], above_m: Float[np.ndarray, " k"], config: ThingsConfig,
    exact: Bool[np.ndarray, " k"] | None = None,
) -> Bool[np.ndarray, " k"]:  # fmt: skip
    """Which points belong to roofs, or lie under them and beside their walls.

    exact: those that may show a roof; None: all.
    """
    inside = np.zeros(len(points), np.bool_)
    aloft = above_m >= config.roof_from_m
    high = points[aloft if exact is None else aloft & exact]
    if len(high) < config.min_neighbours:
        return inside
    at = thinned(high, config.cell_m)
    flat, normal = _flat(at, config)
    planes = _planes(at[flat], normal[flat], config)
    roofs = [_covered(part, config) for part in _with_edges(at, flat, normal, planes, config)]
    cells = np.concatenate([*(cell for cell, _ in roofs), np.zeros((0, 2), np.int64)])
    if not len(cells):
        return inside
    top = np.concatenate([height for _, height in roofs])
    near = np.floor(points[:, :2]).astype(np.int64)
    # A point's height is compared with that of the roofs in its cell and those around: the walls stand beside
    # a roof, and a steep one rises by a metre within a cell.
    _, index = cKDTree(cells).query(near, AROUND, distance_upper_bound=1.5)
    highest = np.append(top, -np.inf)[index].max(1)
    inside[:] = points[:, 2] <= highest + config.over_roof_m
    return inside


def _planes(
    at: Float[np.ndarray, "m 3"], normal: Float[np.ndarray, "m 3"], config: ThingsConfig
) -> list[Int[np.ndarray, " _"]]:
    """Indices of the places of each smooth plane."""
    if not len(at):
        return []
    pairs = cKDTree(at).query_pairs(config.radius_m, output_type="ndarray")
    one, other = pairs.T
    alike = np.abs(np.einsum("ij,ij->i", normal[one], normal[other]))
    off = np.abs(np.einsum("ij,ij->i", at[other] - at[one], normal[one]))
    linked = (alike >= np.cos(np.radians(config.max_bend_deg))) & (off <= 2 * config.max_rms_m)
    graph = coo_array((np.ones(linked.sum()), pairs[linked].T), shape=(len(at), len(at)))
    plane = connected_components(graph, directed=False)[1]
    order = np.argsort(plane, kind="stable")
    return [part for part in np.split(order, np.cumsum(np.bincount(plane))[:-1]) if len(part)]


def _with_edges(
    at: Float[np.ndarray, "m 3"], flat: Bool[np.ndarray, " m"], normal: Float[np.ndarray, "m 3"],
    planes: Sequence[Int[np.ndarray, " _"]], config: ThingsConfig,
) -> list[Float[np.ndarray, "_ 3"]]:  # fmt: skip
    """The places of each flat plane, with those around that lie on the plane of the nearest of them.

    Around ridge and eaves, half a metre and more wide, no neighbourhood is flat; how much of that lies in a
    square metre depends on where the squares begin.
    """
    if not planes:
        return []
    firm, rest = at[flat], at[~flat]
    plane = np.empty(len(firm), np.int64)
    for k, part in enumerate(planes):
        plane[part] = k
    apart, which = cKDTree(firm).query(rest, distance_upper_bound=config.radius_m)
    which = np.minimum(which, len(firm) - 1)
    off = np.abs(np.einsum("ij,ij->i", rest - firm[which], normal[flat][which]))
    on = np.isfinite(apart) & (off <= 2 * config.max_rms_m)
    places, plane = np.concatenate([firm, rest[on]]), np.concatenate([plane, plane[which[on]]])
    order = np.argsort(plane, kind="stable")
    return np.split(places[order], np.cumsum(np.bincount(plane))[:-1])


def _covered(
    at: Float[np.ndarray, "m 3"], config: ThingsConfig
) -> tuple[Int[np.ndarray, "c 2"], Float[np.ndarray, " c"]]:
    """Square metres that a plane covers, as cells, and its height there; none where it is no roof."""
    none = np.zeros((0, 2), np.int64), np.zeros(0)
    if len(at) < config.min_roof_m2 / 2:
        return none
    cell = np.floor(at[:, :2]).astype(np.int64)
    corner = cell.min(0) - 2
    shape = tuple(cell.max(0) - corner + 3)
    seen = np.zeros(shape, np.bool_)
    seen[tuple((cell - corner).T)] = True
    # Closed over cells without a point, and nowhere narrower than three metres.
    wide = ndimage.binary_opening(ndimage.binary_closing(seen, SQUARE), SQUARE)
    if wide.sum() < config.min_roof_m2:
        return none
    found = np.argwhere(wide) + corner
    nearest = cKDTree(at[:, :2]).query(found + 0.5, min(4, len(at)))[1].reshape(len(found), -1)
    return found, at[nearest, 2].max(1)


def _flat(
    at: Float[np.ndarray, "m 3"], config: ThingsConfig
) -> tuple[Bool[np.ndarray, " m"], Float[np.ndarray, "m 3"]]:
    """Which places lie on smooth planes that are no walls, and the planes' normals."""
    tree, flat, normal = cKDTree(at), np.zeros(len(at), np.bool_), np.zeros_like(at)
    for first in range(0, len(at), CHUNK):
        part = slice(first, first + CHUNK)
        apart, which = tree.query(
            at[part], config.neighbours, distance_upper_bound=config.radius_m, workers=-1
        )
        near = np.isfinite(apart)
        count = near.sum(1)
        offset = np.where(near[..., None], at[np.minimum(which, len(at) - 1)] - at[part, None], 0.0)
        middle = offset.sum(1) / count[:, None]
        spread = np.einsum("mki,mkj->mij", offset, offset) / count[:, None, None]
        spread -= middle[:, :, None] * middle[:, None, :]
        values, vectors = np.linalg.eigh(spread)
        smooth = np.sqrt(np.maximum(values[:, 0], 0.0)) <= config.max_rms_m
        wide = np.sqrt(np.maximum(values[:, 1], 0.0)) >= config.min_spread_m
        roof = np.abs(vectors[:, 2, 0]) >= np.cos(np.radians(config.max_slope_deg))
        flat[part] = smooth & wide & roof & (count >= config.min_neighbours)
        normal[part] = vectors[:, :, 0]
    return flat, normal
