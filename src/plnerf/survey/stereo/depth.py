"""The depth map of an image from its stereo partners.

Both images of a pair are turned so that their rows lie along the baseline (A. Fusiello, E. Trucco, A. Verri,
"A compact algorithm for rectification of stereo pairs", Machine Vision and Applications 12, 2000), and
matched by semi-global matching (H. Hirschmueller, "Stereo processing by semiglobal matching and mutual
information", IEEE TPAMI 30(2), 2008; OpenCV's StereoSGBM).  A pixel's depth stands where two pairs agree,
or one pair alone says anything: that is less sure, and `specks.py` asks other images.

Letters: w = 1/t inverse distance along a pixel's ray, what a disparity is linear in: for rectified depth Z
and focal length f, disparity = f b / Z; k partners; h x w pixels.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from plnerf.survey.stereo.pairs import LEAST_SINE
from plnerf.survey.stereo.views import View

NEAREST = 1 / 3
"""Of the given distance: nearer things are not looked for."""
BLOCK_PX = 5
UNIQUE_PERCENT = 10
SPECKLE_PX, SPECKLE_STEP_PX = 60, 1
SIGMA_PX = 0.4
"""Standard deviation of a disparity."""
AGREE_PX = 1.0
"""Two pairs agree if their depths differ by no more than what this disparity means in the less exact pair."""
LEAST_CONTRAST = 2.5
"""Standard deviation of the grey values in a block: below, as in the sky, matches are chance."""
WIDEST = 0.1
"""Standard deviation of a depth, as a share of it, beyond which it says nothing."""
JUMP_PX = 2.0
"""Neighbours whose disparities differ by more are different things."""


@dataclass(frozen=True, eq=False)
class Picture:
    """An image, and which of its pixels count."""

    view: View
    grey: UInt8[np.ndarray, "h w"]
    valid: Bool[np.ndarray, "h w"]

    @cached_property
    def rays(self) -> Float[np.ndarray, "h w 3"]:
        """Directions of all pixels' centres, unit length."""
        return self.view.rays()


@dataclass(frozen=True, eq=False)
class DepthMap:
    """Distances along the rays of a view, scene units; NaN where none is known."""

    t: Float[np.ndarray, "h w"]
    sigma: Float[np.ndarray, "h w"]


def depth_map(picture: Picture, partners: Sequence[Picture], distance: float) -> DepthMap:
    """Where two partners agree, or one alone says anything; distance: typical of what is near."""
    shape = picture.valid.shape
    pairs = [inverse_distance(picture, one, distance) for one in partners]
    if len(pairs) < 2:
        return DepthMap(np.full(shape, np.nan), np.full(shape, np.nan))
    w, sigma = np.stack([one[0] for one in pairs]), np.stack([one[1] for one in pairs])
    return _agreed(w, sigma)


