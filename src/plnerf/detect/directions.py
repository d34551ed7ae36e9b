"""Which way lines run: pairs of images vote for directions in space.

The planes of two segments, seen from two places, meet in a line (Bretscher et al. call them interpretation
planes).  If both segments show one line in space, what they show of it overlaps there.  Pairs that show one
direction of lines agree on it; those of different lines meet anywhere, seldom in the same stretch.

Letters: s segments; n views; a azimuths in [0, pi) from the scene's x towards its y; e slopes.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from plnerf.detect.config_lines import DirectionConfig
from plnerf.detect.segments import Segments
from plnerf.detect.views import Views
from plnerf.ops.kernel_cache import njit, prange

GRAZING = 0.05
"""Sine of the angle between a ray and a plane below which it says nothing where they meet."""


@dataclass(frozen=True)
class Direction:
    """A direction in which lines run."""

    azimuth_rad: float
    """From the scene's x towards its y, in [0, pi)."""
    slope_rad: float
    """Upwards along the azimuth."""
    excess: float
    """Votes over those of the median azimuth, as a multiple of these and of what a few pairs have."""

    @property
    def vector(self) -> Float[np.ndarray, "3"]:
        """Unit vector."""
        flat = np.cos(self.slope_rad)
        return np.array([
            flat * np.cos(self.azimuth_rad), flat * np.sin(self.azimuth_rad), np.sin(self.slope_rad),
        ])  # fmt: skip


def vote(segments: Segments, views: Views, config: DirectionConfig) -> Float[np.ndarray, "a e"]:
    """Votes for each azimuth and slope, in pixels: of each pair those of the shorter segment.

    They count by how much of what both show overlaps, and by the angle at which their planes meet.
    """
    azimuths, slopes = bins(config)
    if not len(segments.owner):
        return np.zeros((len(azimuths), len(slopes)))
    limits = (config.least_angle, config.full_angle, config.least_overlap, math.tan(config.max_slope_rad))
    first = np.searchsorted(segments.owner, np.arange(len(views.R) + 1))
    by_view = votes_of_views(
        segments, views.centre, first, pairs_of_views(views, config.partners), limits,
        np.zeros((len(views.R), len(azimuths), len(slopes))),
    )  # fmt: skip
    votes: Float[np.ndarray, "a e"] = by_view.sum(0)
    return votes


def pairs_of_views(views: Views, most: int) -> Bool[np.ndarray, "n n"]:
    """Whether two views vote as a pair: one is among the `most` nearest to the other.  Each pair once."""
    distance = np.linalg.norm(views.centre[:, None] - views.centre, axis=2)
    rank = np.argsort(np.argsort(distance, axis=1, kind="stable"), axis=1, kind="stable")
    near = (rank <= most) | (rank <= most).T
    return np.triu(near, 1)


@njit(cache=True, parallel=True, error_model="numpy")
@no_type_check
def votes_of_views(segments, centre, first, partner, limits, votes):
    """Into votes (n, a, e): those of each view's pairs with the views after it."""
    least_angle, full_angle, least_overlap, steepest = limits
    _, normal, ends, length = segments
    for n in prange(len(centre)):
        for a in range(first[n], first[n + 1]):
            for other in range(n + 1, len(centre)):
                if not partner[n, other]:
                    continue
                for b in range(first[other], first[other + 1]):
                    p, q = normal[a], normal[b]
                    dx, dy, dz = (
                        p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]
                    )  # fmt: skip
                    level, sine = np.hypot(dx, dy), np.sqrt(dx * dx + dy * dy + dz * dz)
                    if sine < least_angle or abs(dz) > steepest * level:
                        continue
                    d = (dx / sine, dy / sine, dz / sine)
                    low, high = stretch(centre[n], centre[other], ends[a], q, d)
                    begin, end = stretch(centre[other], centre[n], ends[b], p, d)
                    both = min(high, end) - max(low, begin)
                    share = both / max(max(high, end) - min(low, begin), 1e-12)
                    if share < least_overlap:
                        continue
                    azimuth, slope = np.arctan2(dy, dx), np.arctan2(dz, level)
                    if azimuth < 0:
                        azimuth, slope = azimuth + np.pi, -slope
                    i = int(azimuth / np.pi * votes.shape[1]) % votes.shape[1]
                    k = int((slope / np.arctan(steepest) + 1) / 2 * votes.shape[2])
                    weight = share * min(length[a], length[b]) * min(sine, full_angle) / full_angle
                    votes[n, i, min(max(k, 0), votes.shape[2] - 1)] += weight
    return votes


