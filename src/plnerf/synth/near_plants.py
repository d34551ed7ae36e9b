"""The plants near a line: how far their leaves are from each of its wires, and whether images show these.

World frame, metres.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree

from plnerf.line.wire import Wire
from plnerf.synth.capture import View
from plnerf.synth.flight_config import CaptureConfig
from plnerf.synth.foliage import plant_meshes
from plnerf.synth.seen import OBSERVABLE_DEG, OBSERVABLE_IMAGES, in_frame
from plnerf.synth.site import Plant, Site, radius_m

RANGE_M = 40.0  # around mid-span; further off, along the span and so far across:
ACROSS_M = 18.0
LISTED_M = 25.0
"""Wires that a plant is farther from are not listed with it, but for the nearest."""
BESIDE_M = 0.5
"""The nearest leaf beside every piece of a wire that is so long is listed: surveys may have a part of it."""
AXIS_STEP_M = 0.02  # of the points that clearances are measured to
COARSE = 25  # every so many points of an axis say which leaves may be the nearest
BEFORE_M = 0.5
"""Other leaves of the crown stand before a leaf by less than this; they show the same of the plant."""
PLANTS_RULE = (
    "clearance_m: from a plant's nearest leaf to the conductor's surface; leaves: x, y, z, the clearance and "
    f"whether it is observable (1 or 0) of the nearest leaf beside every {BESIDE_M:g} m of each conductor "
    f"within {LISTED_M:g} m; observable: whether at least {OBSERVABLE_IMAGES} images show the "
    f"leaf, or what stands at most {BEFORE_M:g} m before it, within a pixel, from directions that span "
    f"{OBSERVABLE_DEG:g} degrees or more"
)

DepthOf = Callable[[View], Float[np.ndarray, "h w"]]
"""Distance along a view's axis of what each pixel's centre sees; 0 for the sky."""


@dataclass(frozen=True)
class NearLeaf:
    """The leaf of a plant that is nearest to a conductor, or to a piece of it."""

    clearance_m: float
    """From the leaf to the conductor's surface."""
    conductor: str | None
    """Its name."""
    leaf: Float[np.ndarray, "3"]
    observable: bool | None = None
    """PLANTS_RULE; None: not filmed."""


Leaves = tuple[NearLeaf, ...]
"""Of one plant, beside the pieces of all conductors, the nearest first; none of plants far from the line."""


def near_plants(site: Site) -> list[Leaves]:
    """For each plant of a site its leaves that are nearest to the conductors' pieces, not filmed yet."""
    axes = [_Axis(wire) for wire in site.wires]

    def nearest(plant: Plant) -> Leaves:
        if np.hypot(*plant.foot[:2]) >= RANGE_M and not _beside(site, plant):
            return ()
        leaves = plant_meshes(plant)[1].vertices
        found = [leaf for axis in axes for leaf in axis.nearest(leaves)]
        found.sort(key=lambda one: one.clearance_m)
        return tuple(one for one in found if one is found[0] or one.clearance_m <= LISTED_M)

    return [nearest(plant) for plant in site.plants]


class _Axis:
    """A conductor as points that leaves are compared with."""

    def __init__(self, wire: Wire) -> None:
        points = wire.polyline(AXIS_STEP_M)
        self._wire, self._fine = wire, cKDTree(points)
        self._coarse = cKDTree(points[np.r_[0 : len(points) : COARSE, len(points) - 1]])

    def nearest(self, leaves: Float[np.ndarray, "n 3"]) -> list[NearLeaf]:
        """The nearest leaf beside each piece, those beyond the ends with the first and the last."""
        length = self._wire.base.length_m
        s = np.clip(self._wire.base.local(leaves)[:, 0], 0.0, length)
        _, piece = np.unique((s / BESIDE_M).astype(np.int64), return_inverse=True)
        about = self._coarse.query(leaves)[0]  # at most half a coarse step too far
        least = np.full(piece.max() + 1, np.inf)
        np.minimum.at(least, piece, about)
        may = np.flatnonzero(about <= least[piece] + AXIS_STEP_M * COARSE / 2 + 0.01)
        distance = self._fine.query(leaves[may])[0]
        order = np.lexsort((distance, piece[may]))
        first = order[np.unique(piece[may][order], return_index=True)[1]]
        clearance = distance[first] - radius_m(self._wire)
        pairs = zip(clearance.tolist(), leaves[may[first]], strict=True)
        return [NearLeaf(away_m, self._wire.name, leaf) for away_m, leaf in pairs]


def filmed_plants(
    plants: Sequence[Leaves], views: Sequence[View], depth_of: DepthOf, capture: CaptureConfig
) -> list[Leaves]:
    """The same leaves, each with whether images show it: PLANTS_RULE."""
    near = [leaf for plant in plants for leaf in plant]
    if not near:
        return list(plants)
    leaves = np.stack([one.leaf for one in near])
    seen = np.stack([_shown(leaves, view, depth_of, capture) for view in views])
    rays = leaves - np.stack([view.centre for view in views])[:, None]
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    filmed = iter(replace(one, observable=_enough(rays[seen[:, i], i])) for i, one in enumerate(near))
    return [tuple(next(filmed) for _ in plant) for plant in plants]


def _shown(
    leaves: Float[np.ndarray, "n 3"], view: View, depth_of: DepthOf, capture: CaptureConfig
) -> Bool[np.ndarray, " n"]:
    """Whether a view shows each leaf: nothing stands more than BEFORE_M before it in some pixel around."""
    shown = np.zeros(len(leaves), np.bool_)
    inside, pixel = in_frame(leaves, view, capture)
    if not len(inside):
        return shown
    depth = depth_of(view)
    depth = np.pad(np.where(depth > 0, depth, np.inf), 1)  # 0 around the image: nothing is seen there
    x, y = np.floor(pixel).astype(np.int64).T
    around = np.stack([depth[y + dy, x + dx] for dy in range(3) for dx in range(3)])
    z = (leaves[inside] - view.centre) @ view.R_world_camera[:, 2]
    shown[inside] = around.max(0) >= z - BEFORE_M
    return shown


def _enough(rays: Float[np.ndarray, "v 3"]) -> bool:
    """Whether so many views are enough, from so different directions (unit vectors)."""
    if len(rays) < OBSERVABLE_IMAGES:
        return False
    return bool((rays @ rays.T).min() <= np.cos(np.radians(OBSERVABLE_DEG)))


def _beside(site: Site, plant: Plant) -> bool:
    foot, route = np.array([plant.foot]), site.route
    within = route.stations_m[0] < route.stations_of(foot)[0] < route.stations_m[-1]
    return bool(within and route.away_from(foot)[0] < ACROSS_M)
