"""Inverse distances that a pair of images shows, in both of them at once.

Both are resampled so that their rows match (`rectify.py`), and matched by semi-global matching (H.
Hirschmueller, "Stereo processing by semiglobal matching and mutual information", IEEE TPAMI 30(2), 2008;
OpenCV's StereoSGBM), which costs nearly all of the time.  The matcher gives the left image's disparities; the
right image's are the same ones, read at the other end.

Letters: w = 1/t inverse distance along a pixel's ray; b baseline; f pixels per radian; h x w pixels.
"""

from dataclasses import dataclass
from typing import no_type_check

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int16, UInt8

from plnerf.ops.kernel_cache import njit
from plnerf.survey.stereo.config import MatchConfig
from plnerf.survey.stereo.rectify import Sphere, angles, axes_about, disparity_at, inverse_distance_at
from plnerf.survey.stereo.stereo_views import Picture

STEPS = 16
"""The matcher's disparities are 16ths of a pixel, and their number is a multiple of 16."""


@dataclass(frozen=True, eq=False)
class Shown:
    """Inverse distances along the rays of one of a pair's images."""

    w: Float32[np.ndarray, "h w"]
    """1/t; NaN where there is no match."""
    sigma: Float32[np.ndarray, "h w"]
    """Its standard deviation."""


