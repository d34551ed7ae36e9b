"""The surfaces of a survey: what stereo shows of them; of wires, which stereo smears, what the field shows.

A field trained for minutes is decimetres to metres off where its images, with their poses, say centimetres to
decimetres, so that none of its other points is kept: most would lie before or behind what stereo shows.

Letters: n points, m views, h x w pixels.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from plnerf.detect.curves import Curve
from plnerf.scene.scene import Scene
from plnerf.survey.field_surface import RAYS, Surface, within
from plnerf.survey.stereo.consistency import confirmed
from plnerf.survey.stereo.depth import BLOCK_PX, SIGMA_PX, DepthMap, Picture, depth_map
from plnerf.survey.stereo.pairs import partners
from plnerf.survey.stereo.views import View, picture, view_of

LEAST_SEEN = 20
"""Points of the field that a view must see, to tell how far away things are."""
NEARER = 0.15
"""Quantile of a view's distances that stands for what is near."""
LEAST_SHARE = 0.02
"""Of the pixels drawn, how many must have a depth: else there is no stereo to speak of."""
EDGE_PX = BLOCK_PX / 2
"""Where a thing ends is known to half a block: leaves outside of a crown are smaller."""
WIRE_PX = BLOCK_PX
"""Pixels this near to a projected curve are left out: one wire is matched with another."""
CURVE_PLACES = 2000
COMPANY = 10
"""Points that another image of the same thing would have, all of its pixels matched, within the distance at
which a point's confirmation is looked for."""


def with_stereo(
    scene: Scene,
    field: Surface,
    curves: Sequence[Curve],
    points: int = RAYS,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Surface, list[str]]:
    """Points of stereo at those of `points` pixels, drawn evenly from the training images, that have a depth,
    and the field's on the curves; all of the field, with a note, where the images make no pairs."""
    views = [view_of(scene, i) for i in scene.train]
    of_field = scene.frames.to_scene(field.xyz)
    far, near = distances(views, of_field).T
    # What is near needs images that are near to one another, what is far others.
    chosen = [
        tuple(dict.fromkeys((*some, *more)))
        for some, more in zip(partners(views, far), partners(views, near), strict=True)
    ]
    random = np.random.default_rng(0)
    each = max(1, points // len(views))
    places, colours, sigmas, sights, images, radii = [], [], [], [], [], []
    for k, (view, others) in enumerate(zip(views, chosen, strict=True)):
        if len(others) >= 2:
            mine, rgb = _picture(scene, scene.train[k], view)
            there = (_picture(scene, scene.train[j], views[j])[0] for j in others)
            depths = depth_map(mine, list(there), float(near[k]))
            depths.t[shows_wires(view, curves)] = np.nan
            at = _pixels(depths, each, random)
            places.append(view.centre + depths.t[at][:, None] * mine.rays[at])
            colours.append(rgb[at])
            pixel = depths.t[at] / float(view.focal_px.mean())
            sigmas.append(np.hypot(depths.sigma[at], EDGE_PX * pixel))
            sights.append(mine.rays[at])
            images.append(np.full(len(at[0]), k))
            radii.append(depths.sigma[at] + np.sqrt(COMPANY * depths.t.size / (np.pi * each)) * pixel)
        if progress is not None:
            progress(k + 1, len(views))
    found = sum(len(some) for some in places)
    if found < LEAST_SHARE * points:
        return field, [
            f"The images make no stereo ({sum(len(others) > 1 for others in chosen)} of {len(views)} have "
            "two partners that look the same way from beside them): ground and plants are the field's alone, "
            "which may be metres off."
        ]
    wires, frames, met = _on_curves(of_field, curves), scene.frames, np.concatenate(places)
    kept = within(met, scene.box) & confirmed(met, np.concatenate(images), np.concatenate(radii))
    return Surface(
        np.concatenate([frames.to_world(met[kept]), field.xyz[wires]]),
        np.concatenate([np.concatenate(colours)[kept], field.rgb[wires]]),
        np.concatenate([np.concatenate(sigmas)[kept] / frames.scale, field.sigma[wires]]),
        np.concatenate([np.concatenate(sights)[kept] @ frames.R_scene_world, field.sight[wires]]),
    ), []


def loosened(surface: Surface, motion_px: float) -> Surface:
    """The same, less certain: both images of a pair lie so far off their poses."""
    return replace(surface, sigma=surface.sigma * np.hypot(1.0, np.sqrt(2) * motion_px / SIGMA_PX))


def shows_wires(view: View, curves: Sequence[Curve]) -> Bool[np.ndarray, "h w"]:
    """The pixels of an image near to a projected curve."""
    near = np.zeros((view.height, view.width), np.uint8)
    for curve in curves:
        pixel, inside = view.project(curve.points(np.linspace(*curve.ends, CURVE_PLACES)))
        column, row = pixel[inside].astype(int).T
        near[row, column] = 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * WIRE_PX + 1, 2 * WIRE_PX + 1))
    return cv2.dilate(near, disc) > 0


def _on_curves(points: Float[np.ndarray, "n 3"], curves: Sequence[Curve]) -> Bool[np.ndarray, " n"]:
    """Which points are as near to a curve as its conductor is looked for."""
    on = np.zeros(len(points), np.bool_)
    for curve in curves:
        low, high = curve.ends
        off = points - curve.points(points[:, 0])
        on |= (points[:, 0] >= low) & (points[:, 0] <= high) & (np.linalg.norm(off, axis=1) <= curve.reach)
    return on


def distances(views: Sequence[View], points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "m 2"]:
    """The median distance of the points that each view has in its image, and that of the nearer ones (their
    `NEARER` quantile); NaN where they are few."""
    found = np.full((len(views), 2), np.nan)
    for k, view in enumerate(views):
        _, inside = view.project(points)
        if inside.sum() >= LEAST_SEEN:
            apart = np.linalg.norm(points[inside] - view.centre, axis=1)
            found[k] = np.quantile(apart, [0.5, NEARER])
    return found


def _picture(scene: Scene, i: int, view: View) -> tuple[Picture, UInt8[np.ndarray, "h w 3"]]:
    """Image i for matching, and its colours."""
    rgb, valid = picture(scene, i)
    return Picture(view, cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.uint8), valid), rgb


def _pixels(
    depths: DepthMap, each: int, random: np.random.Generator
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Rows and columns of those of `each` pixels of the image, drawn at random, that have a depth."""
    drawn = random.choice(depths.t.size, min(each, depths.t.size), replace=False)
    row, column = np.divmod(np.sort(drawn), depths.t.shape[1])
    use = np.isfinite(depths.t[row, column])
    return row[use], column[use]
