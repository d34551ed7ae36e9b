"""Classes of a surface's points: ground, structures, plants by their height, and wires.

Letters: n points; LineFrame, metres.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import minimum_filter, uniform_filter
from scipy.spatial import cKDTree

from plnerf.findings import Finding, harms, note
from plnerf.line.cloud import (
    BUILDING,
    CONDUCTOR,
    GROUND,
    NO_WIRE,
    NOISE,
    SHIELD,
    TOWER,
    UNCLASSIFIED,
    Cloud,
)
from plnerf.line.line import Structure
from plnerf.line.wire import Wire
from plnerf.survey.config_ground import ClassifyConfig
from plnerf.survey.ground import Ground, find_ground, settled, vegetation
from plnerf.survey.lidar.config_things import ThingsConfig
from plnerf.survey.lidar.things import under_roofs
from plnerf.survey.on_wires import NONE, on_wires
from plnerf.survey.surface import Surface

THINGS = ThingsConfig()
STEP_M = 0.5
"""Spacing of the places on a wire beside which nothing is ground."""
ROUNDS = 3
"""How often the ground is lifted to the points near it.  On simulated ground whose heights have 0.1 m of
noise the second time leaves it 2 mm too low, on such with 0.2 m the third 1 cm."""


def ground_of(
    surface: Surface, wires: Sequence[Wire], left_out: Bool[np.ndarray, " n"], config: ClassifyConfig
) -> Ground | None:
    """The ground that the surface shows; None where it shows none.

    Points that are left out, such as those of structures, on wires and at their height, in crowns and of
    uncertain height do not take part.
    """
    nearest, _ = on_wires(surface, wires, config.on_wires)
    upright = surface.upright_sigma_m
    firm = (upright <= config.max_sigma_m) & ~left_out & (nearest == NONE)
    firm[firm] = ~_at_wires(surface.xyz[firm], wires, config)
    firm[firm] = ~_in_crowns(surface.xyz[firm], upright[firm], config)
    points, upright = surface.xyz[firm], upright[firm]
    ground = find_ground(points, config.ground) if len(points) else None
    return None if ground is None else settled(ground, points, _near_ground(upright, config), ROUNDS)


def _at_wires(
    points: Float[np.ndarray, "n 3"], wires: Sequence[Wire], config: ClassifyConfig
) -> Bool[np.ndarray, " n"]:
    """Points beside a wire or beyond its end that are hardly lower than it: arms and strings, say, and what
    is seen of the next span, which would be the lowest where nothing else is seen around."""
    found = np.zeros(len(points), np.bool_)
    for wire in wires:
        beyond, length = config.clear_beyond_m, wire.base.length_m
        line = wire.points(np.linspace(-beyond, length + beyond, 2 + int((length + 2 * beyond) / STEP_M)))
        high = np.flatnonzero(points[:, 2] > line[:, 2].min() - config.clear_m)
        apart, at = cKDTree(line[:, :2]).query(points[high, :2], distance_upper_bound=config.clear_beside_m)
        near, at = high[np.isfinite(apart)], at[np.isfinite(apart)]
        found[near] |= points[near, 2] > line[at, 2] - config.clear_m
    return found


def _near_ground(upright_sigma_m: Float[np.ndarray, " n"], config: ClassifyConfig) -> Float[np.ndarray, " n"]:
    """The greatest height above or below the ground at which a point still counts as ground."""
    return np.maximum(config.ground.near_m, config.near_sigmas * upright_sigma_m)


def _in_crowns(
    points: Float[np.ndarray, "n 3"], sigma_m: Float[np.ndarray, " n"], config: ClassifyConfig
) -> Bool[np.ndarray, " n"]:
    """Points around which few are near to the lowest."""
    if not len(points):
        return np.zeros(0, np.bool_)
    cell, width = config.ground.cell_m, config.crown_cells
    row, column = np.floor((points[:, :2] - points[:, :2].min(0)) / cell).astype(np.int64).T
    shape = (int(row.max()) + 1, int(column.max()) + 1)
    lowest = np.full(shape, np.inf)
    np.minimum.at(lowest, (row, column), points[:, 2] + sigma_m)
    lowest = minimum_filter(lowest, width, mode="nearest")
    every, low = np.zeros(shape), np.zeros(shape)
    np.add.at(every, (row, column), 1.0)
    np.add.at(low, (row, column), points[:, 2] - sigma_m <= lowest[row, column] + config.crown_height_m)
    low, every = (uniform_filter(counts, width, mode="constant") for counts in (low, every))
    crowns: Bool[np.ndarray, " n"] = low[row, column] < config.min_low_share * every[row, column]
    return crowns


def standing_on(ground: Ground | None, structures: Sequence[Structure]) -> tuple[Structure, ...]:
    """The structures, each with its foot on the ground and its top where it was."""
    if ground is None:
        return tuple(structures)
    stood = []
    for one in structures:
        lower = float(ground.above(one.foot[None])[0])
        stood.append(replace(one, foot=one.foot - [0, 0, lower], height_m=one.height_m + lower))
    return tuple(stood)


def classified(
    surface: Surface,
    ground: Ground | None,
    wires: Sequence[Wire],
    of_structure: Bool[np.ndarray, " n"],
    config: ClassifyConfig,
    things: ThingsConfig = THINGS,
) -> tuple[Cloud, tuple[Finding, ...]]:
    """The surface's points with their classes and wires, and what a reader must know of the classes.

    Buildings are recognised by their roofs as in a cloud without classes; all else that stands is vegetation.
    """
    label = np.full(len(surface.xyz), UNCLASSIFIED, np.uint8)
    wire = np.full(len(surface.xyz), NO_WIRE, np.int64)
    sigma = surface.sigma_m
    if ground is None:
        finding = harms(
            "classes", "No ground is seen: the points are not classified, and heights above it are unknown."
        )
    else:
        above, upright = ground.above(surface.xyz), surface.upright_sigma_m
        on_it = np.abs(above) <= _near_ground(upright, config)
        on_it &= upright <= config.max_sigma_m
        label[on_it] = GROUND
        sigma = np.where(on_it, upright, sigma)
        higher = (above > 0) & ~on_it
        label[higher] = vegetation(above[higher], config.ground)
        label[_of_buildings(surface, above, higher & ~of_structure, things)] = BUILDING
        finding = note(
            "classes",
            "Buildings are recognised by smooth roofs that are seen from above; all else that stands is "
            "classified as vegetation, by height.",
        )
    label[of_structure] = TOWER
    nearest, smeared = on_wires(surface, wires, config.on_wires)
    label[smeared] = NOISE
    for k, one in enumerate(wires):
        wire[nearest == k] = one.id
        label[nearest == k] = SHIELD if one.kind == "shield" else CONDUCTOR
    return Cloud(surface.xyz, label, wire, surface.rgb, sigma), (finding,)


def _of_buildings(
    surface: Surface, above_m: Float[np.ndarray, " n"], may_be: Bool[np.ndarray, " n"], things: ThingsConfig
) -> Int[np.ndarray, " _"]:
    """Indices of the points under roofs, by the points that are exact enough to show one."""
    index = np.flatnonzero(may_be)
    exact = surface.sigma_m[index] <= things.max_sigma_m
    as_exact = replace(things, max_rms_m=things.images_rms_m)
    return index[under_roofs(surface.xyz[index], above_m[index], as_exact, exact)]
