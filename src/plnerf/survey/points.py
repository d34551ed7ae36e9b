"""Points on wires, from a trained field: the depth it shows at the images' wire pixels, where it makes lines.

The same for every preset and free of any curve: pixels come from ridges of the training images, depths from
the field alone.  A wire pixel whose depth is wrong (the field has no wire there and shows what is behind)
ends up on a surface or alone, and is dropped by asking for a line of points seen from several views.

Letters: n points; lengths in the scene frame but for what is handed out, which is in the world frame.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree
from torch import Tensor

from plnerf.rays.rays import pixel_rays
from plnerf.render.images import default_chunk
from plnerf.render.proposals import to_distance
from plnerf.scene.scene import Scene
from plnerf.train.run import TrainedRun
from plnerf.wires.evidence import line_response, track_slope, vanishing_directions

MOST_PER_VIEW = 4000
WEAKEST = 0.2
"""Response of a pixel that may be a wire's."""
LEAST_SHARE = 0.4
"""Of a ray's light, that a thing must give to be there: a wire thinner than a pixel gives that part of it."""
THICK_PX = 8.0
"""Half the depth within which that light must come, in widths of the pixel there."""
AROUND_PX = 40.0
"""Radius of a neighbourhood across the span, in widths of a pixel at the typical distance."""
FEWEST_VIEWS, FEWEST_POINTS = 3, 8
LONGER = 3.0
"""How many times as far a neighbourhood reaches along the span as across."""
STRAIGHT = 0.3
"""Spread across a neighbourhood, as a share of that along it, below which it may hold lines; a surface that
fills it has 1/3."""
CORE, LEAST_IN_CORE = 0.25, 0.45
"""Share of a neighbourhood's points that lie near the line through a point, and how near, as a share of the
radius.  Of a single wire all do, of twin conductors half, of a surface no more than `CORE`."""
AXIS_DEG = 30.0
"""Angle to the span's axis within which a line may be a conductor."""


@dataclass(frozen=True)
class WirePoints:
    """n points on wires, world frame."""

    points: Float[np.ndarray, "n 3"]
    view: Int[np.ndarray, " n"]
    """Index of the image that saw each."""
    solid: Float[np.ndarray, " n"]
    """Share of the ray's light that comes from the point."""
    tried: int
    """Wire pixels that were looked at."""


def wire_points(run: TrainedRun, progress: Callable[[int, int], None] | None = None) -> WirePoints:
    """Points on wires that the run's field shows at wire pixels of its training images."""
    scene, model = run.scene, run.model
    slope = track_slope(scene.cameras.centre[list(scene.train)].double().numpy())
    places, views, shares, footprints = [], [], [], []
    with torch.inference_mode():
        train = torch.tensor(scene.train, device=model.appearance.device)
        for done, i in enumerate(scene.train):
            rays = pixel_rays(scene.cameras, *ridge_pixels(scene, i, slope), model.backend)
            for first in range(0, len(rays), default_chunk(model)):
                some = rays[first : first + default_chunk(model)].to(train.device)
                out = model(some, appearance=model.mean_appearance(len(some), train))
                t = to_distance(out.histograms[-1].s, model.config.sampler)
                depth, share = first_thing(t, out.histograms[-1].w, THICK_PX * some.radius)
                shares.append(share.cpu())
                places.append((some.origins + depth[:, None] * some.directions).cpu())
                views.append(np.full(len(some), i))
                footprints.append((some.radius * depth).cpu())
            if progress is not None:
                progress(done + 1, len(scene.train))
    points, view = torch.cat(places).double().numpy(), np.concatenate(views)
    light, footprint = torch.cat(shares).numpy(), torch.cat(footprints).numpy()
    low, high = scene.box
    inside = ((points > low - 0.1) & (points < high + 0.1)).all(1)
    use = (light > 0) & inside
    if use.any():
        radius = AROUND_PX * float(np.median(footprint[use]))
        use[use] = on_lines(points[use], view[use], radius)
    return WirePoints(scene.frames.to_world(points[use]), view[use], light[use], len(points))


def ridge_pixels(scene: Scene, i: int, slope: float) -> tuple[Int[Tensor, " r"], Float[Tensor, "r 2"]]:
    """Camera and place of the strongest ridges of an image that run as the span does."""
    picture = scene.images.image(i)
    response = line_response(picture, vanishing_directions(scene.cameras, i, picture.shape[:2], slope))
    response = np.where(scene.images.valid(i), response, 0)
    flat = np.flatnonzero(response > WEAKEST)
    flat = flat[np.argsort(-response.flat[flat], kind="stable")][:MOST_PER_VIEW]
    row, column = np.divmod(flat, picture.shape[1])
    place = torch.from_numpy(np.stack([column + 0.5, row + 0.5], 1)).float()
    return torch.full((len(flat),), i), place


def first_thing(
    t: Float[Tensor, "r E"], w: Float[Tensor, "r E-1"], thick: Float[Tensor, " r"]
) -> tuple[Float[Tensor, " r"], Float[Tensor, " r"]]:
    """Depth of the first thing on each ray, and the share of the ray's light that comes from it.

    The first interval that has `LEAST_SHARE` of the light within `thick` times its depth around it; its depth
    is the mean of that light's.  Where there is none, depth and share are 0.
    """
    middle = (t[:, 1:] + t[:, :-1]) / 2
    near = (middle[:, :, None] - middle[:, None, :]).abs() <= (thick[:, None] * middle)[..., None]
    light = (near * w[:, None, :]).sum(2)
    enough = light >= LEAST_SHARE
    first = enough.to(torch.uint8).argmax(1, keepdim=True)  # of equals the first
    share = torch.where(enough.any(1), light.gather(1, first)[:, 0], 0)
    mine = near.gather(1, first[..., None].expand(-1, -1, near.shape[2]))[:, 0] * w
    return torch.where(share > 0, (mine * middle).sum(1) / share.clamp_min(LEAST_SHARE), 0), share


def on_lines(
    points: Float[np.ndarray, "n 3"], view: Int[np.ndarray, " n"], radius: float
) -> Bool[np.ndarray, " n"]:
    """Which points have neighbours of several views on a line along the span, and few beside it."""
    squeezed = points / [LONGER, 1, 1]
    tree = cKDTree(squeezed)
    keep = np.zeros(len(points), dtype=bool)
    least = np.cos(np.deg2rad(AXIS_DEG))
    for first in range(0, len(points), 4096):
        part = slice(first, min(first + 4096, len(points)))
        for n, near in zip(
            range(part.start, part.stop), tree.query_ball_point(squeezed[part], radius), strict=True
        ):
            if len(near) < FEWEST_POINTS:
                continue
            middle = points[near].mean(0)
            spread, axes = np.linalg.eigh((points[near] - middle).T @ (points[near] - middle))
            if spread[1] >= STRAIGHT**2 * spread[2] or abs(axes[0, 2]) <= least:
                continue
            core = np.linalg.norm(np.cross(points[near] - points[n], axes[:, 2]), axis=1) < CORE * radius
            keep[n] = (
                core.mean() >= LEAST_IN_CORE
                and core.sum() >= FEWEST_POINTS
                and len(np.unique(view[near][core])) >= FEWEST_VIEWS
            )
    return keep
