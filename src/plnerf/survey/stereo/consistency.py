"""The consistency filter: which points of depth maps other images' depth maps support.

A thing that is there is seen by many images, and each has points on it.  What a wrong match leaves, mostly
where a wire lies before a distant background, hangs alone in the air.

Letters: n points.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from plnerf.survey.stereo.config import ConsistencyConfig


def consistent(
    points: Float[np.ndarray, "n 3"],
    image: Int[np.ndarray, " n"],
    radius: Float[np.ndarray, " n"],
    config: ConsistencyConfig,
) -> Bool[np.ndarray, " n"]:
    """True for points whose nearest neighbours within `radius` come from `min_support` images or more.

    Points that are dropped support no others: repeated until nothing changes, `rounds` times at most.
    """
    kept: Bool[np.ndarray, " n"] = np.ones(len(points), np.bool_)
    for _ in range(config.rounds):
        before = int(kept.sum())
        if before:
            kept[kept] = _supported(points[kept], image[kept], radius[kept], config)
        if kept.sum() == before:
            break
    return kept


def _supported(
    points: Float[np.ndarray, "n 3"],
    image: Int[np.ndarray, " n"],
    radius: Float[np.ndarray, " n"],
    config: ConsistencyConfig,
) -> Bool[np.ndarray, " n"]:
    apart, near = cKDTree(points).query(points, k=config.neighbours, workers=-1)
    apart, near = apart.reshape(len(points), -1), near.reshape(len(points), -1)  # k = 1 drops the axis
    there = apart <= radius[:, None]  # infinite where there are fewer points in all
    of = np.where(there, image[np.minimum(near, len(points) - 1)], image[:, None])
    of.sort(axis=1)
    enough: Bool[np.ndarray, " n"] = 1 + (np.diff(of, axis=1) > 0).sum(1) >= config.min_support
    return enough
