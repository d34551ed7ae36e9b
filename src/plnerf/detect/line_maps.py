"""The thin lines of all images, each pixel of one with the plane in which the line lies in space.

A thin straight line in a posed image spans, with the camera's centre, a plane; whatever is seen as that line
lies in it.  Which directions lines have is not asked here: `directions.py` and `windows.py` do.

Letters: m ridge pixels of all views together.  Scene frame, float32.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields

import numpy as np
import torch
from jaxtyping import Bool, Float32, Int

from plnerf.detect.config_lines import LineMapConfig
from plnerf.detect.line_ridges import LineRidges, joined_ridges, steps_of
from plnerf.detect.line_samples import padded, strongest_across
from plnerf.detect.reduction import mean_of_blocks, reduction, valid_blocks
from plnerf.detect.ridges import Ridges, find_ridges
from plnerf.detect.views import Views
from plnerf.rays.rays import pixel_rays
from plnerf.scene.cameras import Cameras
from plnerf.scene.photos import Pictures


@dataclass(frozen=True, eq=False)
class LineMaps:
    """The pixels on thin lines, view after view."""

    view: Int[np.ndarray, " m"]
    """Index among the views."""
    pixel: Int[np.ndarray, " m"]
    """Row by row in its view's image."""
    response: Float32[np.ndarray, " m"]
    """0 to 1."""
    normal: Float32[np.ndarray, "m 3"]
    """Unit normal of the plane through the camera's centre and the line."""

    def of(self, keep: Bool[np.ndarray, " m"]) -> "LineMaps":
        """Some of the pixels."""
        return LineMaps(*(getattr(self, one.name)[keep] for one in fields(self)))


def line_maps(
    photos: Pictures,
    cameras: Cameras,
    images: tuple[int, ...],
    most_px: int,
    config: LineMapConfig,
    progress: Callable[[int], None] | None = None,
) -> LineMaps:
    """The thin lines in the chosen photos; none where pixels are masked out.

    most_px: photos whose longer side has more pixels are reduced to blocks (`reduction.py`), which count as
    pixels then.  progress: called with the number of photos done.
    """

    def one(view: int) -> LineMaps:
        i = images[view]
        picture = photos.image(i)
        k = reduction(picture.shape[:2], most_px)
        ridges = find_ridges(mean_of_blocks(picture, k), config.ridges)
        keep = middles(ridges, config)
        if photos.has_masks:
            keep &= valid_blocks(photos.valid(i), k)
        rows, columns = np.nonzero(keep)
        tangent = ridges.tangent_rad[rows, columns]
        at = np.stack([columns, rows], 1) + 0.5
        on = np.stack([np.cos(tangent), np.sin(tangent)], 1)
        camera = torch.full((len(at),), i)
        before, beyond = (
            pixel_rays(cameras, camera, torch.from_numpy(k * (at + side * on)).float())
            .directions.double()
            .numpy()
            for side in (-1, 1)
        )
        return LineMaps(
            np.full(len(rows), view),
            rows * keep.shape[1] + columns,
            ridges.strength[rows, columns],
            unit(np.cross(before, beyond)).astype(np.float32),
        )

    parts = []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for done, part in enumerate(pool.map(one, range(len(images))), 1):
            parts.append(part)
            if progress is not None:
                progress(done)
    return LineMaps(
        *(np.concatenate([getattr(part, one.name) for part in parts]) for one in fields(LineMaps))
    )


def middles(ridges: Ridges, config: LineMapConfig) -> Bool[np.ndarray, "h w"]:
    """The middles of lines: no stronger pixel beside them, and no stronger line of the other polarity near.

    A second derivative echoes beside a line with the other sign; twin conductors have the same sign.
    """
    signed = np.where(ridges.bright, ridges.strength, -ridges.strength)
    towards = np.stack([np.cos(ridges.tangent_rad), np.sin(ridges.tangent_rad)], -1)
    middle = np.empty(signed.shape, bool)
    picture, least = padded(signed, config.echo_px), np.float32(config.min_response)
    strongest_across(picture, towards, least, config.beside_px, config.echo_px, middle)
    return middle


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (m, 3) divided by their lengths."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)


def ridges_of(maps: LineMaps, views: Views, chosen: Int[np.ndarray, " k"]) -> LineRidges:
    """The pixels of some views, one view after the other, with the lines through them."""
    parts = []
    for n in chosen:
        here = slice(*np.searchsorted(maps.view, [n, n + 1]))
        count, pixel = int(views.sizes[n].prod()), maps.pixel[here]
        response, tangent = np.zeros(count, np.float32), np.zeros(count, np.uint8)
        across = maps.normal[here].astype(np.float64) @ views.R[n].T
        response[pixel] = maps.response[here]
        tangent[pixel] = steps_of(np.arctan2(across[:, 0], -across[:, 1]))
        parts.append(LineRidges(response, tangent))
    return joined_ridges(parts)