@dataclass(frozen=True, eq=False)
class _Side:
    """One of a pair's images, with the directions of its pixels in the pair's angles."""

    picture: Picture
    elevation: Float32[np.ndarray, "h w"]
    azimuth: Float32[np.ndarray, "h w"]
    seen: Bool[np.ndarray, "h w"]
    """Not too near to an epipole."""

    @classmethod
    def of(cls, picture: Picture, R: Float[np.ndarray, "3 3"], config: MatchConfig) -> "_Side":
        elevation, azimuth = angles(picture.view.camera_rays, R @ picture.view.R_line_camera)
        return cls(picture, elevation, azimuth, np.cos(elevation) >= config.min_sine)

    def reach(self, per_rad: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2 2"]:
        """The least and the greatest column and row of the pixels that are seen."""
        seen = [one[self.seen] for one in (self.elevation, self.azimuth)]
        return np.array([[one.min() for one in seen], [one.max() for one in seen]]) * per_rad


def match_pair(one: Picture, other: Picture, near: float, config: MatchConfig) -> tuple[Shown, Shown]:
    """What both images show.

    near: distance of what is near in either picture, which sets the range of disparities.
    """
    baseline = other.view.centre - one.view.centre
    b = float(np.linalg.norm(baseline))
    R = axes_about(baseline / b, one.view.axis + other.view.axis)
    left, right = (_Side.of(picture, R, config) for picture in (one, other))
    if not (left.seen.any() and right.seen.any()):
        return _nothing(one), _nothing(other)
    f = min(one.view.pixels_per_rad, other.view.pixels_per_rad)
    per_rad = np.array([f, f * float(np.cos(left.elevation[left.seen]).mean())])
    nearest = max(config.nearest * near, b / config.max_parallax)
    ends = np.linspace(left.elevation[left.seen].min(), left.elevation[left.seen].max(), 16)
    most = STEPS * max(1, int(np.ceil(f * disparity_at(nearest, ends, b).max() / STEPS)))
    mine, theirs = left.reach(per_rad), right.reach(per_rad)
    low = np.floor(np.maximum(mine[0], theirs[0])) - 1
    high = np.ceil(np.minimum(mine[1], theirs[1] + np.array([most, 0]))) + 1
    if (high - low < config.block_px).any():
        return _nothing(one), _nothing(other)
    low[0] -= most  # the matcher gives nothing for so many columns at the left
    sphere = Sphere(R, per_rad, low, (int(high[0] - low[0]), int(high[1] - low[1])))
    disparity, good = _matched(sphere, one, other, most, config)
    there = np.full_like(disparity, -1.0)
    _from_right(disparity, good, config.max_jump_px, there)
    of_left = _shown(left, sphere, disparity, good, b, config)
    return of_left, _shown(right, sphere, there, there >= 0, -b, config)


def _nothing(one: Picture) -> Shown:
    return Shown(*(np.full(one.valid.shape, np.nan, np.float32) for _ in range(2)))


def _matched(
    sphere: Sphere, one: Picture, other: Picture, most: int, config: MatchConfig
) -> tuple[Float32[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """Disparities of the left image in pixels, and where they are good."""
    left, left_valid = sphere.resampled(one)
    right, right_valid = sphere.resampled(other)
    block = config.block_px
    matcher = cv2.StereoSGBM.create(
        minDisparity=0, numDisparities=most, blockSize=block, P1=round(config.small_step_penalty * block**2),
        P2=round(config.large_step_penalty * block**2), disp12MaxDiff=config.max_left_right_px,
        preFilterCap=config.prefilter_cap, uniquenessRatio=config.unique_percent,
        speckleWindowSize=config.speckle_px, speckleRange=config.speckle_step_px,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )  # fmt: skip
    found: Int16[np.ndarray, "h w"] = matcher.compute(left, right)
    disparity = found.astype(np.float32) / STEPS
    row, column = np.ogrid[: disparity.shape[0], : disparity.shape[1]]
    match = np.clip(np.rint(column - disparity).astype(np.int32), 0, sphere.size[0] - 1)
    good = (disparity > 0) & left_valid & right_valid[row, match]
    good &= _contrast(left, block) >= config.min_contrast
    return disparity, good


@njit(cache=True, error_model="numpy", nogil=True)
@no_type_check
def _from_right(disparity, good, max_jump_px, there):
    """Into there (h, w): disparities at the right image's pixels, between matches of left neighbours.

    Where two things are matched with one pixel it shows the nearer one.
    """
    for row in range(disparity.shape[0]):
        for column in range(disparity.shape[1] - 1):
            here, beside = disparity[row, column], disparity[row, column + 1]
            begin, width = column - here, 1 + here - beside
            even = abs(beside - here) <= max_jump_px and width > 0
            if not (even and good[row, column] and good[row, column + 1]):
                continue
            last = min(disparity.shape[1] - 1, int(np.floor(begin + width)))
            for k in range(max(0, int(np.ceil(begin))), last + 1):
                between = here + (beside - here) * (k - begin) / width
                there[row, k] = max(there[row, k], between)


def _shown(
    side: _Side,
    sphere: Sphere,
    disparity: Float32[np.ndarray, "h w"],
    good: Bool[np.ndarray, "h w"],
    b: float,
    config: MatchConfig,
) -> Shown:
    """At an image's pixels.  b: positive if the partner is to the right, where elevations grow, else
    negative."""
    x, y = (
        at * np.float32(per_rad) - np.float32(low + 0.5)
        for at, per_rad, low in zip((side.elevation, side.azimuth), sphere.per_rad, sphere.low, strict=True)
    )
    found = _sampled(disparity, _even(disparity, good, config.max_jump_px), x, y)
    found[~side.seen | ~side.picture.valid] = np.nan
    f = np.float32(sphere.per_rad[0])
    # What counts of the baseline is across the ray.
    sine = np.maximum(np.cos(side.elevation), np.float32(config.min_sine))
    sigma = np.where(np.isnan(found), np.nan, np.float32(config.sigma_px / (f * abs(b))) / sine)
    towards = side.elevation if b > 0 else -side.elevation
    return Shown(inverse_distance_at(found / f, towards, abs(b)), sigma)


def _contrast(grey: UInt8[np.ndarray, "h w"], block_px: int) -> Float32[np.ndarray, "h w"]:
    """Standard deviation of the grey values in the block around each pixel."""
    values, block = grey.astype(np.float32), (block_px, block_px)
    mean = cv2.boxFilter(values, -1, block)
    variance = cv2.boxFilter(values**2, -1, block) - mean**2
    contrast: Float32[np.ndarray, "h w"] = np.sqrt(np.maximum(variance, 0.0))
    return contrast


def _even(
    disparity: Float32[np.ndarray, "h w"], good: Bool[np.ndarray, "h w"], max_jump_px: float
) -> Bool[np.ndarray, "h w"]:
    """The good pixels except those at jumps, across which nothing must be interpolated."""
    kernel, far = np.ones((3, 3), np.uint8), np.float32(1e6)
    high = cv2.dilate(np.where(good, disparity, -far), kernel)
    low = cv2.erode(np.where(good, disparity, far), kernel)
    even: Bool[np.ndarray, "h w"] = good & (high - low <= max_jump_px)
    return even


def _sampled(
    disparity: Float32[np.ndarray, "h w"],
    good: Bool[np.ndarray, "h w"],
    x: Float32[np.ndarray, "r c"],
    y: Float32[np.ndarray, "r c"],
) -> Float32[np.ndarray, "r c"]:
    """Linear between the good pixels; NaN where they hold less than half of the weight."""
    total = cv2.remap(np.where(good, disparity, np.float32(0)), x, y, cv2.INTER_LINEAR)
    share = cv2.remap(good.astype(np.float32), x, y, cv2.INTER_LINEAR)
    at: Float32[np.ndarray, "r c"] = np.where(
        share >= 0.5, total / np.maximum(share, np.float32(0.5)), np.float32(np.nan)
    )
    return at
