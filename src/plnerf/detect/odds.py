"""Log odds of a wire from a ridge, or from its absence, view by view.

Where a wire hangs and nothing hides it, its ridge shows with probability P; elsewhere ridges lie with the
density d that they have nearby (in grass many, before the sky none).  A ridge near a pixel then adds
log((P + (1 - P) d) / d) to the log odds of a wire there, and its absence log(1 - P): naive Bayes over views
and planes.  So a ridge before the sky counts for much and one in grass for little, a view in which something
hides the wire costs little, and sums need no further normalisation: above zero a wire is likelier than none.

Letters: p pixels of all views, l radii within which a ridge counts as near, c blocks of 8 x 8 pixels.
"""

from collections.abc import Mapping
from typing import NamedTuple, no_type_check

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

from plnerf.detect.config import OddsConfig
from plnerf.detect.nearest import STEPS, forget_in, nearest_of_views
from plnerf.detect.views import Views, project_into_all
from plnerf.ops.kernel_cache import njit
from plnerf.ops.threads import share

BLOCK = 8
"""Width of the blocks for which densities are tabulated, in pixels."""
Box = tuple[slice, slice]
"""Rows and columns of a view."""


class Odds(NamedTuple):
    """The ridges of n views: the distance to the nearest, and the log odds that it adds."""

    ridge: UInt8[np.ndarray, " p"]
    """Quarter pixels to the nearest ridge."""
    free: UInt8[np.ndarray, " p"]
    """The same without the ridges of other lines.  Where only those are near, nothing is known."""
    shown: Float32[np.ndarray, "l c"]
    """Nats, for a ridge within the radius."""
    starts: Int[np.ndarray, " n"]
    blocks: Int[np.ndarray, " n"]
    """In a row."""
    sharp_px: float
    """Radius within which a ridge is a wire's, given the accuracy of poses and fits."""
    radii_px: Float[np.ndarray, " l"]
    missed: float
    """Nats, for the absence of a ridge: log(1 - P)."""
    coarsest: float
    """Resolution below which a view does not count, as a share of that of the view that resolves best."""
    enough_px: float
    """No view needs to resolve better than that the reach is so many pixels."""


def odds_of(responses: Float[np.ndarray, " p"], views: Views, config: OddsConfig) -> Odds:
    """The odds from ridge responses, 0 where there is no ridge."""
    densities: list[Float32[np.ndarray, "l _"]] = []
    starts, blocks = [], []
    radii = config.radii_px
    ridge = distances(responses >= config.min_response, views)
    for (w, h), start in zip(views.sizes, views.starts, strict=True):
        near = ridge[start : start + w * h].reshape(h, w)
        small = -(-w // BLOCK), -(-h // BLOCK)
        density = np.empty((len(radii), small[1], small[0]), np.float32)
        for level, radius in enumerate(radii):
            hits = (near <= STEPS * radius).astype(np.float32)
            shrunk = cv2.resize(hits, small, interpolation=cv2.INTER_AREA)
            cv2.GaussianBlur(shrunk, (0, 0), (config.around_px + radius) / BLOCK, dst=density[level])
        starts.append(sum(part.shape[1] for part in densities))
        blocks.append(small[0])
        densities.append(density.reshape(len(radii), -1))
    density = np.clip(np.concatenate(densities, 1), config.min_density, 1)
    shown = np.log(config.shown / density + (1 - config.shown))
    return Odds(
        ridge, ridge, shown, np.array(starts), np.array(blocks), config.sharp_px, np.array(radii),
        float(np.log(1 - config.shown)), config.coarsest, config.enough_px,
    )  # fmt: skip


def with_own_arrays(odds: Odds) -> Odds:
    """The same, with copies of what `forget` changes."""
    return odds._replace(ridge=odds.ridge.copy(), free=odds.free.copy())


def forget(
    odds: Odds,
    every: Odds,
    left: Float[np.ndarray, " p"],
    others: Bool[np.ndarray, " p"],
    views: Views,
    config: OddsConfig,
    changed: Mapping[int, Box],
) -> None:
    """Has odds know that the ridges of some pixels are other lines'.

    odds: as they were when only pixels in boxes of some views, `changed`, were others' or were not; every:
    those of all ridges.  left: responses without the others'.
    """
    rows = [(n, *(edge for side in box for edge in (side.start, side.stop))) for n, box in changed.items()]
    share(
        forget_in, odds.ridge, odds.free, every.ridge, left, others, config.min_response, config.muffled_px,
        views.starts, views.sizes, np.array(rows, np.int64).reshape(-1, 5), of=len(rows),
    )  # fmt: skip


def distances(ridges: Bool[np.ndarray, " p"], views: Views) -> UInt8[np.ndarray, " p"]:
    """From each pixel to the nearest ridge of its view, in quarters of a pixel; 255 where that is far."""
    out = np.empty(len(ridges), np.uint8)
    share(nearest_of_views, ridges, views.starts, views.sizes, out, of=len(views.sizes))
    return out


def pixels_of(views: Views, n: int) -> tuple[slice, tuple[int, int]]:
    """The part of flat arrays that holds a view's pixels, and its rows and columns."""
    w, h = (int(side) for side in views.sizes[n])
    start = int(views.starts[n])
    return slice(start, start + w * h), (h, w)


@njit(cache=True, error_model="numpy")
@no_type_check
def shown_at(views, odds, n, pixel, radius):
    """Nats for a ridge within a radius of a pixel of view n."""
    level, w = 0, views.sizes[n, 0]
    while level + 1 < len(odds.radii_px) and odds.radii_px[level] < 0.7 * radius:
        level += 1
    row, column = pixel // w, pixel % w
    return odds.shown[level, odds.starts[n] + row // BLOCK * odds.blocks[n] + column // BLOCK]


@njit(cache=True, error_model="numpy")
@no_type_check
def place_odds(views, odds, lenses, point, reach, pixels, scales):
    """Log odds of a wire within reach of a point (x, y, z), and the number of views that count there.

    Of those that see the point, the ones count that resolve it nearly as well as the best.  lenses: as
    `lenses_of` gives them; pixels, scales (n,): room to work in.
    """
    project_into_all(lenses, point[0], point[1], point[2], pixels, scales)
    enough, finest = odds.enough_px / max(reach, 1e-9), 0.0
    for n in range(len(pixels)):
        if pixels[n] >= 0:
            finest = max(finest, min(scales[n], enough))
    total, seen = 0.0, 0.0
    for n in range(len(pixels)):
        if pixels[n] < 0 or scales[n] < odds.coarsest * finest:
            continue
        seen += 1
        radius = max(reach * scales[n], odds.sharp_px)
        pixel = views.starts[n] + pixels[n]
        if odds.free[pixel] <= STEPS * radius:
            total += shown_at(views, odds, n, pixels[n], radius)
        elif odds.ridge[pixel] > STEPS * radius:
            total += odds.missed
    return total, seen
