"""The least clearance of one wire to one class of objects, straight down, in plan or in space.

Letters: k stations along a wire; s along its base, y to its left, z up; LineFrame, metres.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from plnerf.line.cloud import Cloud
from plnerf.line.ends import Quantity
from plnerf.line.rules import Direction
from plnerf.line.wire import Wire
from plnerf.survey.config_ground import ClearanceConfig
from plnerf.survey.crossings import variance_towards
from plnerf.survey.ground_section import ground_under
from plnerf.survey.map_objects import MapObject
from plnerf.survey.obstacles import beside, nearest_along, stations
from plnerf.survey.sampling import end_sigma_m


@dataclass(frozen=True, eq=False)
class Measured:
    """A least distance and its two ends."""

    distance: Quantity
    on_wire: Float[np.ndarray, "3"]
    on_object: Float[np.ndarray, "3"]


@dataclass(frozen=True, eq=False)
class ObjectPoints:
    """The points of a cloud that one class of objects has."""

    cloud: Cloud
    index: Int[np.ndarray, " m"]
    group: str
    """How far they reach between points depends on it (`sampling.py`)."""


def above_surface(
    wire: Wire, ground: ObjectPoints, over: Sequence[MapObject] | None, config: ClearanceConfig
) -> Measured | None:
    """The least height above the ground; over: only above these objects, of which the ground is the surface.

    None where the wire is above none of them, or no ground is known there.
    """
    at = stations(wire, config.station_m)
    points = wire.points(at)
    inside = np.ones(len(at), np.bool_) if over is None else inside_any(points[:, :2], over)
    if not inside.any():
        return None
    z, sigma = ground_under(
        wire, at, ground.cloud.xyz, ground.index, ground.cloud.sigma_m, config.ground
    )
    height = np.where(inside & np.isfinite(z), points[:, 2] - z, np.inf)
    k = int(height.argmin())
    if not np.isfinite(height[k]):
        return None
    spread = float(np.hypot(wire.sigma_at(at[k : k + 1])[0, 1], sigma[k]))
    return Measured(Quantity(float(height[k]), spread), points[k], np.array([*points[k, :2], z[k]]))


def beside_area(wire: Wire, objects: Sequence[MapObject], config: ClearanceConfig) -> Measured | None:
    """The least distance in plan to objects of a map that the wire is not above, of which the vertical
    clearance counts.  The map's own errors are not known."""
    import shapely

    at = stations(wire, config.station_m)
    points = wire.points(at)
    flat = shapely.points(points[:, :2])
    best, least = None, config.obstacles.reach_m
    for one in objects:
        distance = shapely.distance(one.shape, flat)
        k = int(distance.argmin())
        if 0 < distance[k] <= least:
            best, least = (k, one.shape), float(distance[k])
    if best is None:
        return None
    k, shape = best
    x, y = shapely.shortest_line(shape, flat[k]).coords[0]
    sigma = float(wire.sigma_at(at[k : k + 1])[0, 0])
    return Measured(Quantity(least, sigma), points[k], np.array([x, y, points[k, 2]]))


def to_points(
    wire: Wire, of: ObjectPoints, direction: Direction, config: ClearanceConfig, *, under_m: float,
    lower_m: float, beyond_m: tuple[float, float],
) -> Measured | None:  # fmt: skip
    """The least distance to an object's points.

    radial: in space, up to `beyond_m` beyond the wire's ends too; vertical: to those within `under_m` of the
    upright surface through the wire; horizontal: in plan, across the wire, to those that are not lower than
    it by `lower_m` or more, whose vertical clearance counts.
    """
    if direction == "radial":
        found = _nearest(wire, of, config, beyond_m)
    elif direction == "vertical":
        found = _across(wire, of, under_m, lambda aside, above: np.abs(above))
    else:
        found = _across(
            wire, of, config.obstacles.reach_m,
            lambda aside, above: np.where(above < lower_m, np.abs(aside), np.inf),
        )  # fmt: skip
    if found is None:
        return None
    value, s, point = found
    on_wire, on_object = wire.points(np.array([s]))[0], of.cloud.xyz[point].copy()
    towards = {
        "radial": (on_wire - on_object) / max(value, 1e-9),
        "vertical": np.array([0.0, 0.0, 1.0]),
        "horizontal": np.array([*wire.base.n, 0.0]),
    }[direction]
    sigma = np.hypot(
        np.sqrt(variance_towards(wire, s, towards)),
        end_sigma_m(of.cloud, of.index, point, config.sampling, group=of.group, towards=towards),
    )
    return Measured(Quantity(value, float(sigma)), on_wire, on_object)


def _nearest(
    wire: Wire, of: ObjectPoints, config: ClearanceConfig, beyond_m: tuple[float, float]
) -> tuple[float, float, int] | None:
    """Least distance in space, where along the wire, and to which point."""
    at, reach_m = stations(wire, config.station_m), config.obstacles.reach_m
    near = nearest_along(wire, at, of.cloud.xyz, of.index, reach_m, beyond_m)
    k = int(near.distance_m.argmin())
    if near.index[k] < 0:
        return None
    return float(near.distance_m[k]), float(near.s_m[k]), int(near.index[k])


def _across(
    wire: Wire, of: ObjectPoints, reach_m: float,
    away: Callable[[Float[np.ndarray, " c"], Float[np.ndarray, " c"]], Float[np.ndarray, " c"]],
) -> tuple[float, float, int] | None:  # fmt: skip
    """The same of what lies beside the wire; away: the distance of points that the wire is so far aside of,
    and above."""
    best: tuple[float, float, int] | None = None
    for some, local in beside(wire, of.cloud.xyz, of.index, reach_m, (0.0, 0.0)):
        if len(some):
            distance = away(*(wire.at(local[:, 0]) - local[:, 1:]).T)
            k = int(distance.argmin())
            if distance[k] < (np.inf if best is None else best[0]):
                best = (float(distance[k]), float(local[k, 0]), int(some[k]))
    return best


def inside_any(
    xy: Float[np.ndarray, "k 2"], objects: Sequence[MapObject]
) -> Bool[np.ndarray, " k"]:
    """Which places lie in one of the objects, in plan."""
    found = np.zeros(len(xy), np.bool_)
    if objects:
        import shapely

        for one in objects:
            found |= shapely.intersects_xy(one.shape, xy[:, 0], xy[:, 1])
    return found