def inverse_distance(
    one: Picture, other: Picture, distance: float
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """1/t for the pixels of `one`, and its standard deviation; NaN where there is no match."""
    view = one.view
    baseline = other.view.centre - view.centre
    b = float(np.linalg.norm(baseline))
    R = _rectified_axes(baseline / b, view.axis + other.view.axis)
    f = float(view.focal_px.mean())
    reach = 16 * max(1, int(np.ceil(f * b / (NEAREST * distance) / 16)))
    # Where the rays of `one` lie on the plane z = 1 of the rectified camera.
    rays = one.rays @ R.T
    sine = np.hypot(rays[..., 1], rays[..., 2])  # x is the baseline
    seen = (sine >= LEAST_SINE) & (rays[..., 2] >= LEAST_SINE)
    plane = f * rays[..., :2] / np.where(seen, rays[..., 2], 1.0)[..., None]
    nothing = np.full(seen.shape, np.nan)
    if not seen.any():
        return nothing, nothing
    low, high = np.floor(plane[seen].min(0)) - 1, np.ceil(plane[seen].max(0)) + 1
    low[0] -= reach  # the matcher says nothing of so many columns at the left
    size = (int(high[0] - low[0]), int(high[1] - low[1]))
    left, left_valid = _turned(one, R, f, low, size)
    right, right_valid = _turned(other, R, f, low, size)
    matcher = cv2.StereoSGBM.create(
        minDisparity=0, numDisparities=reach, blockSize=BLOCK_PX, P1=8 * BLOCK_PX**2, P2=32 * BLOCK_PX**2,
        disp12MaxDiff=1, preFilterCap=31, uniquenessRatio=UNIQUE_PERCENT, speckleWindowSize=SPECKLE_PX,
        speckleRange=SPECKLE_STEP_PX, mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )  # fmt: skip
    disparity = matcher.compute(left, right).astype(np.float32) / 16  # the matcher's are 16ths
    row, column = np.indices(disparity.shape)
    match = np.clip(np.rint(column - disparity).astype(int), 0, size[0] - 1)
    good = (disparity > 0) & left_valid & right_valid[row, match] & (_contrast(left) >= LEAST_CONTRAST)
    x, y = (plane - low - 0.5).astype(np.float32).transpose(2, 0, 1)
    at = _sampled(disparity, _even(disparity, good), x, y)
    at[~seen | ~one.valid] = np.nan
    # Z = f b / disparity, and t = Z / (the ray's share of z); what counts of the baseline is across the ray.
    sigma = np.where(np.isnan(at), np.nan, SIGMA_PX / (f * b * np.maximum(sine, LEAST_SINE)))
    return at * rays[..., 2] / (f * b), sigma


def _rectified_axes(x: Float[np.ndarray, "3"], forward: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Rows: the axes of both rectified cameras.  x points to the partner, which is then the right image."""
    z = forward - (forward @ x) * x
    z /= np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z])


def _turned(
    one: Picture, R: Float[np.ndarray, "3 3"], f: float, low: Float[np.ndarray, "2"], size: tuple[int, int]
) -> tuple[UInt8[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """The image as a rectified camera sees it, and where it shows valid pixels.  OpenCV's first pixel has
    its centre at (0, 0)."""
    view = one.view
    K, K_rectified = np.eye(3), np.eye(3)
    K[0, 0], K[1, 1] = view.focal_px
    K[:2, 2] = view.principal_px - 0.5
    K_rectified[0, 0] = K_rectified[1, 1] = f
    K_rectified[:2, 2] = -low - 0.5
    maps = cv2.initUndistortRectifyMap(
        K, view.distortion, R @ view.R_scene_camera, K_rectified, size, cv2.CV_32FC1
    )
    grey = cv2.remap(one.grey, *maps, cv2.INTER_LINEAR)
    valid = cv2.remap(one.valid.astype(np.uint8), *maps, cv2.INTER_NEAREST)
    return grey.astype(np.uint8), valid > 0


def _contrast(grey: UInt8[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """Standard deviation of the grey values in the block around each pixel."""
    values, block = grey.astype(np.float32), (BLOCK_PX, BLOCK_PX)
    mean = cv2.boxFilter(values, -1, block)
    variance = cv2.boxFilter(values**2, -1, block) - mean**2
    return np.sqrt(np.maximum(variance, 0.0)).astype(np.float64)


def _even(disparity: Float[np.ndarray, "h w"], good: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """The good pixels but those at jumps, between whose sides nothing is to be interpolated."""
    kernel, far = np.ones((3, 3), np.uint8), np.float32(1e6)
    high = cv2.dilate(np.where(good, disparity, -far), kernel)
    low = cv2.erode(np.where(good, disparity, far), kernel)
    even: Bool[np.ndarray, "h w"] = good & (high - low <= JUMP_PX)
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


def _agreed(w: Float[np.ndarray, "k h w"], sigma: Float[np.ndarray, "k h w"]) -> DepthMap:
    """The weighted mean of the pairs that agree with the one with which most agree (of equals, the
    most exact).  One pair alone is believed where no other says anything: near things leave most images.

    Its deviation is the least of theirs, for all share one image, or their spread where that is more."""
    limit = AGREE_PX / SIGMA_PX * np.maximum(sigma[:, None], sigma[None])
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
    known &= deviation <= WIDEST * mean
    t = np.where(known, 1 / np.where(known, mean, 1.0), np.nan)
    return DepthMap(t, deviation * t**2)
