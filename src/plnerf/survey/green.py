"""What is green and goes on well below: a plant, though few images see it.

Two images of a pair make one mistake, so that what few images see is a possible obstacle only.  But such
mistakes near wires are made at wires and structures, which are grey, or thin and in the air; and what stands
where a wire is no longer seen is no structure, of steel, concrete or wood, if it is as green as a plant.

    e = (2 G - R - B) / (R + G + B)

is the excess of green (Woebbecke et al. 1995, "Color indices for weed identification"): 0 of grey.

Letters: n points of the cloud, m those that are asked about, c cells.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy.spatial import cKDTree

from plnerf.line.cloud import HIGH_VEGETATION, LOW_VEGETATION, NO_WIRE, VEGETATION, Cloud
from plnerf.survey.config_obstacles import GreenConfig


@dataclass(frozen=True, eq=False)
class _Cells:
    """Points of vegetation and those that are asked about, by cell."""

    at: Int[np.ndarray, "c 3"]
    """Each cell, counted in cells."""
    middles: Float[np.ndarray, "c 3"]
    excess: Float[np.ndarray, "c 2"]
    """Sums of 2 G - R - B and of R + G + B."""
    asked: Int[np.ndarray, " m"]
    """Of each point that is asked about, the number of its cell."""


def green_plants(cloud: Cloud, index: Int[np.ndarray, " m"], config: GreenConfig) -> Bool[np.ndarray, " m"]:
    """Which of the indexed points are in what is green and is seen well below them; none without colours, nor
    any that more images see past than see it."""
    if cloud.rgb is None or not len(index):
        return np.zeros(len(index), np.bool_)
    cells = _cells(cloud, index, cloud.rgb, config)
    found = _green(cells, config)
    deep = np.zeros(len(cells.at), np.bool_)
    plan, side = cKDTree(cells.middles[:, :2]), config.cell_m
    for cell in np.unique(cells.asked[found]):
        column = plan.query_ball_point(cells.middles[cell, :2], config.aside_m)
        below = cells.at[cell, 2] - np.unique(cells.at[column, 2])
        counted = (below > 0) & (below * side <= config.below_m)
        deep[cell] = counted.sum() * side >= config.least_below_m
    found &= deep[cells.asked]
    if cloud.seen is not None and cloud.past is not None:
        found &= cloud.seen[index] >= cloud.past[index]
    return found


def is_green(cloud: Cloud, index: Int[np.ndarray, " m"], config: GreenConfig) -> Bool[np.ndarray, " m"]:
    """Which of the indexed points are in what is green; none without colours."""
    if cloud.rgb is None or not len(index):
        return np.zeros(len(index), np.bool_)
    return _green(_cells(cloud, index, cloud.rgb, config), config)


def _green(cells: _Cells, config: GreenConfig) -> Bool[np.ndarray, " m"]:
    green = np.zeros(len(cells.at), np.bool_)
    tree = cKDTree(cells.middles)
    for cell in np.unique(cells.asked):
        excess, total = cells.excess[tree.query_ball_point(cells.middles[cell], config.within_m)].sum(0)
        green[cell] = excess >= config.least * total
    found: Bool[np.ndarray, " m"] = green[cells.asked]
    return found


def _cells(
    cloud: Cloud, index: Int[np.ndarray, " m"], rgb: UInt8[np.ndarray, "n 3"], config: GreenConfig
) -> _Cells:
    plants = np.isin(cloud.label, (LOW_VEGETATION, VEGETATION, HIGH_VEGETATION)) & (cloud.wire == NO_WIRE)
    plants[index] = True
    cells, of = np.unique(
        np.floor(cloud.xyz[plants] / config.cell_m).astype(np.int64), axis=0, return_inverse=True
    )
    of = of.reshape(-1)
    R, G, B = rgb[plants].astype(np.float64).T
    excess = np.stack([np.bincount(of, 2 * G - R - B), np.bincount(of, R + G + B)], 1)
    number = np.full(len(plants), -1)
    number[plants] = of
    return _Cells(cells, (cells + 0.5) * config.cell_m, excess, number[index])
