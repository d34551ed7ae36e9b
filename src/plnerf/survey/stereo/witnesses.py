"""How many images see a thing where a point is, and how many see past it.

A wrong match puts points into the air that a few images agree on, since both images of a pair make the same
mistake, and those taken beside them.  All other images whose depth maps reach that place see what lies behind
it, which no plant there would let them see.  (P. Merrell et al., "Real-time visibility-based fusion of depth
maps", ICCV 2007.)

Letters: n points, k cells of a window.  LineFrame.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from plnerf.line.cloud import GROUND, NO_WIRE, NOISE, NOT_JUDGED, TOWER, Cloud
from plnerf.ops.cpu_arrays import usable_cores
from plnerf.ops.kernel_cache import njit
from plnerf.survey.stereo.config import WitnessConfig
from plnerf.survey.stereo.depth import DepthMap
from plnerf.survey.stereo.stereo_views import View

EVERY_PX = 2
"""One of so many rows and columns of a depth map is kept: a survey holds those of all images at once."""
CHUNK = 20_000
"""Points in work at a time, which bounds memory."""
BORDER = 5
"""Pixels on each side of an image through which rays tell how wide its view is,"""
SPARE_RAD = 0.02
"""and by how much wider it may be between these."""


@dataclass(frozen=True, eq=False)
class Sight:
    """An image's depth map, as kept to judge points by it."""

    view: View
    t: Float[np.ndarray, "h w"]
    """Distances along the rays of every EVERY_PX-th row and column; NaN where the image is silent."""
    sigma: Float[np.ndarray, "h w"]
    image: int = -1
    """Index of the image among the photos; -1: unknown."""

    @classmethod
    def of(cls, view: View, depths: DepthMap, image: int = -1) -> "Sight":
        """Of a view's depth map."""
        t, sigma = (
            np.ascontiguousarray(one[::EVERY_PX, ::EVERY_PX], np.float32) for one in (depths.t, depths.sigma)
        )
        return cls(view, t, sigma, image)


def with_witnesses(cloud: Cloud, sights: Sequence[Sight], config: WitnessConfig) -> Cloud:
    """The cloud with how many images see a thing at each point, and past it; as it was without images.

    Each number is the median of those of the points around that are the same thing as far as deviations tell:
    one point of many that a few more images see makes no thing of them.
    Ground is not judged, nor what lies on wires, which depth maps leave out, nor the line's structures.
    """
    if not sights:
        return cloud
    judge = np.flatnonzero((cloud.wire == NO_WIRE) & ~np.isin(cloud.label, (GROUND, TOWER, NOISE)))
    seen, past = (np.full(len(cloud.xyz), NOT_JUDGED) for _ in range(2))
    points = cloud.xyz[judge]
    sigma = np.zeros(len(judge)) if cloud.sigma_m is None else cloud.sigma_m[judge]
    near = _alike(points, config.sigmas * sigma, config.alike)
    for mine, counts in zip((seen, past), witnesses(points, sigma, sights, config), strict=True):
        of_near = np.where(near >= 0, counts[near], np.nan) if len(counts) else np.zeros((0, 1))
        mine[judge] = np.nanmedian(of_near, axis=1)  # rounded down
    return replace(cloud, seen=seen, past=past)


def _alike(
    points: Float[np.ndarray, "n 3"], radius: Float[np.ndarray, " n"], count: int
) -> Int[np.ndarray, "n k"]:
    """Indices of so many nearest points within each one's radius, itself the first; -1 where there are
    fewer."""
    if not len(points):
        return np.zeros((0, 1), np.int64)
    apart, near = cKDTree(points).query(points, k=min(count, len(points)), workers=-1)
    apart, near = apart.reshape(len(points), -1), near.reshape(len(points), -1)  # k = 1 drops the axis
    return np.where(apart <= radius[:, None], near, -1)


