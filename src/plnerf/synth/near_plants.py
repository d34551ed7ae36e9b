"""The plants near a line: how far their leaves are from its wires, and whether images show the nearest one.

World frame, metres.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree

from plnerf.synth.capture import View
from plnerf.synth.flight_config import CaptureConfig
from plnerf.synth.foliage import plant_meshes
from plnerf.synth.seen import OBSERVABLE_DEG, OBSERVABLE_IMAGES, in_frame
from plnerf.synth.site import Plant, Site, radius_m

RANGE_M = 40.0  # around mid-span; further off, along the span and so far across:
ACROSS_M = 18.0
AXIS_STEP_M = 0.02  # of the points that clearances are measured to
COARSE = 25  # every so many points of an axis say which leaves may be the nearest
BEFORE_M = 0.5
"""Other leaves of the crown stand before a leaf by less than this; they show the same of the plant."""
PLANTS_RULE = (
    f"observable: whether at least {OBSERVABLE_IMAGES} images show a plant's leaf that is nearest to a "
    f"conductor, or what stands at most {BEFORE_M:g} m before it, within a pixel, from directions that span "
    f"{OBSERVABLE_DEG:g} degrees or more"
)

DepthOf = Callable[[View], Float[np.ndarray, "h w"]]
"""Distance along a view's axis of what each pixel's centre sees; 0 for the sky."""


@dataclass(frozen=True)
class NearPlant:
    """The leaf of a plant that is nearest to a conductor."""

    clearance_m: float
    """From its leaf to the conductor's surface."""
    conductor: str | None
    """Its name."""
    leaf: Float[np.ndarray, "3"]
    observable: bool | None = None
    """PLANTS_RULE; None: not filmed."""


def near_plants(site: Site) -> list[NearPlant | None]:
    """For each plant of a site its nearest leaf, not filmed yet; None for those far from the line."""
    axes = [wire.polyline(AXIS_STEP_M) for wire in site.wires]
    radii = np.repeat([radius_m(wire) for wire in site.wires], [len(axis) for axis in axes])
    owners = np.cumsum([len(axis) for axis in axes])
    tree = cKDTree(np.concatenate(axes))
    coarse = cKDTree(np.concatenate([axis[np.r_[0 : len(axis) : COARSE, len(axis) - 1]] for axis in axes]))

    def nearest(plant: Plant) -> NearPlant | None:
        if np.hypot(*plant.foot[:2]) >= RANGE_M and not _beside(site, plant):
            return None
        leaves = plant_meshes(plant)[1].vertices
        about = coarse.query(leaves)[0]  # at most half a coarse step too far
        leaves = leaves[about <= about.min() + AXIS_STEP_M * COARSE / 2 + 0.01]
        distance, at = tree.query(leaves)
        best = int(np.argmin(distance))
        owner = int(np.searchsorted(owners, at[best], side="right"))
        clearance = float(distance[best]) - float(radii[at[best]])
        return NearPlant(clearance, site.wires[owner].name, leaves[best])

    return [nearest(plant) for plant in site.plants]


def filmed_plants(
    plants: Sequence[NearPlant | None], views: Sequence[View], depth_of: DepthOf, capture: CaptureConfig
) -> list[NearPlant | None]:
    """The same plants, each with whether images show its nearest leaf: PLANTS_RULE."""
    near = [plant for plant in plants if plant is not None]
    if not near:
        return list(plants)
    leaves = np.stack([plant.leaf for plant in near])
    seen = np.stack([_shown(leaves, view, depth_of, capture) for view in views])
    rays = leaves - np.stack([view.centre for view in views])[:, None]
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    filmed = iter(replace(one, observable=_enough(rays[seen[:, i], i])) for i, one in enumerate(near))
    return [None if plant is None else next(filmed) for plant in plants]


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
