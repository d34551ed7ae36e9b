"""Whether what is seen beside a line lies where the line lies, or far behind it.

An edge of a road, a furrow, the shadow of a wire: what is beside them is on the same surface, and two views
agree on it wherever they look from.  What is seen beside a wire lies behind it, and moves when the camera
does.  So views are compared in strips to both sides of a line, as if these were level or upright: their
correlation is near 1 for a line on a surface and near 0 for one in the air.

Letters: n views; a line's stretch in g segments of q places, o strips beside it; x, y, z of a window's frame.
"""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import no_type_check

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

from plnerf.detect.candidate import Candidate
from plnerf.detect.config import CertaintyConfig
from plnerf.detect.config_lines import SurroundingsConfig
from plnerf.detect.parabola import curve_points
from plnerf.detect.reduction import mean_of_blocks, reduction
from plnerf.detect.to_wire import typical_footprint
from plnerf.detect.views import Views, project_point
from plnerf.ops.kernel_cache import njit
from plnerf.scene.photos import Pictures

SURFACES = (np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]))
"""Across a line on a level surface, and on an upright one."""


class Surroundings:
    """The training photos in grey, each read when a line that its view may show is first asked about."""

    def __init__(
        self, photos: Pictures, images: Sequence[int], most_px: int, config: SurroundingsConfig
    ) -> None:
        self._photos, self._images, self._most_px, self._config = photos, images, most_px, config
        self._kept: dict[int, UInt8[np.ndarray, "H W"]] = {}

    def likeness(
        self,
        line: Candidate,
        views: Views,
        numbers: Int[np.ndarray, " n"],
        x: Float[np.ndarray, " i"],
        certainty: CertaintyConfig,
    ) -> float:
        """Mean correlation of views beside a line, -1 to 1; NaN where too few of them can be compared.

        Each place counts alike, however many views show it: most views see the tower at a wire's end, or one
        clear tree behind it.

        views: those of a window, in its frame; numbers: theirs among all training photos; x: planes of the
        fit.
        """
        config, pictures = self._config, self._grey(numbers)
        footprint = typical_footprint(views, line.theta, x, certainty)
        points = _places(line, x, footprint, config)
        comparable = _from_other_sides(points[:, config.places // 2], views, config)
        means = []
        for across in SURFACES:
            beside = points[:, :, None] + footprint * np.outer(config.strips_px, across)
            strips = [
                _strips(picture, views, n, beside, footprint, config) for n, picture in enumerate(pictures)
            ]
            alike = np.einsum("ngd,mgd->gnm", strips, strips)
            pairs = comparable & np.isfinite(alike)
            number = pairs.sum((1, 2))
            known = number > 0
            if number.sum() >= config.least_pairs and known.mean() >= config.least_share:
                means.append(float((np.where(pairs, alike, 0).sum((1, 2))[known] / number[known]).mean()))
        return max(means, default=np.nan)

    def _grey(self, numbers: Int[np.ndarray, " n"]) -> list[UInt8[np.ndarray, "H W"]]:
        """Those of some photos, which are the only ones kept."""

        def read(number: int) -> UInt8[np.ndarray, "H W"]:
            photo = self._photos.image(self._images[number])
            k = reduction((photo.shape[1], photo.shape[0]), self._most_px)
            grey: UInt8[np.ndarray, "H W"] = cv2.cvtColor(mean_of_blocks(photo, k), cv2.COLOR_RGB2GRAY)
            return grey

        missing = [int(number) for number in numbers if int(number) not in self._kept]
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            self._kept.update(zip(missing, pool.map(read, missing), strict=True))
        self._kept = {int(number): self._kept[int(number)] for number in numbers}
        return list(self._kept.values())


def _places(
    line: Candidate, x: Float[np.ndarray, " i"], footprint: float, config: SurroundingsConfig
) -> Float[np.ndarray, "g q 3"]:
    """Places on the stretch that was seen."""
    low, high = (float(x[plane]) for plane in line.seen)
    segments = int((high - low) / (config.step_px * footprint * config.places))
    segments = min(max(segments, 1), config.most_segments)
    along = np.linspace(low, high, segments * config.places)
    y, z = curve_points(line.theta, (along - x[0]) / (x[-1] - x[0]))
    return np.stack([along, y, z], 1).reshape(segments, config.places, 3)


def _from_other_sides(
    middles: Float[np.ndarray, "g 3"], views: Views, config: SurroundingsConfig
) -> Bool[np.ndarray, "g n n"]:
    """Which pairs of views, each once, look at a segment from directions that differ across the line."""
    dy, dz = np.moveaxis(middles[:, None, 1:] - views.centre[:, 1:], -1, 0)
    angle = np.arctan2(dy, dz)
    turn = (angle[:, :, None] - angle[:, None] + np.pi) % (2 * np.pi) - np.pi
    return (turn >= config.least_angle_rad) & (turn <= config.greatest_angle_rad)


def _strips(
    picture: UInt8[np.ndarray, "H W"],
    views: Views,
    n: int,
    points: Float[np.ndarray, "g q o 3"],
    footprint: float,
    config: SurroundingsConfig,
) -> Float32[np.ndarray, "g d"]:
    """Grey levels of a view beside each segment, of mean 0 along each strip and of length 1.

    NaN where the view does not show the whole segment, shows it from too far, or sees no texture.  What runs
    along the line, as other wires do, is left out with each strip's mean.
    """
    column, row, depth = projected(views, n, points.reshape(-1, 3)).reshape(3, *points.shape[:-1])
    seen = (depth > 0) & (depth <= config.coarsest * footprint * views.focal[n, 0])
    flat = (len(points), -1)
    shades = cv2.remap(
        picture, column.reshape(flat).astype(np.float32) - 0.5, row.reshape(flat).astype(np.float32) - 0.5,
        cv2.INTER_LINEAR,
    ).reshape(depth.shape).astype(np.float32)  # fmt: skip
    shades = (shades - shades.mean(1, keepdims=True)).reshape(flat)
    shades[~seen.reshape(flat).all(1)] = np.nan
    contrast = np.sqrt((shades**2).mean(1, keepdims=True))
    with np.errstate(invalid="ignore"):
        return np.where(
            contrast >= config.least_contrast, shades / (contrast * shades.shape[1] ** 0.5), np.nan
        )


@njit(cache=True, error_model="numpy")
@no_type_check
def projected(views, n, points):
    """Column, row and depth of points (m, 3); depth -1 where one is not in the image: (3, m)."""
    out = np.empty((3, len(points)))
    for m in range(len(points)):
        out[0, m], out[1, m], out[2, m] = project_point(views, n, points[m, 0], points[m, 1], points[m, 2])
    return out
