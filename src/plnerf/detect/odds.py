"""What a ridge, or the lack of one, says for a conductor: log odds, view by view.

Where a conductor hangs and nothing hides it, its ridge shows with a chance of P; elsewhere ridges lie with
the density d that they have nearby (in grass many, before the sky none).  A ridge near a pixel then speaks
for a conductor there by log((P + (1 - P) d) / d), none by log(1 - P): naive Bayes over views and planes.  So
a ridge before the sky counts for much and one in grass for little, a view in which something hides the
conductor costs little, and sums of odds need no further normalisation: above zero it is rather a conductor.

Letters: p pixels of all views, l radii within which a ridge counts as near, c blocks of 8 x 8 pixels.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple, no_type_check

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8
from numba import njit

from plnerf.detect.views import NEAREST, Views, bent

WEAKEST = 0.25
"""Response below which nothing counts as a ridge."""
SHOWN = 0.4
"""P: chance that a view shows the ridge of a conductor."""
MISSED = float(np.log(1 - SHOWN))
RADII_PX = (0.75, 1.5, 3.0, 6.0, 12.0)
SHARP_PX = 1.5
"""Radius to begin with."""
AROUND_PX = 12.0
"""Standard deviation of the neighbourhood whose density of ridges counts, beyond the radius itself."""
LEAST_DENSITY = 0.02
MUFFLED_PX = 4
"""Beside others' ridges a weaker one does not show: its lack says nothing."""
BLOCK = 8
STEPS = 4
"""Distances are kept in quarters of a pixel, up to 64 px: a byte for each pixel."""


class Odds(NamedTuple):
    """What the ridges of n views say: how far the next one is, and how much it would count."""

    ridge: UInt8[np.ndarray, " p"]
    """Quarter pixels to the next ridge."""
    free: UInt8[np.ndarray, " p"]
    """The same without ridges that are others'.  Where only those are near, nothing is known."""
    shown: Float32[np.ndarray, "l c"]
    """Nats, for a ridge within the radius."""
    starts: Int[np.ndarray, " n"]
    blocks: Int[np.ndarray, " n"]
    """In a row."""
    sharp_px: float
    """Radius within which a ridge is on a conductor, for all that poses and fits are worth."""


def odds_of(responses: Float[np.ndarray, " p"], views: Views) -> Odds:
    """The odds from ridge responses, 0 where there is no ridge."""
    densities: list[Float32[np.ndarray, "l _"]] = []
    starts, blocks = [], []
    ridge = distances(responses >= WEAKEST, views)
    for (w, h), start in zip(views.sizes, views.starts, strict=True):
        near = ridge[start : start + w * h].reshape(h, w)
        small = -(-w // BLOCK), -(-h // BLOCK)
        density = np.empty((len(RADII_PX), small[1], small[0]), np.float32)
        for level, radius in enumerate(RADII_PX):
            hits = (near <= STEPS * radius).astype(np.float32)
            shrunk = cv2.resize(hits, small, interpolation=cv2.INTER_AREA)
            cv2.GaussianBlur(shrunk, (0, 0), (AROUND_PX + radius) / BLOCK, dst=density[level])
        starts.append(sum(part.shape[1] for part in densities))
        blocks.append(small[0])
        densities.append(density.reshape(len(RADII_PX), -1))
    shown = np.log(SHOWN / np.clip(np.concatenate(densities, 1), LEAST_DENSITY, 1) + (1 - SHOWN))
    return Odds(ridge, ridge, shown, np.array(starts), np.array(blocks), SHARP_PX)


def without(
    odds: Odds, responses: Float[np.ndarray, " p"], others: Bool[np.ndarray, " p"], views: Views
) -> Odds:
    """The odds (as `odds_of` gave them) where some pixels' ridges are others'."""
    ridge = odds.ridge.copy()
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * MUFFLED_PX + 1, 2 * MUFFLED_PX + 1))
    for (w, h), start in zip(views.sizes, views.starts, strict=True):
        part = slice(start, start + w * h)
        ridge[part][cv2.dilate(others[part].reshape(h, w).astype(np.uint8), disc).ravel() > 0] = 0
    return odds._replace(ridge=ridge, free=distances((responses >= WEAKEST) & ~others, views))


def distances(ridges: Bool[np.ndarray, " p"], views: Views) -> UInt8[np.ndarray, " p"]:
    """From each pixel to the next ridge of its view, in quarters of a pixel; 255 for all that is farther."""
    out = np.empty(len(ridges), np.uint8)

    def one(n: int) -> None:
        w, h = views.sizes[n]
        part = slice(views.starts[n], views.starts[n] + w * h)
        away = (~ridges[part]).reshape(h, w).astype(np.uint8)
        distance = cv2.distanceTransform(away, cv2.DIST_L2, cv2.DIST_MASK_5)
        out[part] = (STEPS * np.minimum(distance, 255 / STEPS)).astype(np.uint8).ravel()

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(one, range(len(views.sizes))))
    return out


@njit(cache=True, error_model="numpy")
@no_type_check
def column_odds(views, odds, point, step, reach, total, seen):
    """Into total (k,): odds in nats of a conductor within reach of each point (x, y, z + k step) of a column.

    Into seen (k,): how many views see the point.  What a view has is read once for the whole column, which
    makes this seven times as fast as point by point.
    """
    x, y, z = point
    total[:], seen[:] = 0, 0
    for n in range(len(views.R)):
        R, centre = views.R[n], views.centre[n]
        dx, dy, dz = x - centre[0], y - centre[1], z - centre[2]
        first_u = R[0, 0] * dx + R[0, 1] * dy + R[0, 2] * dz
        first_v = R[1, 0] * dx + R[1, 1] * dy + R[1, 2] * dz
        first_depth = R[2, 0] * dx + R[2, 1] * dy + R[2, 2] * dz
        step_u, step_v, step_depth = R[0, 2] * step, R[1, 2] * step, R[2, 2] * step
        lens, (w, h), (fx, fy), (cx, cy) = (
            views.distortion[n], views.sizes[n], views.focal[n], views.principal[n]
        )  # fmt: skip
        straight = lens[0] == 0 and lens[1] == 0 and lens[2] == 0 and lens[3] == 0 and lens[4] == 0
        start, block, blocks = views.starts[n], odds.starts[n], odds.blocks[n]
        for k in range(len(total)):
            depth = first_depth + k * step_depth
            if depth <= NEAREST:
                continue
            u, v = (first_u + k * step_u) / depth, (first_v + k * step_v) / depth
            if not straight:
                u, v = bent(lens, u, v)
            column, row = u * fx + cx, v * fy + cy
            if not (0 <= column < w and 0 <= row < h):
                continue
            seen[k] += 1
            radius, level = max(reach * fx / depth, odds.sharp_px), 0
            while level + 1 < len(RADII_PX) and RADII_PX[level] < 0.7 * radius:
                level += 1
            i, j = int(column), int(row)
            pixel = start + j * w + i
            if odds.free[pixel] <= STEPS * radius:
                total[k] += odds.shown[level, block + j // BLOCK * blocks + i // BLOCK]
            elif odds.ridge[pixel] > STEPS * radius:
                total[k] += MISSED
