"""The surfaces that a trained field shows, as the training cameras see them.

Pixels are drawn evenly over all training images; each gives the point at which half of its light has been
absorbed.  Rays that meet no surface, and points that stand alone or that one image alone shows, are left out.

Letters: n points, r rays, E edges of intervals along a ray.
"""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree
from torch import Tensor

from plnerf.line.frame import LineFrame
from plnerf.line.wire import Wire
from plnerf.rays.rays import pixel_rays
from plnerf.render.proposals import s_to_t
from plnerf.render.views import default_chunk
from plnerf.survey.config_ground import FieldConfig
from plnerf.survey.posed_photos import box_around, within
from plnerf.survey.surface import Surface
from plnerf.train.run import TrainedRun


def field_surface(
    run: TrainedRun,
    frame: LineFrame,
    wires: Sequence[Wire],
    config: FieldConfig,
    progress: Callable[[int, int], None] | None = None,
) -> Surface:
    """Points on the surfaces of a run's field, about as many as rays; the same for the same run.

    wires: those that were detected, around which nothing is background, however far from the cameras.
    Their standard deviations are how widely the field spreads a surface along the ray, and how much the views
    differ there.
    """
    scene, model = run.scene, run.model
    random = np.random.default_rng(0)
    each = max(1, config.rays // min(len(scene.train), config.most_sharing))
    places, colours, spreads, footprints, views, sights = [], [], [], [], [], []
    with torch.inference_mode():
        train = torch.tensor(scene.train, device=model.appearance.device)
        cameras = scene.cameras.to(train.device)
        for done, i in enumerate(scene.train):
            camera, pixel_px = _pixels(scene.cameras.size_px[i], i, each, random)
            bundle = pixel_rays(cameras, camera.to(train.device), pixel_px.to(train.device), model.backend)
            for first in range(0, len(bundle), default_chunk(model)):
                some = bundle[first : first + default_chunk(model)]
                out = model(some, appearance=model.mean_appearance(len(some), train))
                t = s_to_t(out.histograms[-1].s, model.sampler)
                spread = half_width(t, out.histograms[-1].w)
                use = out.accumulation >= config.min_accumulation
                use &= spread <= config.max_relative_sigma * out.depth_median
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
    box = box_around(frame.from_scene(scene.box.astype(np.float64)), wires)
    use = within(frame.from_scene(xyz), box, config.farthest)
    use[use], scatter = _seen_together(xyz[use], view[use], footprint[use], config)
    sigma = np.sqrt(along[use] ** 2 + scatter**2 + footprint[use] ** 2 / 12)
    rgb, sight = torch.cat(colours).numpy()[use], torch.cat(sights).double().numpy()[use]
    return Surface(frame.from_scene(xyz[use]), rgb, frame.from_scene(sigma), sight)  # axes are the scene's


def half_width(t: Float[Tensor, "r E"], w: Float[Tensor, "r E-1"]) -> Float[Tensor, " r"]:
    """Half the distance between the 16th and 84th percentile of a ray's light: the standard deviation where
    light is normally distributed."""
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
    """Camera and centre of randomly drawn pixels of an image, each once."""
    w, h = (int(side) for side in size_px)
    flat = random.choice(w * h, min(count, w * h), replace=False)
    row, column = np.divmod(np.sort(flat), w)
    place = torch.from_numpy(np.stack([column + 0.5, row + 0.5], 1)).float()
    return torch.full((len(flat),), i), place


def _seen_together(
    xyz: Float[np.ndarray, "n 3"],
    view: Int[np.ndarray, " n"],
    footprint: Float[np.ndarray, " n"],
    config: FieldConfig,
) -> tuple[Bool[np.ndarray, " n"], Float[np.ndarray, " k"]]:
    """Which points have near neighbours (for their distance from the cameras) from other views; and the
    standard deviations of the neighbours of those about a plane."""
    count = config.neighbours
    if len(xyz) <= count:
        return np.zeros(len(xyz), bool), np.zeros(0)
    apart, near = cKDTree(xyz).query(xyz, k=count + 1, workers=-1)
    relative = apart[:, -1] / footprint
    use = relative <= config.max_isolation * np.median(relative)
    use &= (view[near[:, 1:]] != view[:, None]).any(1)
    around = xyz[near[use]]
    around -= around.mean(1, keepdims=True)
    variance = np.linalg.eigvalsh(np.einsum("kni,knj->kij", around, around) / count)[:, 0]
    return use, np.sqrt(np.maximum(variance, 0))
