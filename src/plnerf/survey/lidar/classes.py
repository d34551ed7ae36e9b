"""Classifies the points of a cloud by the wires, structures and ground that were found in it.

Letters: d distinct points; k of them above the ground; metres, z up.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy.spatial import cKDTree

from plnerf.line.cloud import CONDUCTOR, GROUND, LOW_NOISE, NO_WIRE, NOISE, SHIELD, TOWER, UNCLASSIFIED, Cloud
from plnerf.line.wire import Wire
from plnerf.survey.ground import Ground, vegetation
from plnerf.survey.lidar.config import LidarConfig
from plnerf.survey.lidar.linear import Linear
from plnerf.survey.lidar.things import no_plants


def wires_and_structures(
    points: Float[np.ndarray, "d 3"], wires: Sequence[Wire], of_wire: dict[int, Int[np.ndarray, " _"]],
    bodies: Sequence[Int[np.ndarray, " _"]], loose: Int[np.ndarray, " _"],
) -> Cloud:  # fmt: skip
    """The cloud with the points of wires and structures classified.

    of_wire: indices of the points of each wire, by its id; bodies: those of each structure; loose: those of
    conductors that are no wire of a span.
    """
    label = np.full(len(points), UNCLASSIFIED, np.uint8)
    wire_id = np.full(len(points), NO_WIRE, np.int64)
    label[loose] = CONDUCTOR
    for wire in wires:
        label[of_wire[wire.id]] = SHIELD if wire.kind == "shield" else CONDUCTOR
        wire_id[of_wire[wire.id]] = wire.id
    for body in bodies:
        label[body[label[body] == UNCLASSIFIED]] = TOWER
    return Cloud(points, label, wire_id)


def with_ground(
    cloud: Cloud, ground: Ground, wires: Sequence[Wire], linear: Linear, config: LidarConfig
) -> Cloud:
    """The cloud with ground, buildings and vegetation classified as well, among the points without a class.

    linear: places on lines.  What is straight over metres and no wire stays unclassified; few points high in
    the air are noise, as are those below the ground.
    """
    above = ground.above(cloud.xyz)
    label = cloud.label.copy()
    label[(label == UNCLASSIFIED) & (np.abs(above) <= config.ground.near_m)] = GROUND
    label[(label == UNCLASSIFIED) & (above < -config.ground.near_m)] = LOW_NOISE
    plants = np.flatnonzero((label == UNCLASSIFIED) & (above > config.ground.near_m))
    stray = _stray(cloud.xyz[plants], cloud.xyz[cloud.wire != NO_WIRE], wires, config)
    label[plants[stray]] = NOISE
    plants = plants[~stray]
    others = no_plants(cloud.xyz[plants], above[plants], linear, config.things, config.linear)
    label[plants] = np.where(others > 0, others, vegetation(above[plants], config.ground))
    aloft = _aloft(cloud.xyz[plants, :2], above[plants], config) & (others == 0)
    label[plants[aloft]] = NOISE
    return Cloud(cloud.xyz, label, cloud.wire)


def _aloft(
    plan: Float[np.ndarray, "k 2"], above_m: Float[np.ndarray, " k"], config: LidarConfig
) -> Bool[np.ndarray, " k"]:
    """Which points are few and have nothing below them but the ground: they are no plant."""
    things, aloft = config.things, above_m >= config.min_height_m
    if not aloft.any():
        return aloft
    if not aloft.all():
        below = cKDTree(plan[~aloft]).query(plan[aloft], distance_upper_bound=things.aloft_m)[0]
        aloft[aloft] = np.isinf(below)
    around = cKDTree(plan).query_ball_point(plan[aloft], things.aloft_m, return_length=True)
    aloft[aloft] = around < things.min_aloft
    return aloft


def with_given(cloud: Cloud, given: UInt8[np.ndarray, " d"]) -> Cloud:
    """The cloud with the classes that its file has, but for points of wires and structures found, and for
    those that it leaves unclassified."""
    ours = np.isin(cloud.label, (SHIELD, CONDUCTOR, TOWER))
    return Cloud(cloud.xyz, np.where(ours | (given <= UNCLASSIFIED), cloud.label, given), cloud.wire)


def _stray(
    plants: Float[np.ndarray, "k 3"], on_wires: Float[np.ndarray, "m 3"], wires: Sequence[Wire],
    config: LidarConfig,
) -> Bool[np.ndarray, " k"]:  # fmt: skip
    """Which points beside wires have nothing but the wire near them: noise, spacers, dampers, no plants.

    As plants they would violate every clearance.
    """
    if not wires or not len(plants):
        return np.zeros(len(plants), np.bool_)
    curves = np.concatenate([on_wires, *(wire.polyline(config.stray_m / 2) for wire in wires)])
    near = cKDTree(curves).query(plants, distance_upper_bound=config.stray_m)[0] <= config.stray_m
    near[near] = (
        cKDTree(plants[~near]).query(plants[near])[0] > config.stray_apart_m if (~near).any() else True
    )
    return near