@njit(cache=True, error_model="numpy")
@no_type_check
def stretch(centre, other, rays, normal, d):
    """Where the line that runs along d in another view's plane begins and ends between two rays.

    (inf, -inf) where a ray does not meet the plane in front of its camera, or hardly.
    """
    off, start = 0.0, 0.0
    for k in range(3):
        off += normal[k] * (other[k] - centre[k])
        start += d[k] * centre[k]
    low, high = np.inf, -np.inf
    for j in range(2):
        across, along = 0.0, 0.0
        for k in range(3):
            across += normal[k] * rays[j, k]
            along += d[k] * rays[j, k]
        if abs(across) < GRAZING or off / across <= 0:
            return np.inf, -np.inf
        place = start + off / across * along
        low, high = min(low, place), max(high, place)
    return low, high


def strongest(
    votes: Float[np.ndarray, "a e"], searched: Sequence[float], config: DirectionConfig
) -> Direction:
    """The direction with most votes; not near azimuths that were searched before."""
    azimuths, slopes = bins(config)
    around = _around(votes, config)
    best = around.max(1)
    usual = float(np.median(best))
    for azimuth in searched:
        turn = np.abs((azimuths - azimuth + np.pi / 2) % np.pi - np.pi / 2)
        best[turn < config.apart_rad] = 0.0
    k = int(best.argmax())
    turn = (azimuths - azimuths[k] + np.pi / 2) % np.pi - np.pi / 2
    votes_near = np.where(np.abs(turn) <= config.peak_rad, np.maximum(best - usual, 0.0), 0.0)
    azimuth = azimuths[k] + (votes_near @ turn) / max(votes_near.sum(), 1e-12)
    slope, excess = float(slopes[around[k].argmax()]), float(best[k]) - usual
    if not 0 <= azimuth < np.pi:  # the same line from its other end
        azimuth, slope = azimuth % np.pi, -slope
    # To a microradian: sums in another order must not change what is searched.
    return Direction(round(float(azimuth), 6), slope, excess / (usual + config.few_px))


def stands_out(direction: Direction, first: Direction | None, config: DirectionConfig) -> bool:
    """Whether a direction has enough votes to be searched.  first: the first one searched, if any."""
    return direction.excess >= max(config.min_excess, config.min_share * first.excess if first else 0.0)


def given(azimuth_rad: float, votes: Float[np.ndarray, "a e"], config: DirectionConfig) -> Direction:
    """An azimuth that is known, with the slope that lines vote for."""
    azimuths, slopes = bins(config)
    around = _around(votes, config)
    k = int(np.abs((azimuths - azimuth_rad + np.pi / 2) % np.pi - np.pi / 2).argmin())
    return Direction(azimuth_rad, float(slopes[around[k].argmax()]), np.inf)


def _around(votes: Float[np.ndarray, "a e"], config: DirectionConfig) -> Float[np.ndarray, "a e"]:
    """Votes within the slopes that sag adds to that of the chord, and of nearly the same azimuth."""
    width = max(1, round(2 * config.sag_rad / config.step_rad))
    near = gaussian_filter1d(votes, config.smooth_rad / config.step_rad, axis=0, mode="wrap")
    around: Float[np.ndarray, "a e"] = uniform_filter1d(near, width, axis=1, mode="constant") * width
    return around


def bins(config: DirectionConfig) -> tuple[Float[np.ndarray, " a"], Float[np.ndarray, " e"]]:
    """The middles of the azimuths and slopes that are voted for."""
    count, levels = round(np.pi / config.step_rad), 2 * round(config.max_slope_rad / config.step_rad)
    return (
        (np.arange(count) + 0.5) * np.pi / count,
        config.max_slope_rad * ((np.arange(levels) + 0.5) * 2 / levels - 1),
    )
