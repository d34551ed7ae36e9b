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
from jaxtyping import Float, Int
from torch import Tensor

from plnerf.detect.evidence import line_response, track_slope, vanishing_directions
from plnerf.rays.rays import pixel_rays
from plnerf.render.images import default_chunk
from plnerf.render.proposals import to_distance
from plnerf.scene.scene import Scene
from plnerf.survey.collinear import in_long_pieces, on_lines
from plnerf.train.run import TrainedRun

MOST_PER_VIEW = 4000
WEAKEST = 0.2
"""Response of a pixel that may be a wire's."""
LEAST_SHARE = 0.25
"""Of a ray's light, that a thing must give to be there: a wire thinner than a pixel gives that part of it."""
THICK_PX = 8.0
"""Half the depth within which that light must come, in widths of the pixel there."""
AROUND_PX = 40.0
"""Radius of a neighbourhood across the span, in widths of a pixel at the typical distance."""


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
                t = to_distance(out.histograms[-1].s, model.sampler)
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
        use[use] = in_long_pieces(points[use], radius)
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
