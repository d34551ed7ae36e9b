"""What is green and goes on well below: a plant, though few images see it.

Two images of a pair make one mistake, so that what few images see is a possible obstacle only.  But such
mistakes near wires are made at wires and structures, which are grey, or thin and in the air; and what stands
where a wire is no longer seen is no structure, of steel, concrete or wood, if it is as green as a plant.

    e = (2 G - R - B) / (R + G + B)

is the excess of green (Woebbecke et al. 1995, "Color indices for weed identification"): 0 of grey.

Letters: n points of the cloud, m those that are asked about, c cells.
"""

import numpy as np
from jaxtyping import Bool, Int
from scipy.spatial import cKDTree

from plnerf.line.cloud import HIGH_VEGETATION, LOW_VEGETATION, NO_WIRE, VEGETATION, Cloud
from plnerf.survey.config_obstacles import GreenConfig


def green_plants(cloud: Cloud, index: Int[np.ndarray, " m"], config: GreenConfig) -> Bool[np.ndarray, " m"]:
    """Which of the indexed points are in what is green and is seen well below them; none without colours, nor
    any that more images see past than see it."""
    if cloud.rgb is None or not len(index):
        return np.zeros(len(index), np.bool_)
    plants = np.isin(cloud.label, (LOW_VEGETATION, VEGETATION, HIGH_VEGETATION)) & (cloud.wire == NO_WIRE)
    plants[index] = True
    points, side = cloud.xyz[plants], config.cell_m
    cells, of = np.unique(np.floor(points / side).astype(np.int64), axis=0, return_inverse=True)
    of, middles = of.reshape(-1), (cells + 0.5) * side
    R, G, B = cloud.rgb[plants].astype(np.float64).T
    sums = np.bincount(of, 2 * G - R - B), np.bincount(of, R + G + B)
    asked = np.full(len(plants), -1)
    asked[plants] = of
    asked = asked[index]
    green = np.zeros(len(cells), np.bool_)
    tree, plan = cKDTree(middles), cKDTree(middles[:, :2])
    for cell in np.unique(asked):
        near = tree.query_ball_point(middles[cell], config.within_m)
        if sums[0][near].sum() < config.least * sums[1][near].sum():
            continue
        column = plan.query_ball_point(middles[cell, :2], config.aside_m)
        below = cells[cell, 2] - np.unique(cells[column, 2])
        deep = (below > 0) & (below * side <= config.below_m)
        green[cell] = deep.sum() * side >= config.least_below_m
    found: Bool[np.ndarray, " m"] = green[asked]
    if cloud.seen is not None and cloud.past is not None:
        found &= cloud.seen[index] >= cloud.past[index]
    return found
