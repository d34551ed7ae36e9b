"""Which points of depth maps the depth maps of other images confirm.

A thing that is there is seen by many images, and each has points on it.  What a wrong match leaves, mostly
where a wire lies before a distant background, hangs alone in the air.

Letters: n points.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

NEIGHBOURS = 24
LEAST_IMAGES = 4
"""From which the nearest points around one must come, its own included."""
ROUNDS = 4
"""Company that is itself not confirmed does not count."""


def confirmed(
    points: Float[np.ndarray, "n 3"], image: Int[np.ndarray, " n"], radius: Float[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Those whose nearest points, as far as they lie within `radius`, come from enough images."""
    kept: Bool[np.ndarray, " n"] = np.ones(len(points), np.bool_)
    for _ in range(ROUNDS):
        before = int(kept.sum())
        if before:
            kept[kept] = _in_company(points[kept], image[kept], radius[kept])
        if kept.sum() == before:
            break
    return kept


def _in_company(
    points: Float[np.ndarray, "n 3"], image: Int[np.ndarray, " n"], radius: Float[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    apart, near = cKDTree(points).query(points, k=NEIGHBOURS, workers=-1)
    there = apart <= radius[:, None]  # infinite where there are fewer points in all
    of = np.where(there, image[np.minimum(near, len(points) - 1)], image[:, None])
    of.sort(axis=1)
    enough: Bool[np.ndarray, " n"] = 1 + (np.diff(of, axis=1) > 0).sum(1) >= LEAST_IMAGES
    return enough
