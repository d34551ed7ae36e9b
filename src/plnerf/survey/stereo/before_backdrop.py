"""What stands before a background that stereo knows, though stereo does not see it.

The top of a crown is single leaves, between which one sees what lies behind.  Matched block by block, only
that has a depth there.  But from another place the leaves hide something else: photos that show the same
background predict what a photo shows past the crown, and where it is brighter, darker or of another colour
than all of that, something stands before it.  Whether more of that is found in a window than in windows
beside it needs no threshold on noise: without anything there, each is as likely to have most.

Letters: h heights of an upright axis, k windows of one height (the first on the axis), p pixels of a window,
j other photos.  LineFrame.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

from plnerf.survey.stereo.config import BackdropConfig
from plnerf.survey.stereo.stereo_views import View
from plnerf.survey.stereo.witnesses import Sight

BESIDE = (0.0, -2.5, 2.5, -4.5, 4.5)
"""Places of the windows, in their radii, across the axis as the photo shows it."""
FAR_M, FAR_SIGMA_M = 1000.0, 250.0
"""Distance at which a photo is taken to see the sky, and whatever else it is silent about: what is so far
moves little from photo to photo."""
UPWARDS = np.array([0.0, 0.0, 0.1])
KERNEL = np.ones((3, 3), np.uint8)


@dataclass(frozen=True, eq=False)
class Backdrop:
    """A photo, and the distances that stereo found in it."""

    view: View
    rgb: UInt8[np.ndarray, "h w 3"]
    clear: Bool[np.ndarray, "h w"]
    """False at wires, and where a mask hides pixels."""
    sight: Sight

    @cached_property
    def highest(self) -> UInt8[np.ndarray, "h w 3"]:
        """The greatest values within a pixel: poses and depths are not exact."""
        return cv2.dilate(self.rgb, KERNEL).astype(np.uint8)

    @cached_property
    def lowest(self) -> UInt8[np.ndarray, "h w 3"]:
        """The least values within a pixel."""
        return cv2.erode(self.rgb, KERNEL).astype(np.uint8)

    def distances(
        self, pixels: Float[np.ndarray, "p 2"]
    ) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]:
        """Along the rays of pixels, and their standard deviations; FAR_M where the photo is silent."""
        rows, columns = self.sight.t.shape
        share = pixels / (self.view.width, self.view.height)
        column, row = np.clip((share * (columns, rows)).astype(np.int64), 0, (columns - 1, rows - 1)).T
        t, sigma = self.sight.t[row, column], self.sight.sigma[row, column]
        silent = np.isnan(t)
        return np.where(silent, FAR_M, t.astype(np.float64)), np.where(silent, FAR_SIGMA_M, sigma)


def shown_on_axis(
    axis: Float[np.ndarray, "h 3"],
    photos: Sequence[int],
    backdrop: Callable[[int], Backdrop],
    config: BackdropConfig,
) -> tuple[Int[np.ndarray, " h"], Int[np.ndarray, " h"]]:
    """How many photos show something at points of an upright axis, and how many could.

    photos: those that have the axis inside; each is compared with others of them.
    """
    shown, could = np.zeros(len(axis), np.int64), np.zeros(len(axis), np.int64)
    for i in photos:
        others = [backdrop(j) for j in _others(i, photos, backdrop, config)]
        share = _shares(axis, backdrop(i), others, config)
        could += np.isfinite(share).all(1)
        shown += share[:, 0] > share[:, 1:].max(1) + config.least_excess  # False with NaN
    return shown, could


def _others(
    i: int, photos: Sequence[int], backdrop: Callable[[int], Backdrop], config: BackdropConfig
) -> list[int]:
    """The photos that show the background most alike: from the nearest places."""
    here = backdrop(i).view.centre
    rest = [j for j in photos if j != i]
    return sorted(rest, key=lambda j: float(np.linalg.norm(backdrop(j).view.centre - here)))[: config.others]


def _shares(
    axis: Float[np.ndarray, "h 3"], one: Backdrop, others: Sequence[Backdrop], config: BackdropConfig
) -> Float[np.ndarray, "h k"]:
    """Of each window, the share of its pixels that show something before what lies behind the axis; NaN where
    too few are known."""
    middle, inside = one.view.project(axis)
    away = np.linalg.norm(axis - one.view.centre, axis=1)
    radius = config.radius_m * float(one.view.focal_px.mean()) / away
    along = one.view.project(axis + UPWARDS)[0] - middle
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    across = np.stack([-along[:, 1], along[:, 0]], 1)
    steps = np.linspace(-1.0, 1.0, config.samples)
    u, v = (one.reshape(-1) for one in np.meshgrid(steps, steps[::2] / 2))
    places = np.add.outer(np.array(BESIDE), u)
    pixels = middle[:, None, None] + radius[:, None, None, None] * (
        places[..., None] * across[:, None, None] + v[:, None] * along[:, None, None]
    )
    seen = _seen(pixels.reshape(-1, 2), np.repeat(away, places.size), one, others, config)
    seen = seen.reshape(len(axis), len(BESIDE), -1)
    known = np.isfinite(seen)
    share = np.where(known, seen, 0.0).sum(2) / np.maximum(known.sum(2), 1)
    return np.where((known.mean(2) >= config.least_known) & inside[:, None], share, np.nan)


def _seen(
    pixels: Float[np.ndarray, "p 2"],
    away: Float[np.ndarray, " p"],
    one: Backdrop,
    others: Sequence[Backdrop],
    config: BackdropConfig,
) -> Float[np.ndarray, " p"]:
    """1 where a photo shows something before what lies farther away than `away`; 0 where not; NaN where what
    it shows is no farther: seen from above, a crown is hardly farther than what is above it."""
    t, sigma = one.distances(pixels)
    inside = ((pixels >= 0) & (pixels < (one.view.width, one.view.height))).all(1)
    column, row = np.clip(pixels.astype(np.int64), 0, (one.view.width - 1, one.view.height - 1)).T
    behind = np.flatnonzero(
        inside & one.clear[row, column] & (t - away > config.sigmas * sigma + config.radius_m)
    )
    found = np.full(len(pixels), np.nan)
    if not len(behind) or len(others) < config.least_others:
        return found
    points = one.view.centre + t[behind, None] * one.view.directions(pixels[behind])
    ranges = [_predicted(points, other, config) for other in others]
    low, high = (np.stack([each[k] for each in ranges]) for k in range(2))
    enough = np.isfinite(low[..., 0]).sum(0) >= config.least_others
    behind, low, high = behind[enough], low[:, enough], high[:, enough]
    if len(behind):
        value = _sampled(one.rgb, pixels[behind])
        beyond = np.maximum(value - np.nanmedian(high, 0), np.nanmedian(low, 0) - value).max(1)
        found[behind] = beyond > config.least_step
    return found


def _predicted(
    points: Float[np.ndarray, "p 3"], other: Backdrop, config: BackdropConfig
) -> tuple[Float[np.ndarray, "p 3"], Float[np.ndarray, "p 3"]]:
    """The least and the greatest values that another photo shows where the points are; NaN where it shows
    something else."""
    pixels, inside = other.view.project(points)
    t, sigma = other.distances(np.where(inside[:, None], pixels, 0.0))
    away = np.linalg.norm(points - other.view.centre, axis=1)
    same = inside & (np.abs(t - away) <= config.sigmas * sigma + config.same_share * away)
    at = np.where(inside[:, None], pixels, 0.0)
    low, high = (
        np.where(same[:, None], _sampled(image, at), np.nan) for image in (other.lowest, other.highest)
    )
    return low, high


def _sampled(
    image: UInt8[np.ndarray, "h w 3"], pixels: Float[np.ndarray, "p 2"]
) -> Float32[np.ndarray, "p 3"]:
    """Linear between pixels."""
    x, y = (pixels.astype(np.float32) - np.float32(0.5)).T
    most = 2**15 - 2  # of OpenCV's
    parts = [
        cv2.remap(image, x[k : k + most, None], y[k : k + most, None], cv2.INTER_LINEAR,
                  borderMode=cv2.BORDER_REPLICATE)
        for k in range(0, len(x), most)
    ]  # fmt: skip
    return np.concatenate(parts)[:, 0].astype(np.float32)
