"""Points on wires, from a trained field: the depths it shows at wire pixels, where they make lines.

The same for every preset and independent of any curve: pixels come from ridges of the training images, depths
from the field alone.  A wire pixel whose depth is wrong (the field has no wire there and shows what lies
behind) ends up on a surface or alone, and is dropped because it is on no line that several views see.

Letters: n points, r rays, E edges of intervals along a ray.  Computed in the scene frame, returned in the
LineFrame.
"""

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from plnerf.detect.evidence import line_response, track_slope, vanishing_directions
from plnerf.line.frame import LineFrame
from plnerf.line.survey import WirePoints
from plnerf.rays.rays import pixel_rays
from plnerf.render.proposals import s_to_t
from plnerf.render.views import default_chunk
from plnerf.scene.scene import Scene
from plnerf.survey.collinear import in_long_pieces, on_lines
from plnerf.survey.config_wires import WirePointsConfig
from plnerf.train.run import TrainedRun


def wire_points(
    run: TrainedRun,
    frame: LineFrame,
    config: WirePointsConfig,
    progress: Callable[[int, int], None] | None = None,
) -> WirePoints:
    """Points on wires that the run's field shows at wire pixels of its training images."""
    scene, model = run.scene, run.model
    slope = track_slope(scene.cameras.centre[list(scene.train)].double().numpy())
    places, views, shares, footprints = [], [], [], []
    with torch.inference_mode():
        train = torch.tensor(scene.train, device=model.appearance.device)
        for done, i in enumerate(scene.train):
            rays = pixel_rays(scene.cameras, *ridge_pixels(scene, i, slope, config), model.backend)
            for first in range(0, len(rays), default_chunk(model)):
                some = rays[first : first + default_chunk(model)].to(train.device)
                out = model(some, appearance=model.mean_appearance(len(some), train))
                t, w = s_to_t(out.histograms[-1].s, model.sampler), out.histograms[-1].w
                depth, share = first_thing(t, w, config.depth_window_px * some.radius, config.min_share)
                shares.append(share.cpu())
                places.append((some.origins + depth[:, None] * some.directions).cpu())
                views.append(np.full(len(some), i))
                footprints.append((some.radius * depth).cpu())
            if progress is not None:
                progress(done + 1, len(scene.train))
    points, view = torch.cat(places).double().numpy(), np.concatenate(views)
    light, footprint = torch.cat(shares).numpy(), torch.cat(footprints).numpy()
    low, high = scene.box
    inside = ((points > low - config.margin) & (points < high + config.margin)).all(1)
    use = (light > 0) & inside
    if use.any():
        radius = config.radius_px * float(np.median(footprint[use]))
        use[use] = on_lines(points[use], view[use], radius, config.collinear)
        use[use] = in_long_pieces(points[use], radius, config.collinear)
    return WirePoints(frame.from_scene(points[use]), view[use], light[use], len(points))


def ridge_pixels(
    scene: Scene, i: int, slope: float, config: WirePointsConfig
) -> tuple[Int[Tensor, " r"], Float[Tensor, "r 2"]]:
    """Camera and centre of the strongest pixels on ridges of an image that run as the span does."""
    picture = scene.images.image(i)
    towards = vanishing_directions(scene.cameras, i, picture.shape[:2], slope)
    response = line_response(picture, towards, config.evidence)
    response = np.where(scene.images.valid(i), response, 0)
    flat = np.flatnonzero(response > config.min_response)
    flat = flat[np.argsort(-response.flat[flat], kind="stable")][: config.max_per_view]
    row, column = np.divmod(flat, picture.shape[1])
    place = torch.from_numpy(np.stack([column + 0.5, row + 0.5], 1)).float()
    return torch.full((len(flat),), i), place


def first_thing(
    t: Float[Tensor, "r E"], w: Float[Tensor, "r E-1"], thick: Float[Tensor, " r"], min_share: float
) -> tuple[Float[Tensor, " r"], Float[Tensor, " r"]]:
    """Depth of the first thing on each ray, and the share of the ray's light that comes from it.

    The first interval with `min_share` of the light within `thick` times its depth around it; its depth is
    the mean of that light's.  Where there is none, depth and share are 0.
    """
    middle = (t[:, 1:] + t[:, :-1]) / 2
    near = (middle[:, :, None] - middle[:, None, :]).abs() <= (thick[:, None] * middle)[..., None]
    light = (near * w[:, None, :]).sum(2)
    enough = light >= min_share
    first = enough.to(torch.uint8).argmax(1, keepdim=True)  # of equals the first
    share = torch.where(enough.any(1), light.gather(1, first)[:, 0], 0)
    mine = near.gather(1, first[..., None].expand(-1, -1, near.shape[2]))[:, 0] * w
    return torch.where(share > 0, (mine * middle).sum(1) / share.clamp_min(min_share), 0), share
