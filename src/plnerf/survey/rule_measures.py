"""The least clearance of one wire to one class of objects, straight down, in plan or in space.

Letters: k stations along a wire; s along its base, y to its left, z up; LineFrame, metres.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from plnerf.line.cloud import Cloud
from plnerf.line.ends import Quantity
from plnerf.line.rules import Direction
from plnerf.line.wire import Wire
from plnerf.survey.config_ground import ClearanceConfig
from plnerf.survey.config_rules import RulesConfig
from plnerf.survey.crossings import variance_towards
from plnerf.survey.ground_section import ground_under
from plnerf.survey.map_objects import MapObject
from plnerf.survey.obstacles import beside, nearest_along, stations


@dataclass(frozen=True, eq=False)
class Measured:
    """A least distance and its two ends."""

    distance: Quantity
    on_wire: Float[np.ndarray, "3"]
    on_object: Float[np.ndarray, "3"]


def above_surface(
    wire: Wire, cloud: Cloud, ground: Int[np.ndarray, " m"], over: Sequence[MapObject] | None,
    config: ClearanceConfig,
) -> Measured | None:  # fmt: skip
    """The least height above the ground; over: only above these objects, of which the ground is the surface.

    None where the wire is above none of them, or no ground is known there.
    """
    at = stations(wire, config.station_m)
    points = wire.points(at)
    inside = np.ones(len(at), np.bool_) if over is None else _above(points, over)
    if not inside.any():
        return None
    z, sigma = ground_under(wire, at, cloud.xyz, ground, cloud.sigma_m, config.ground)
    height = np.where(inside & np.isfinite(z), points[:, 2] - z, np.inf)
    k = int(height.argmin())
    if not np.isfinite(height[k]):
        return None
    spread = float(np.hypot(wire.sigma_at(at[k : k + 1])[0, 1], sigma[k]))
    return Measured(Quantity(float(height[k]), spread), points[k], np.array([*points[k, :2], z[k]]))


def beside_area(wire: Wire, objects: Sequence[MapObject], reach_m: float, step_m: float) -> Measured | None:
    """The least distance in plan to objects of a map that the wire is not above, of which the vertical
    clearance counts.  The map's own errors are not known."""
    import shapely

    at = stations(wire, step_m)
    points = wire.points(at)
    flat = shapely.points(points[:, :2])
    best: Measured | None = None
    for one in objects:
        distance = shapely.distance(one.shape, flat)
        k = int(distance.argmin())
        if not 0 < distance[k] <= reach_m or (best is not None and distance[k] >= best.distance.value):
            continue
        x, y = shapely.shortest_line(one.shape, flat[k]).coords[0]
        sigma = float(wire.sigma_at(at[k : k + 1])[0, 0])
        best = Measured(Quantity(float(distance[k]), sigma), points[k], np.array([x, y, points[k, 2]]))
    return best


def to_points(
    wire: Wire, cloud: Cloud, index: Int[np.ndarray, " m"], direction: Direction, lower_m: float,
    config: RulesConfig, step_m: float,
) -> Measured | None:  # fmt: skip
    """The least distance to some of the cloud's points, which are indexed.

    vertical: to those within `under_m` of the upright surface through the wire; horizontal: in plan, across
    the wire, to those that are not lower than it by `lower_m` or more, whose vertical clearance counts;
    radial: in space.  Only what is beside the wire counts, not what is beyond its ends.
    """
    if direction == "radial":
        near = nearest_along(wire, stations(wire, step_m), cloud.xyz, index, config.reach_m, (0.0, 0.0))
        k = int(near.distance_m.argmin())
        if not np.isfinite(near.distance_m[k]):
            return None
        return _between(wire, cloud, float(near.s_m[k]), int(near.index[k]), float(near.distance_m[k]))
    best: tuple[float, float, int] | None = None
    reach_m = config.under_m if direction == "vertical" else config.reach_m
    for some, local in beside(wire, cloud.xyz, index, reach_m, (0.0, 0.0)):
        off = wire.at(local[:, 0]) - local[:, 1:]
        away = np.abs(off[:, 1])
        if direction == "horizontal":
            away = np.where(off[:, 1] < lower_m, np.abs(off[:, 0]), np.inf)
        if len(some) and np.isfinite(away).any() and (best is None or away.min() < best[0]):
            k = int(away.argmin())
            best = (float(away[k]), float(local[k, 0]), int(some[k]))
    if best is None:
        return None
    value, s, point = best
    sigma = wire.sigma_at(np.array([s]))[0, 0 if direction == "horizontal" else 1]
    own = 0.0 if cloud.sigma_m is None else float(cloud.sigma_m[point])
    distance = Quantity(value, float(np.hypot(sigma, own)))
    return Measured(distance, wire.points(np.array([s]))[0], cloud.xyz[point].copy())


def _between(wire: Wire, cloud: Cloud, s: float, point: int, value: float) -> Measured:
    on_wire, obstacle = wire.points(np.array([s]))[0], cloud.xyz[point]
    of_wire = variance_towards(wire, s, (on_wire - obstacle) / max(value, 1e-9))
    of_point = 0.0 if cloud.sigma_m is None else float(cloud.sigma_m[point]) ** 2
    return Measured(Quantity(value, float(np.sqrt(of_wire + of_point))), on_wire, obstacle.copy())


def _above(points: Float[np.ndarray, "k 3"], objects: Sequence[MapObject]) -> Bool[np.ndarray, " k"]:
    import shapely

    found = np.zeros(len(points), np.bool_)
    for one in objects:
        found |= shapely.intersects_xy(one.shape, points[:, 0], points[:, 1])
    return found


def within(
    xyz: Float[np.ndarray, "n 3"], index: Int[np.ndarray, " m"], objects: Sequence[MapObject]
) -> Bool[np.ndarray, " m"]:
    """Which of the indexed points stand on one of the objects."""
    return _above(xyz[index], objects) if objects else np.zeros(len(index), np.bool_)
