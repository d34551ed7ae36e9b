"""Points on wires, from a trained field: the depths it shows at wire pixels, where they make lines.

The same for every preset and independent of any curve: pixels come from ridges of the training images, depths
from the field alone; of the wires that were detected, only the directions in which they run are used.  A wire
pixel whose depth is wrong (the field has no wire there and shows what lies behind) ends up on a surface or
alone, and is dropped because it is on no line that several views see.

Letters: n points, d directions, r rays, E edges of intervals along a ray.  Computed in the scene frame,
returned in the LineFrame, which has the same axes.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from plnerf.detect.evidence import line_response, vanishing
from plnerf.line.frame import LineFrame
from plnerf.line.survey import WirePoints
from plnerf.line.wire import Wire
from plnerf.rays.rays import pixel_rays
from plnerf.render.proposals import s_to_t
from plnerf.render.views import default_chunk
from plnerf.scene.cameras import Cameras
from plnerf.scene.scene import Scene
from plnerf.survey.collinear import in_long_pieces, on_lines
from plnerf.survey.config_wires import WirePointsConfig
from plnerf.train.run import TrainedRun

PLACES = 100
"""Along a wire, of which an image must show one for the wire to be looked for in it."""
ROOM = 0.25
"""Share of an image's size by which a place may lie outside of it."""


def wire_points(
    run: TrainedRun,
    frame: LineFrame,
    wires: Sequence[Wire],
    config: WirePointsConfig,
    progress: Callable[[int, int], None] | None = None,
) -> WirePoints:
    """Points on wires that the run's field shows at wire pixels of its training images; none without wires,
    since nothing says which way to look for them."""
    scene, model = run.scene, run.model
    groups = alike(wires, config.same_deg)
    directions = np.array([direction_of(group[0]) for group in groups]).reshape(-1, 3)
    chords = [
        frame.to_scene(
            np.concatenate([one.points(np.linspace(0, one.base.length_m, PLACES)) for one in group])
        )
        for group in groups
    ]
    places, views, shares, footprints = [], [], [], []
    with torch.inference_mode():
        train = torch.tensor(scene.train, device=model.appearance.device)
        cameras = scene.cameras.to(train.device)
        for done, i in enumerate(scene.train):
            shown = directions[np.array([_shows(scene.cameras, i, chord) for chord in chords], np.bool_)]
            camera, pixel_px = ridge_pixels(scene, i, shown, config)
            rays = pixel_rays(cameras, camera.to(train.device), pixel_px.to(train.device), model.backend)
            for first in range(0, len(rays), default_chunk(model)):
                some = rays[first : first + default_chunk(model)]
                out = model(some, appearance=model.mean_appearance(len(some), train))
                t, w = s_to_t(out.histograms[-1].s, model.sampler), out.histograms[-1].w
                depth, share = first_thing(t, w, config.depth_window_px * some.radius, config.min_share)
                shares.append(share.cpu())
                places.append((some.origins + depth[:, None] * some.directions).cpu())
                views.append(np.full(len(some), i))
                footprints.append((some.radius * depth).cpu())
            if progress is not None:
                progress(done + 1, len(scene.train))
    if not places:
        return WirePoints(np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(0), 0)
    points, view = torch.cat(places).double().numpy(), np.concatenate(views)
    light, footprint = torch.cat(shares).numpy(), torch.cat(footprints).numpy()
    low, high = scene.box
    inside = ((points > low - config.margin) & (points < high + config.margin)).all(1)
    use = (light > 0) & inside
    if use.any():
        radius = config.radius_px * float(np.median(footprint[use]))
        use[use] = along_any(points[use], view[use], radius, directions, config)
    return WirePoints(frame.from_scene(points[use]), view[use], light[use], len(points))


def alike(wires: Sequence[Wire], same_deg: float) -> list[list[Wire]]:
    """The wires by the directions in which they run, whichever end comes first; the longest of each first."""
    groups: list[list[Wire]] = []
    for wire in sorted(wires, key=lambda one: -one.base.length_m):
        own = direction_of(wire)
        for group in groups:
            if abs(own @ direction_of(group[0])) >= np.cos(np.radians(same_deg)):
                group.append(wire)
                break
        else:
            groups.append([wire])
    return groups


def direction_of(wire: Wire) -> Float[np.ndarray, "3"]:
    """Unit vector of its chord."""
    first, last = wire.points(np.array([0.0, wire.base.length_m]))
    along: Float[np.ndarray, 3] = (last - first) / np.linalg.norm(last - first)
    return along


def along_any(
    points: Float[np.ndarray, "n 3"],
    view: Int[np.ndarray, " n"],
    radius: float,
    directions: Float[np.ndarray, "d 3"],
    config: WirePointsConfig,
) -> Bool[np.ndarray, " n"]:
    """Which points are on a long line that runs in one of the directions."""
    found = np.zeros(len(points), np.bool_)
    for x, y, _ in directions:
        length = np.hypot(x, y)
        c, s = (x / length, y / length) if length else (1.0, 0.0)
        turned = points @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])  # x along the direction
        on = on_lines(turned, view, radius, config.collinear)
        on[on] = in_long_pieces(turned[on], radius, config.collinear)
        found |= on
    return found


def ridge_pixels(
    scene: Scene, i: int, directions: Float[np.ndarray, "d 3"], config: WirePointsConfig
) -> tuple[Int[Tensor, " r"], Float[Tensor, "r 2"]]:
    """Camera and centre of the strongest pixels on ridges of an image that run in one of the directions."""
    picture = scene.images.image(i)
    response = np.zeros(picture.shape[:2], np.float32)
    pixels = replace(config.evidence, most_px=max(picture.shape))  # all that the field was shown
    for direction in directions:
        lines = vanishing(scene.cameras, i, direction, pixels)
        np.maximum(response, line_response(picture, lines, pixels), out=response)
    response = np.where(scene.images.valid(i), response, 0)
    flat = np.flatnonzero(response > config.min_response)
    flat = flat[np.argsort(-response.flat[flat], kind="stable")][: config.max_per_view]
    row, column = np.divmod(flat, picture.shape[1])
    place = torch.from_numpy(np.stack([column + 0.5, row + 0.5], 1)).float()
    return torch.full((len(flat),), i), place


def _shows(cameras: Cameras, i: int, points: Float[np.ndarray, "n 3"]) -> bool:
    """Whether an image shows one of the points, if nothing hides it; lenses that distort are given room."""
    local = (points - cameras.centre[i].double().numpy()) @ cameras.R_scene_camera[i].double().numpy()
    ahead = local[local[:, 2] > 0]
    focal, principal, size = (
        value[i].double().numpy() for value in (cameras.focal_px, cameras.principal_px, cameras.size_px)
    )
    pixels = ahead[:, :2] / ahead[:, 2:] * focal + principal
    return bool((np.abs(pixels / size - 0.5) <= 0.5 + ROOM).all(1).any())


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
