"""Classes of a run's surface: ground, supports, plants by their height, and conductors.

Letters: n points, world units.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import minimum_filter, uniform_filter

from plnerf.line.old_catenary import Catenary
from plnerf.survey.field_surface import Surface
from plnerf.survey.ground import CELL_M, Ground, find_ground, vegetation
from plnerf.survey.model import (
    CONDUCTOR,
    GROUND,
    NO_WIRE,
    NOISE,
    SHIELD,
    TOWER,
    UNCLASSIFIED,
    Cloud,
    Conductor,
    Tower,
)
from plnerf.survey.obstacles import LOOSE_M
from plnerf.survey.on_wires import NONE, on_wires

AROUND_CELLS = 5
CROWN_M, LEAST_LOW = 1.25, 0.3
"""Of the points in so many cells, how many must be within so much (ground may rise) of the lowest: else
they are a crown's, seen from the side."""
NEAR_GROUND_M = 0.3
"""A surface point this near to the ground, or twice its standard deviation, belongs to it."""


def ground_of(
    surface: Surface, wires: Sequence[Catenary], of_tower: Bool[np.ndarray, " n"], metre: float = 1.0
) -> Ground | None:
    """In metres, of the points that are known to a metre; None where they make none.

    The lowest of a crown that hides the ground is no ground.  metre: its length in the surface's units.
    """
    nearest, _ = on_wires(surface, wires, metre)
    firm = (_upright(surface) <= LOOSE_M * metre) & ~of_tower & (nearest == NONE)
    firm[firm] = ~_in_crowns(surface.xyz[firm] / metre, _upright(surface)[firm] / metre)
    return find_ground(surface.xyz[firm] / metre) if firm.any() else None


def _in_crowns(points: Float[np.ndarray, "n 3"], sigma: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Those around which few points are near to the lowest."""
    if not len(points):
        return np.zeros(0, np.bool_)
    row, column = np.floor((points[:, :2] - points[:, :2].min(0)) / CELL_M).astype(np.int64).T
    shape = (int(row.max()) + 1, int(column.max()) + 1)
    lowest = np.full(shape, np.inf)
    np.minimum.at(lowest, (row, column), points[:, 2] + sigma)
    lowest = minimum_filter(lowest, AROUND_CELLS, mode="nearest")
    every, low = np.zeros(shape), np.zeros(shape)
    np.add.at(every, (row, column), 1.0)
    np.add.at(low, (row, column), points[:, 2] - sigma <= lowest[row, column] + CROWN_M)
    low, every = (uniform_filter(counts, AROUND_CELLS, mode="constant") for counts in (low, every))
    crowns: Bool[np.ndarray, " n"] = low[row, column] < LEAST_LOW * every[row, column]
    return crowns


def standing_on(ground: Ground | None, towers: Sequence[Tower], metre: float = 1.0) -> tuple[Tower, ...]:
    """The towers, each with its foot on the ground and its top where it was."""
    if ground is None:
        return tuple(towers)
    stood = []
    for tower in towers:
        lower = metre * float(ground.above(tower.foot[None] / metre)[0])
        stood.append(replace(tower, foot=tower.foot - [0, 0, lower], height_m=tower.height_m + lower))
    return tuple(stood)


def classified(
    surface: Surface,
    ground: Ground | None,
    conductors: Sequence[Conductor],
    of_tower: Bool[np.ndarray, " n"],
    metre: float = 1.0,
) -> tuple[Cloud, list[str]]:
    """The surface's points with their classes and wires; and what is doubtful.

    Buildings are not told from plants.  metre: its length in the surface's units.
    """
    label = np.full(len(surface.xyz), UNCLASSIFIED, np.uint8)
    wire = np.full(len(surface.xyz), NO_WIRE, np.int64)
    sigma, notes = surface.sigma, []
    if ground is None:
        notes.append("The field shows no ground: its points are not classified, and no heights are known.")
    else:
        above, upright = ground.above(surface.xyz / metre), _upright(surface)
        on_it = np.abs(above) <= np.maximum(NEAR_GROUND_M, 2 * upright / metre)
        on_it &= upright <= LOOSE_M * metre
        label[on_it] = GROUND
        sigma = np.where(on_it, upright, sigma)
        higher = (above > 0) & ~on_it
        label[higher] = vegetation(above[higher])
        notes.append("Buildings and all else that stands are classified as vegetation, by height.")
    label[of_tower] = TOWER
    nearest, smeared = on_wires(surface, [conductor.fit.curve for conductor in conductors], metre)
    label[smeared] = NOISE
    for k, conductor in enumerate(conductors):
        wire[nearest == k] = conductor.id
        label[nearest == k] = SHIELD if conductor.kind == "shield" else CONDUCTOR
    return Cloud(surface.xyz, label, wire, surface.rgb, sigma), notes


def _upright(surface: Surface) -> Float[np.ndarray, " n"]:
    """Standard deviation upright: along flat ground a point may move as it will."""
    return surface.sigma * np.abs(surface.sight[:, 2])
