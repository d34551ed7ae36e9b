"""A cloud of what a trained field shows: its surfaces, as the training cameras see them.

Pixels are drawn evenly over all training images; each gives the point at which half of its light is gone.
Rays that meet no surface, and points that stand alone or that one image alone shows, are left out.

Letters: n points, r rays.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, UInt8
from scipy.spatial import cKDTree
from torch import Tensor

from plnerf.rays.rays import pixel_rays
from plnerf.render.images import default_chunk
from plnerf.render.proposals import to_distance
from plnerf.train.run import TrainedRun

RAYS = 400_000
LEAST_LIGHT = 0.5
"""Share of a ray's light that must end on its way."""
FARTHEST = 1.6
"""Points further from the middle than so many half sides of the scene's box are background."""
NEIGHBOURS = 8
LONELY = 4.0
"""A point whose neighbours are so many times as far as those of most, for its distance from the cameras,
floats in the air."""
WIDEST = 0.25
"""Standard deviation along the ray, as a share of the distance, beyond which a depth says nothing."""


@dataclass(frozen=True, eq=False)
class Surface:
    """n points, world frame."""

    xyz: Float[np.ndarray, "n 3"]
    rgb: UInt8[np.ndarray, "n 3"]
    sigma: Float[np.ndarray, " n"]
    """Standard deviation along the line of sight: how widely the field spreads the surface, and how much the
    views differ there."""
    sight: Float[np.ndarray, "n 3"]
    """The direction in which each is seen, unit length."""


def surface_points(
    run: TrainedRun, rays: int = RAYS, progress: Callable[[int, int], None] | None = None
) -> Surface:
    """Points on the surfaces of a run's field, about as many as rays; the same for the same run."""
    scene, model = run.scene, run.model
    random = np.random.default_rng(0)
    each = max(1, rays // len(scene.train))
    places, colours, spreads, footprints, views, sights = [], [], [], [], [], []
    with torch.inference_mode():
        train = torch.tensor(scene.train, device=model.appearance.device)
        for done, i in enumerate(scene.train):
            drawn = _pixels(scene.cameras.size_px[i], i, each, random)
            bundle = pixel_rays(scene.cameras, *drawn, model.backend)
            for first in range(0, len(bundle), default_chunk(model)):
                some = bundle[first : first + default_chunk(model)].to(train.device)
                out = model(some, appearance=model.mean_appearance(len(some), train))
                t = to_distance(out.histograms[-1].s, model.sampler)
                spread = half_width(t, out.histograms[-1].w)
                use = (out.accumulation >= LEAST_LIGHT) & (spread <= WIDEST * out.depth_median)
                at = some.origins + out.depth_median[:, None] * some.directions
                places.append(at[use].cpu())
                colours.append((255 * out.colour[use]).round().clamp(0, 255).to(torch.uint8).cpu())
                spreads.append(spread[use].cpu())
                footprints.append((some.radius * out.depth_median)[use].cpu())
                views.append(np.full(int(use.sum()), i))
                sights.append(some.directions[use].cpu())
            if progress is not None:
                progress(done + 1, len(scene.train))
    xyz, view = torch.cat(places).double().numpy(), np.concatenate(views)
    along, footprint = torch.cat(spreads).double().numpy(), torch.cat(footprints).double().numpy()
    use = within(xyz, scene.box)
    use[use], scatter = _seen_together(xyz[use], view[use], footprint[use])
    sigma = np.sqrt(along[use] ** 2 + scatter**2 + footprint[use] ** 2 / 12)
    frames = scene.frames
    rgb = torch.cat(colours).numpy()[use]
    sight = torch.cat(sights).double().numpy()[use] @ frames.R_scene_world
    return Surface(frames.to_world(xyz[use]), rgb, sigma / frames.scale, sight)


def within(points: Float[np.ndarray, "n 3"], box: Float[np.ndarray, "2 3"]) -> Bool[np.ndarray, " n"]:
    """Which points of the scene frame are no background."""
    low, high = box
    middle, half = (low + high) / 2, (high - low) / 2
    inside: Bool[np.ndarray, " n"] = (np.abs(points - middle) <= FARTHEST * half.max()).all(1)
    return inside


def half_width(t: Float[Tensor, "r E"], w: Float[Tensor, "r E-1"]) -> Float[Tensor, " r"]:
    """Half the distance between the 16th and 84th percentile of a ray's light: its standard deviation, were
    it normal."""
    total = w.sum(1, keepdim=True).clamp_min(1e-9)
    share = torch.cat([torch.zeros_like(total), (w / total).cumsum(1)], 1).contiguous()
    ends = []
    for level in (0.16, 0.84):
        at = torch.searchsorted(share, torch.full_like(total, level)).clamp(1, t.shape[1] - 1)
        low, high = share.gather(1, at - 1), share.gather(1, at)
        part = ((level - low) / (high - low).clamp_min(1e-9)).clamp(0, 1)
        ends.append(t.gather(1, at - 1) + part * (t.gather(1, at) - t.gather(1, at - 1)))
    return ((ends[1] - ends[0]) / 2)[:, 0]


def _pixels(
    size_px: Int[Tensor, "2"], i: int, count: int, random: np.random.Generator
) -> tuple[Int[Tensor, " r"], Float[Tensor, "r 2"]]:
    """Camera and place of randomly drawn pixels of an image, each once."""
    w, h = (int(side) for side in size_px)
    flat = random.choice(w * h, min(count, w * h), replace=False)
    row, column = np.divmod(np.sort(flat), w)
    place = torch.from_numpy(np.stack([column + 0.5, row + 0.5], 1)).float()
    return torch.full((len(flat),), i), place


def _seen_together(
    xyz: Float[np.ndarray, "n 3"], view: Int[np.ndarray, " n"], footprint: Float[np.ndarray, " n"]
) -> tuple[Bool[np.ndarray, " n"], Float[np.ndarray, " k"]]:
    """Which points have neighbours near for their distance, of further views; and how those that have
    scatter about the plane through their neighbours."""
    if len(xyz) <= NEIGHBOURS:
        return np.zeros(len(xyz), bool), np.zeros(0)
    apart, near = cKDTree(xyz).query(xyz, k=NEIGHBOURS + 1, workers=-1)
    relative = apart[:, -1] / footprint
    use = relative <= LONELY * np.median(relative)
    use &= (view[near[:, 1:]] != view[:, None]).any(1)
    around = xyz[near[use]]
    around -= around.mean(1, keepdims=True)
    variance = np.linalg.eigvalsh(np.einsum("kni,knj->kij", around, around) / NEIGHBOURS)[:, 0]
    return use, np.sqrt(np.maximum(variance, 0))
