"""The surfaces of a survey: what stereo shows of them, and the field's points where stereo is silent.

A radiance field of minutes is decimetres to metres off where its images, with their poses, say centimetres.

Letters: n points, m views, h x w pixels.
"""

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from plnerf.scene.scene import Scene
from plnerf.survey.stereo.depth import DepthMap, Picture, depth_map
from plnerf.survey.stereo.pairs import partners
from plnerf.survey.stereo.views import View, picture, view_of
from plnerf.survey.surface import RAYS, Surface, surface_points
from plnerf.train.run import TrainedRun

LEAST_SEEN = 20
"""Points of the field that a view must see, to tell how far away things are."""
MAPS = 2
"""So many depth maps that look at a place say what is there, and the field is not asked."""
LEAST_SHARE = 0.02
"""Of the pixels drawn, how many must have a depth: else there is no stereo to speak of."""


def survey_surface(
    run: TrainedRun, progress: Callable[[int, int], None] | None = None
) -> tuple[Surface, list[str]]:
    """Points on what a run's images show, and notes for a reader; the same for the same run."""
    told = progress or (lambda done, of: None)
    field = surface_points(run, progress=lambda done, of: told(done, 2 * of))
    return with_stereo(run.scene, field, progress=lambda done, of: told(of + done, 2 * of))


def with_stereo(
    scene: Scene, field: Surface, points: int = RAYS, progress: Callable[[int, int], None] | None = None
) -> tuple[Surface, list[str]]:
    """About `points` points of stereo, drawn evenly over the training images, and the field's where fewer than
    `MAPS` depth maps know what is there; the field alone, with a note, where images make no pairs."""
    views = [view_of(scene, i) for i in scene.train]
    of_field = scene.frames.to_scene(field.xyz)
    distance = typical_distances(views, of_field)
    chosen = partners(views, distance)
    random = np.random.default_rng(0)
    each = max(1, points // len(views))
    known = np.zeros(len(of_field), np.int64)
    places, colours, sigmas, sights = [], [], [], []
    for k, (view, others) in enumerate(zip(views, chosen, strict=True)):
        if len(others) >= 2:
            mine, rgb = _picture(scene, scene.train[k], view)
            there = (_picture(scene, scene.train[j], views[j])[0] for j in others)
            depths = depth_map(mine, list(there), float(distance[k]))
            known += _knows(depths, view, of_field)
            at = _pixels(depths, each, random)
            places.append(view.centre + depths.t[at][:, None] * view.rays[at])
            colours.append(rgb[at])
            sigmas.append(depths.sigma[at])
            sights.append(view.rays[at])
        if progress is not None:
            progress(k + 1, len(views))
    found = sum(len(some) for some in places)
    if found < LEAST_SHARE * points:
        return field, [
            f"The images make no stereo ({sum(len(others) > 1 for others in chosen)} of {len(views)} have two "
            "partners that look the same way from beside them): ground, plants and supports are the field's "
            "alone, which may be metres off."
        ]
    silent = known < MAPS
    frames = scene.frames
    return Surface(
        np.concatenate([frames.to_world(np.concatenate(places)), field.xyz[silent]]),
        np.concatenate([*colours, field.rgb[silent]]),
        np.concatenate([np.concatenate(sigmas) / frames.scale, field.sigma[silent]]),
        np.concatenate([np.concatenate(sights) @ frames.R_scene_world, field.sight[silent]]),
    ), []


def typical_distances(views: Sequence[View], points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " m"]:
    """The median distance of the points that each view has in its image; NaN where they are few."""
    found = np.full(len(views), np.nan)
    for k, view in enumerate(views):
        _, inside = view.project(points)
        if inside.sum() >= LEAST_SEEN:
            found[k] = np.median(np.linalg.norm(points[inside] - view.centre, axis=1))
    return found


def _picture(scene: Scene, i: int, view: View):
    rgb, valid = picture(scene, i)
    return Picture(view, cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.uint8), valid), rgb


def _knows(depths: DepthMap, view: View, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """Which points are seen at a pixel that has a depth."""
    pixels, inside = view.project(points)
    column, row = pixels[inside].astype(np.int64).T
    inside[inside] = np.isfinite(depths.t[row, column])
    return inside


def _pixels(
    depths: DepthMap, each: int, random: np.random.Generator
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Rows and columns of those of `each` pixels of the image, drawn at random, that have a depth."""
    drawn = random.choice(depths.t.size, min(each, depths.t.size), replace=False)
    row, column = np.divmod(np.sort(drawn), depths.t.shape[1])
    use = np.isfinite(depths.t[row, column])
    return row[use], column[use]