def witnesses(
    points: Float[np.ndarray, "n 3"],
    sigma_m: Float[np.ndarray, " n"],
    sights: Sequence[Sight],
    config: WitnessConfig,
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Numbers of images that see a thing at each point, and that see past it.

    An image whose window around the point has few depths, or shows something before it, is neither.  Images
    that all see it from about the same direction count as one.
    """
    # One after another along the line, so that most images of a long one see nothing of a part.
    along = np.ptp(points[:, :2], axis=0).argmax() if len(points) else 0
    order = np.argsort(points[:, along], kind="stable")
    parts = [order[first : first + CHUNK] for first in range(0, len(points), CHUNK)]
    half_angles = [_half_angle(sight.view) for sight in sights]

    def counted(part: Int[np.ndarray, " _"]) -> tuple[Int[np.ndarray, " _"], Int[np.ndarray, " _"]]:
        seen, past = (np.zeros(len(part), np.int64) for _ in range(2))
        first, cosine = np.zeros((len(seen), 3)), np.ones(len(seen))  # of the angle to the farthest from it
        box = points[part].min(0), points[part].max(0)
        for sight, half_angle in zip(sights, half_angles, strict=True):
            if not _may_see(sight.view, half_angle, *box):
                continue
            index, at, beyond = judged(points[part], sigma_m[part], sight, config)
            here = index[at]
            ray = points[part][here] - sight.view.centre
            ray /= np.linalg.norm(ray, axis=1, keepdims=True)
            new = seen[here] == 0
            first[here[new]] = ray[new]
            cosine[here] = np.minimum(cosine[here], (first[here] * ray).sum(1))
            seen[here] += 1
            past[index[beyond]] += 1
        alone = (seen > 1) & (cosine > np.cos(np.radians(config.least_deg)))
        seen[alone] = 1
        return seen, past

    with ThreadPoolExecutor(usable_cores()) as pool:
        found = list(pool.map(counted, parts))
    seen, past = (np.zeros(len(points), np.int64) for _ in range(2))
    for part, counts in zip(parts, found, strict=True):
        seen[part], past[part] = counts
    return seen, past


def _half_angle(view: View) -> float:
    """Largest angle between the axis of a view and a ray through the border of its image."""
    x, y = np.linspace(0, view.width, BORDER), np.linspace(0, view.height, BORDER)
    border = [
        *(np.stack([x, np.full(BORDER, at)], 1) for at in (0.0, float(view.height))),
        *(np.stack([np.full(BORDER, at), y], 1) for at in (0.0, float(view.width))),
    ]
    cosine = float((view.directions(np.concatenate(border)) @ view.axis).min())
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)))


def _may_see(
    view: View, half_angle: float, low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"]
) -> bool:
    """Whether a view may show anything of what is between two corners: by the sphere around it."""
    away, radius = (low + high) / 2 - view.centre, float(np.linalg.norm(high - low)) / 2
    distance = float(np.linalg.norm(away))
    if distance <= radius or half_angle >= np.pi / 2:
        return True
    angle = float(np.arccos(np.clip(away @ view.axis / distance, -1.0, 1.0)))
    return angle - float(np.arcsin(radius / distance)) <= half_angle + SPARE_RAD


def judged(
    points: Float[np.ndarray, "n 3"], sigma_m: Float[np.ndarray, " n"], sight: Sight, config: WitnessConfig
) -> tuple[Int[np.ndarray, " _"], Bool[np.ndarray, " _"], Bool[np.ndarray, " _"]]:
    """Which points an image has inside of it; of these, at which it sees a thing, and past which it sees."""
    pixels, inside = sight.view.project(points)
    index = np.flatnonzero(inside)
    distance = np.linalg.norm(points[index] - sight.view.centre, axis=1)
    at, beyond = (np.zeros(len(index), np.bool_) for _ in range(2))
    shares = (config.min_known, config.min_share)
    scale = config.window_cells, float(sight.view.focal_px.mean()), config.sigmas
    given = (pixels[index], distance, sigma_m[index])
    _judge(*given, sight.t, sight.sigma, scale, shares, (at, beyond))
    return index, at, beyond


@njit(cache=True, error_model="numpy", nogil=True)
@no_type_check
def _judge(pixels, distance, sigma_m, t, sigma, scale, shares, out):
    """Into out two (n,): whether an image sees a thing at a point, and whether it sees past it.

    pixels (n, 2) and distance (n,) are the points' in the image; t, sigma: its depth map.
    """
    cells, focal_px, sigmas = scale
    rows, columns = t.shape
    side = 2 * cells + 1
    for k in range(len(pixels)):
        column, row = int(pixels[k, 0] / EVERY_PX), int(pixels[k, 1] / EVERY_PX)
        # What a window mixes lies as far before and behind as it reaches sideways.
        wide = (cells + 0.5) * EVERY_PX * distance[k] / focal_px
        known, near, past = 0, 0, 0
        for i in range(-cells, cells + 1):
            y = min(max(row + i, 0), rows - 1)
            for j in range(-cells, cells + 1):
                x = min(max(column + j, 0), columns - 1)
                if np.isnan(t[y, x]):
                    continue
                known += 1
                limit = sigmas * np.hypot(sigma[y, x], sigma_m[k]) + wide
                off = t[y, x] - distance[k]
                near += abs(off) <= limit
                past += off > limit
        enough = known >= shares[0] * side * side
        out[0][k] = enough and near >= shares[1] * known
        out[1][k] = enough and not out[0][k] and past >= (1 - shares[1]) * known
