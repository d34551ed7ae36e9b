"""Whether a wire stands out in the images more often than what lies beside it.

Where the ground is rough, a bar is found on it at one place in ten, and a curve that left its wire gathers
those that lie near to it: they agree with it, since others do not count.  Tracks beside the wire gather as
many.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Float32

from plnerf.survey.posed_photos import Photos
from plnerf.survey.refine.config import RefineConfig
from plnerf.survey.refine.profiles import grey_picture, measure_profiles
from plnerf.survey.refine.projection import Projection

SIDES = (0.0, -1.0, 1.0)
"""The wire, and what is to both of its sides."""


def stands_out(
    photos: Photos,
    project: Callable[[int], list[Projection]],
    diameters: Sequence[float],
    blur_px: float,
    config: RefineConfig,
) -> Float[np.ndarray, " w"]:
    """How many times as often each wire stands out near to its curve as what is beside it; infinite where
    less can be measured to both of its sides together than on it.

    project: all wires in the n-th training image.
    """

    def count(n: int) -> Float[np.ndarray, "w 3 2"]:
        grey, valid = grey_picture(photos, photos.train[n])
        seen, counts = project(n), []
        for w, (one, diameter) in enumerate(zip(seen, diameters, strict=True)):
            for side, others in zip(SIDES, (seen[:w] + seen[w + 1 :], seen, seen), strict=True):
                track = _beside(one, side, diameter, grey.shape[::-1], config)
                counts.append(_near(grey, valid, track, others, (diameter, blur_px), config))
        return np.array(counts).reshape(-1, len(SIDES), 2)

    with ThreadPoolExecutor() as pool:
        counts = sum(pool.map(count, range(len(photos.train))))
    near, measured = np.moveaxis(np.asarray(counts), 2, 0)
    sides = measured[:, 1:].sum(1)
    own = near[:, 0] / np.maximum(measured[:, 0], 1)
    beside = (near[:, 1:].sum(1) + 1) / np.maximum(sides, 1)  # one more, so that none is not infinitely less
    return np.where(sides >= np.maximum(measured[:, 0], 1), own / beside, np.inf)


def _beside(
    seen: Projection, side: float, diameter_m: float, size_px: Sequence[int], config: RefineConfig
) -> Projection:
    """A track beside a wire, so far that its profiles hold nothing of the wire.  size_px: the image's."""
    away = 2 * config.profile.window_px + diameter_m * np.linalg.norm(seen.by_yz, axis=1)
    pixel = seen.pixel + side * away[:, None] * seen.normal
    inside = ((pixel > 0) & (pixel < np.array(size_px))).all(1)
    return replace(seen, pixel=pixel, good=seen.good & inside)


def _near(
    grey: Float32[np.ndarray, "h w"],
    valid: Bool[np.ndarray, "h w"] | None,
    track: Projection,
    others: list[Projection],
    widths: tuple[float, float],
    config: RefineConfig,
) -> tuple[float, float]:
    """At how many places of a track something stands out near to it, and of how many.

    widths: the wire's diameter and the image's blur.
    """
    diameter_m, blur_px = widths
    found = measure_profiles(grey, valid, track, others, blur_px, diameter_m, config.profile)
    visible = np.abs(found.A) > config.adjust.visible * np.sqrt(found.variance_A)
    near = np.abs(found.B[visible]) <= config.near_px * np.abs(found.A[visible])
    return float(near.sum()), float(len(found))
