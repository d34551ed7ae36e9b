"""The depth map of an image from its stereo partners.

Both images of a pair are turned so that their rows lie along the baseline (A. Fusiello, E. Trucco, A. Verri,
"A compact algorithm for rectification of stereo pairs", Machine Vision and Applications 12, 2000), and
matched by semi-global matching (H. Hirschmueller, "Stereo processing by semiglobal matching and mutual
information", IEEE TPAMI 30(2), 2008; OpenCV's StereoSGBM).  A pixel has a depth where two pairs agree, or
where one pair alone has a match: that is less sure, and `consistency.py` checks it against other images.

Letters: w = 1/t inverse distance along a pixel's ray, what a disparity is linear in: for rectified depth Z
and focal length f, disparity = f b / Z; k partners; h x w pixels.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from plnerf.survey.stereo.config import MatchConfig
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
    return _agreed(w, sigma, config)


def inverse_distance(
    one: Picture, other: Picture, near: float, config: MatchConfig
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """1/t for the pixels of `one`, and its standard deviation; NaN where there is no match."""
    view = one.view
    baseline = other.view.centre - view.centre
    b = float(np.linalg.norm(baseline))
    R = _rectified_axes(baseline / b, view.axis + other.view.axis)
    f = float(view.focal_px.mean())
    reach = 16 * max(1, int(np.ceil(f * b / (config.nearest * near) / 16)))
    # Where the rays of `one` lie on the plane z = 1 of the rectified camera.
    rays = one.rays @ R.T
    sine = np.hypot(rays[..., 1], rays[..., 2])  # x is the baseline
    seen = (sine >= config.min_sine) & (rays[..., 2] >= config.min_sine)
    plane = f * rays[..., :2] / np.where(seen, rays[..., 2], 1.0)[..., None]
    nothing = np.full(seen.shape, np.nan)
    if not seen.any():
        return nothing, nothing
    low, high = np.floor(plane[seen].min(0)) - 1, np.ceil(plane[seen].max(0)) + 1
    low[0] -= reach  # the matcher gives nothing for so many columns at the left
    size = (int(high[0] - low[0]), int(high[1] - low[1]))
    left, left_valid = _turned(one, R, f, low, size)
    right, right_valid = _turned(other, R, f, low, size)
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
    match = np.clip(np.rint(column - disparity).astype(int), 0, size[0] - 1)
    good = (disparity > 0) & left_valid & right_valid[row, match]
    good &= _contrast(left, block) >= config.min_contrast
    x, y = (plane - low - 0.5).astype(np.float32).transpose(2, 0, 1)
    at = _sampled(disparity, _even(disparity, good, config.max_jump_px), x, y)
    at[~seen | ~one.valid] = np.nan
    # Z = f b / disparity, and t = Z / (the ray's share of z); what counts of the baseline is across the ray.
    sigma = np.where(np.isnan(at), np.nan, config.sigma_px / (f * b * np.maximum(sine, config.min_sine)))
    return at * rays[..., 2] / (f * b), sigma


def _rectified_axes(x: Float[np.ndarray, "3"], forward: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Rows: the axes of both rectified cameras.  x points to the partner, which is then the right image."""
    z = forward - (forward @ x) * x
    z /= np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z])


def _turned(
    one: Picture, R: Float[np.ndarray, "3 3"], f: float, low: Float[np.ndarray, "2"], size: tuple[int, int]
) -> tuple[UInt8[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """The image as a rectified camera sees it, and which of its pixels are valid.  OpenCV's first pixel has
    its centre at (0, 0)."""
    view = one.view
    K, K_rectified = np.eye(3), np.eye(3)
    K[0, 0], K[1, 1] = view.focal_px
    K[:2, 2] = view.principal_px - 0.5
    K_rectified[0, 0] = K_rectified[1, 1] = f
    K_rectified[:2, 2] = -low - 0.5
    maps = cv2.initUndistortRectifyMap(
        K, view.distortion, R @ view.R_line_camera, K_rectified, size, cv2.CV_32FC1
    )
    grey = cv2.remap(one.grey, *maps, cv2.INTER_LINEAR)
    valid = cv2.remap(one.valid.astype(np.uint8), *maps, cv2.INTER_NEAREST)
    return grey.astype(np.uint8), valid > 0


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
    w: Float[np.ndarray, "k h w"], sigma: Float[np.ndarray, "k h w"], config: MatchConfig
) -> DepthMap:
    """The weighted mean of the pairs that agree with the one with which most agree (of equals, the most
    exact).  One pair alone is believed where no other has a match: near things leave most images.

    Its standard deviation is the least of theirs, for all share one image, or their spread where that is
    more."""
    limit = config.agree_px / config.sigma_px * np.maximum(sigma[:, None], sigma[None])
    agree = np.abs(w[:, None] - w[None]) <= limit  # k k h w; False with NaN
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
    return DepthMap(t, deviation * t**2)
