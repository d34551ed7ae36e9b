"""What is straight and rather level over metres, and is no wire: booms, rails, cables not followed.

Such a thing goes on where plants or a roof beside it hide that it is straight: along its axis, from point to
point.

Letters: k points that may be plants; m places of a straight piece; metres, z up.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from plnerf.survey.lidar.config import LinearConfig
from plnerf.survey.lidar.config_things import ThingsConfig
from plnerf.survey.lidar.linear import Linear, pieces


def straight_pieces(
    linear: Linear, config: ThingsConfig, lines: LinearConfig
) -> tuple[Float[np.ndarray, "_ 3"], ...]:
    """Places of each straight piece of `straight_m` or more; linear: those of the whole cloud."""
    every = (linear.at[piece] for piece in pieces(linear, lines))
    return tuple(at for at in every if _length(at) >= config.straight_m)


def of_straight(
    points: Float[np.ndarray, "k 3"], long: Sequence[Float[np.ndarray, "_ 3"]], config: ThingsConfig
) -> Bool[np.ndarray, " k"]:
    """Which points lie on straight pieces, or next to them in something of which these are a good part."""
    found = np.zeros(len(points), np.bool_)
    if not long or not len(points):
        return found
    at = np.concatenate(long)
    apart = cKDTree(at).query(points, distance_upper_bound=config.beside_m)[0]
    on: Bool[np.ndarray, " k"] = np.isfinite(apart)
    near = np.flatnonzero(cKDTree(at).query(points, distance_upper_bound=config.around_m)[0] < np.inf)
    group = _groups(points[near], config.touching_m)
    share = np.bincount(group, on[near]) / np.bincount(group)
    found[near] = share[group] >= config.min_straight_share
    return found | on


def on_axes(
    points: Float[np.ndarray, "k 3"], long: Sequence[Float[np.ndarray, "_ 3"]],
    under_roof: Bool[np.ndarray, " k"], config: ThingsConfig,
) -> Bool[np.ndarray, " k"]:  # fmt: skip
    """Which points lie on the axes of straight pieces or where these go on.

    Pieces of which less than `straight_m` is free of roofs are edges of these, and are left out.
    """
    found = np.zeros(len(points), np.bool_)
    if not long or not len(points):
        return found
    tree = cKDTree(points)
    for at in long:
        free = at[~under_roof[tree.query(at)[1]]]
        if len(free) > 1 and _length(free) >= config.straight_m:
            reach = (1 + config.axis_lengths) * _length(free)
            near = np.array(tree.query_ball_point(free.mean(0), reach), np.int64)
            found[near[_on_axis(points[near], free, config)]] = True
    return found


def _on_axis(
    points: Float[np.ndarray, "k 3"], at: Float[np.ndarray, "m 3"], config: ThingsConfig
) -> Int[np.ndarray, " _"]:
    """Indices of the points on a piece's axis, without a gap from the piece on."""
    middle = at.mean(0)
    u = np.linalg.svd(at - middle, full_matrices=False)[2][0]
    t = (points - middle) @ u
    apart = np.linalg.norm(points - middle - t[:, None] * u, axis=1)
    along = (at - middle) @ u
    on = apart <= config.axis_m
    kept = [np.flatnonzero(on & (t >= along.min()) & (t <= along.max()))]
    for beyond in (along.min() - t, t - along.max()):
        ahead = np.flatnonzero(on & (beyond > 0) & (beyond <= config.axis_lengths * np.ptp(along)))
        ahead = ahead[np.argsort(beyond[ahead], kind="stable")]
        gaps = np.diff(beyond[ahead], prepend=0.0) > config.touching_m
        kept.append(ahead[: np.argmax(gaps)] if gaps.any() else ahead)
    return np.concatenate(kept)


def _length(at: Float[np.ndarray, "m 3"]) -> float:
    return float(np.linalg.norm(np.ptp(at, axis=0)))


def _groups(points: Float[np.ndarray, "k 3"], reach_m: float) -> Int[np.ndarray, " k"]:
    """Numbers of the groups of points that touch each other."""
    pairs = cKDTree(points).query_pairs(reach_m, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(points), len(points)))
    number: Int[np.ndarray, " k"] = connected_components(graph, directed=False)[1].astype(np.int64)
    return number
