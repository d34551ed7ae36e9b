"""The depth map of an image from its stereo partners.

Both images of a pair are resampled so that their rows match (`rectify.py`), and matched by semi-global
matching (H. Hirschmueller, "Stereo processing by semiglobal matching and mutual information", IEEE TPAMI
30(2), 2008; OpenCV's StereoSGBM).  A pixel has a depth where two pairs agree, or where one pair alone has a
match: that is less sure, and `consistency.py` checks it against other images.

Letters: w = 1/t inverse distance along a pixel's ray; b baseline; f pixels per radian; k partners; h x w
pixels, of which n have a match.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from plnerf.survey.stereo.config import MatchConfig
from plnerf.survey.stereo.rectify import Sphere, angles, axes_about, disparity_at, inverse_distance_at
from plnerf.survey.stereo.stereo_views import Picture


@dataclass(frozen=True, eq=False)
class DepthMap:
    """Distances along the rays of a view, and their standard deviations, LineFrame; NaN where unknown."""

    t: Float[np.ndarray, "h w"]
    sigma: Float[np.ndarray, "h w"]


def depth_map(
    picture: Picture, partners: Sequence[Picture], near: float | Sequence[float], config: MatchConfig
) -> DepthMap:
    """Depths where two partners agree, or one alone has a match.

    near: distance of what is near in the picture, of all pairs or of each: it sets the range of disparities.
    """
    shape = picture.valid.shape
    distances = [near] * len(partners) if isinstance(near, float) else near
    pairs = [inverse_distance(picture, *pair, config) for pair in zip(partners, distances, strict=True)]
    if len(pairs) < 2:
        return DepthMap(np.full(shape, np.nan), np.full(shape, np.nan))
    w, sigma = np.stack([one[0] for one in pairs]), np.stack([one[1] for one in pairs])
    t, deviation = np.full(shape, np.nan), np.full(shape, np.nan)
    matched = np.isfinite(w).any(0)
    t[matched], deviation[matched] = _agreed(w[:, matched], sigma[:, matched], config)
    return DepthMap(t, deviation)


def inverse_distance(
    one: Picture, other: Picture, near: float, config: MatchConfig
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """1/t for the pixels of `one`, and its standard deviation; NaN where there is no match."""
    view = one.view
    baseline = other.view.centre - view.centre
    b = float(np.linalg.norm(baseline))
    R = axes_about(baseline / b, view.axis + other.view.axis)
    elevation, azimuth = angles(one.rays, R)
    sine = np.cos(elevation)  # of the angle between baseline and ray
    seen = sine >= config.min_sine
    nothing = np.full(seen.shape, np.nan)
    if not seen.any():
        return nothing, nothing
    f = view.pixels_per_rad
    nearest = max(config.nearest * near, b / config.max_parallax)
    ends = np.linspace(elevation[seen].min(), elevation[seen].max(), 16)
    reach = 16 * max(1, int(np.ceil(f * disparity_at(nearest, ends, b).max() / 16)))
    per_rad = np.array([f, f * float(sine[seen].mean())])
    at_px = np.stack([elevation, azimuth], -1) * per_rad
    theirs = np.stack(angles(other.view.border, R), -1) * per_rad
    low = np.floor(np.maximum(at_px[seen].min(0), theirs.min(0))) - 1
    high = np.ceil(np.minimum(at_px[seen].max(0), theirs.max(0) + np.array([reach, 0]))) + 1
    if (high - low < config.block_px).any():
        return nothing, nothing
    low[0] -= reach  # the matcher gives nothing for so many columns at the left
    sphere = Sphere(R, per_rad, low, (int(high[0] - low[0]), int(high[1] - low[1])))
    left, left_valid = sphere.resampled(one)
    right, right_valid = sphere.resampled(other)
    block = config.block_px
    matcher = cv2.StereoSGBM.create(
        minDisparity=0, numDisparities=reach, blockSize=block, P1=round(config.small_step_penalty * block**2),
        P2=round(config.large_step_penalty * block**2), disp12MaxDiff=config.max_left_right_px,
        preFilterCap=config.prefilter_cap, uniquenessRatio=config.unique_percent,
        speckleWindowSize=config.speckle_px, speckleRange=config.speckle_step_px,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )  # fmt: skip
    disparity = matcher.compute(left, right).astype(np.float32) / 16  # the matcher's are 16ths
    row, column = np.indices(disparity.shape)
    match = np.clip(np.rint(column - disparity).astype(int), 0, sphere.size[0] - 1)
    good = (disparity > 0) & left_valid & right_valid[row, match]
    good &= _contrast(left, block) >= config.min_contrast
    x, y = (at_px - low - 0.5).astype(np.float32).transpose(2, 0, 1)
    found = _sampled(disparity, _even(disparity, good, config.max_jump_px), x, y)
    found[~seen | ~one.valid] = np.nan
    # What counts of the baseline is across the ray.
    sigma = np.where(np.isnan(found), np.nan, config.sigma_px / (f * b * np.maximum(sine, config.min_sine)))
    return inverse_distance_at(found / f, elevation, b), sigma


def _contrast(grey: UInt8[np.ndarray, "h w"], block_px: int) -> Float[np.ndarray, "h w"]:
    """Standard deviation of the grey values in the block around each pixel."""
    values, block = grey.astype(np.float32), (block_px, block_px)
    mean = cv2.boxFilter(values, -1, block)
    variance = cv2.boxFilter(values**2, -1, block) - mean**2
    contrast: Float[np.ndarray, "h w"] = np.sqrt(np.maximum(variance, 0.0)).astype(np.float64)
    return contrast


def _even(
    disparity: Float[np.ndarray, "h w"], good: Bool[np.ndarray, "h w"], max_jump_px: float
) -> Bool[np.ndarray, "h w"]:
    """The good pixels except those at jumps, across which nothing must be interpolated."""
    kernel, far = np.ones((3, 3), np.uint8), np.float32(1e6)
    high = cv2.dilate(np.where(good, disparity, -far), kernel)
    low = cv2.erode(np.where(good, disparity, far), kernel)
    even: Bool[np.ndarray, "h w"] = good & (high - low <= max_jump_px)
    return even


def _sampled(
    disparity: Float[np.ndarray, "h w"],
    good: Bool[np.ndarray, "h w"],
    x: Float[np.ndarray, "r c"],
    y: Float[np.ndarray, "r c"],
) -> Float[np.ndarray, "r c"]:
    """Linear between the good pixels; NaN where they hold less than half of the weight."""
    total = cv2.remap(np.where(good, disparity, np.float32(0)), x, y, cv2.INTER_LINEAR)
    share = cv2.remap(good.astype(np.float32), x, y, cv2.INTER_LINEAR)
    at: Float[np.ndarray, "r c"] = np.where(share >= 0.5, total / np.maximum(share, 0.5), np.nan)
    return at.astype(np.float64)


def _agreed(
    w: Float[np.ndarray, "k n"], sigma: Float[np.ndarray, "k n"], config: MatchConfig
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Depths of pixels, and their standard deviations.

    A depth is the weighted mean of the pairs that agree with the one with which most agree (of equals, the
    most exact).  One pair alone is believed where no other has a match: near things leave most images.
    Its standard deviation is the least of theirs, for all share one image, or their spread where that is
    more.
    """
    limit = config.agree_px / config.sigma_px * np.maximum(sigma[:, None], sigma[None])
    agree = np.abs(w[:, None] - w[None]) <= limit  # k k n; False with NaN
    votes = agree.sum(1) - sigma / (2 * np.nanmax(sigma, initial=1e-12))
    best = np.nanargmax(np.where(np.isnan(votes), -np.inf, votes), axis=0)
    chosen = np.take_along_axis(agree, best[None, None], 0)[0]
    weight = np.where(chosen, 1 / sigma**2, 0.0)
    total = weight.sum(0)
    known = (chosen.sum(0) >= 2) | (np.isfinite(w).sum(0) == 1)
    safe = np.where(known, total, 1.0)
    filled = np.where(chosen, w, 0.0)
    mean = (weight * filled).sum(0) / safe
    spread = np.sqrt((weight * np.where(chosen, w - mean, 0.0) ** 2).sum(0) / safe)
    exact = np.where(chosen, sigma, np.inf).min(0)
    deviation = np.maximum(exact, spread)
    known &= deviation <= config.max_relative_sigma * mean
    t = np.where(known, 1 / np.where(known, mean, 1.0), np.nan)
    return t, deviation * t**2
