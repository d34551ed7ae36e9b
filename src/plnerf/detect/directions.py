"""Which way lines run: pairs of images vote for directions in space.

The planes of two segments, seen from two places, meet in a line (Bretscher et al. call them interpretation
planes).  If both segments show one line in space, what they show of it overlaps there.  Pairs that show one
direction of lines agree on it; those of different lines meet anywhere, seldom in the same stretch.

Letters: s segments; n views; a azimuths in [0, pi) from the scene's x towards its y; e slopes.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter1d, maximum_filter1d, uniform_filter1d

from plnerf.detect.config_lines import DirectionConfig
from plnerf.detect.segments import Segments
from plnerf.detect.views import Views
from plnerf.ops.kernel_cache import njit
from plnerf.ops.threads import share

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
    footprint: float = 0.0
    """The usual length of a line that a square image of as many pixels shows, in scene units."""

    @property
    def vector(self) -> Float[np.ndarray, "3"]:
        """Unit vector."""
        flat = np.cos(self.slope_rad)
        return np.array([
            flat * np.cos(self.azimuth_rad), flat * np.sin(self.azimuth_rad), np.sin(self.slope_rad),
        ])  # fmt: skip


class Votes(NamedTuple):
    """The votes of all pairs for each azimuth and slope."""

    pixels: Float[np.ndarray, "a e"]
    """The pixels of the shorter segment of each pair that two views near to each other show.  They count by
    how much of the stretches that both show overlaps, and by the angle at which their planes meet."""
    all_pixels: Float[np.ndarray, "a e"]
    """The same where the views stand near to each other or far apart,"""
    footprints: Float[np.ndarray, "a e"]
    """and multiplied by the logarithm of the pair's footprint (`Direction`)."""
    of_views: Float[np.ndarray, "n a"]
    """`pixels` by view, summed over slopes: a pair counts for the first of its two views."""


def vote(segments: Segments, views: Views, config: DirectionConfig) -> Votes:
    """Votes for each azimuth and slope."""
    azimuths, slopes = bins(config)
    if not len(segments.owner):
        return no_votes(views, config)
    limits = (config.least_angle, config.full_angle, config.least_overlap, math.tan(config.max_slope_rad))
    first = np.searchsorted(segments.owner, np.arange(len(views.R) + 1))
    pairs = pairs_of_views(views, config.partners)
    by_view = np.zeros((len(views.R), 3, len(azimuths), len(slopes)))
    share(votes_of_views, segments, views, first, pairs, limits, by_view, of=len(views.R))
    pixels, all_pixels, footprints = by_view.sum(0)
    return Votes(pixels, all_pixels, footprints, by_view[:, 0].sum(2))


def no_votes(views: Views, config: DirectionConfig) -> Votes:
    """Those of no segments."""
    azimuths, slopes = bins(config)
    none = np.zeros((len(azimuths), len(slopes)))
    return Votes(none, none, none, np.zeros((len(views.R), len(azimuths))))


def pairs_of_views(views: Views, most: int) -> Bool[np.ndarray, "2 n n"]:
    """Whether two views are a pair: one is among `most` partners of the other.  Each pair once.

    First the pairs whose partners are the nearest; then those whose partners are, the farther, the fewer of
    all views: the nearest ones of a film all stand beside it, where planes of far lines hardly differ.
    """
    distance = np.linalg.norm(views.centre[:, None] - views.centre, axis=2)
    rank = np.argsort(np.argsort(distance, axis=1, kind="stable"), axis=1, kind="stable")
    others = len(distance) - 1
    k = np.arange(1, min(most, others) + 1)
    chosen = np.zeros((2, others + 1), bool)
    chosen[0, k] = True
    chosen[1, k + np.round((others - len(k)) * (k / len(k)) ** 3).astype(int)] = True
    partner = chosen[:, rank]
    return np.triu(partner | partner.transpose(0, 2, 1), 1)


@njit(cache=True, error_model="numpy")
@no_type_check
def votes_of_views(segments, views, first, pairs, limits, votes, start, stop):
    """Into votes (n, 3, a, e): those of each view's pairs with the views after it, as in `Votes`.

    pairs: as `pairs_of_views` gives them.
    """
    least_angle, full_angle, least_overlap, steepest = limits
    (_, normal, ends, length), centre = segments, views.centre
    side = np.sqrt(1.0 * views.sizes[:, 0] * views.sizes[:, 1])
    for n in range(start, stop):
        for a in range(first[n], first[n + 1]):
            for other in range(n + 1, len(centre)):
                if not (pairs[0, n, other] or pairs[1, n, other]):
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
                    part = both / max(max(high, end) - min(low, begin), 1e-12)
                    if part < least_overlap:
                        continue
                    azimuth, slope = np.arctan2(dy, dx), np.arctan2(dz, level)
                    if azimuth < 0:
                        azimuth, slope = azimuth + np.pi, -slope
                    i = int(azimuth / np.pi * votes.shape[2]) % votes.shape[2]
                    k = int((slope / np.arctan(steepest) + 1) / 2 * votes.shape[3])
                    k = min(max(k, 0), votes.shape[3] - 1)
                    weight = part * min(length[a], length[b]) * min(sine, full_angle) / full_angle
                    if pairs[0, n, other]:
                        votes[n, 0, i, k] += weight
                    if pairs[1, n, other]:
                        mine = (high - low) / length[a] * side[n]
                        theirs = (end - begin) / length[b] * side[other]
                        votes[n, 1, i, k] += weight
                        votes[n, 2, i, k] += weight * np.log(max(mine * theirs, 1e-300)) / 2


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


def strongest(votes: Votes, searched: Sequence[float], config: DirectionConfig) -> Direction:
    """The direction with most votes; not near azimuths that were searched before.

    It has more than its neighbours: what lies beside a direction that was searched, and that still has votes
    because nothing was found, is no other direction.
    """
    azimuths, slopes = bins(config)
    around = _around(votes.pixels, config)
    best = around.max(1)
    usual = float(np.median(best))
    reach = round(config.apart_rad / config.step_rad)
    left = np.where(best < maximum_filter1d(best, 2 * reach + 1, mode="wrap"), 0.0, best)
    for azimuth in searched:
        turn = np.abs((azimuths - azimuth + np.pi / 2) % np.pi - np.pi / 2)
        left[turn < config.apart_rad] = 0.0
    k = int(left.argmax())
    turn = (azimuths - azimuths[k] + np.pi / 2) % np.pi - np.pi / 2
    votes_near = np.where(np.abs(turn) <= config.peak_rad, np.maximum(best - usual, 0.0), 0.0)
    aside = float(votes_near @ turn) / max(float(votes_near.sum()), 1e-12)
    e = int(around[k].argmax())
    excess = (float(left[k]) - usual) / (usual + config.few_px)
    middle = Direction(float(azimuths[k]), 0.0, excess, _footprint(votes, k, e, config))
    # To a microradian: sums in another order must not change what is searched.
    return turned_to(middle, aside, float(slopes[e]))


def stands_out(direction: Direction, first: Direction | None, config: DirectionConfig) -> bool:
    """Whether a direction has enough votes not to be faint.  first: the one that had most, if any had."""
    share = config.min_share * first.excess if first else 0.0
    return direction.excess >= max(config.min_excess, share)


def turned_to(direction: Direction, aside_rad: float, slope_rad: float) -> Direction:
    """A direction with another slope, and an azimuth so much larger, to a microradian."""
    azimuth, slope = direction.azimuth_rad + aside_rad, slope_rad
    if not 0 <= azimuth < np.pi:  # the same line from its other end
        azimuth, slope = azimuth % np.pi, -slope
    return replace(direction, azimuth_rad=round(azimuth, 6), slope_rad=round(slope, 6))


def given(azimuth_rad: float, votes: Votes, config: DirectionConfig) -> Direction:
    """An azimuth that is known, with the slope that lines vote for."""
    azimuths, slopes = bins(config)
    around = _around(votes.pixels, config)
    k = int(np.abs((azimuths - azimuth_rad + np.pi / 2) % np.pi - np.pi / 2).argmin())
    e = int(around[k].argmax())
    return Direction(azimuth_rad, float(slopes[e]), np.inf, _footprint(votes, k, e, config))


def flown(views: Views, config: DirectionConfig) -> float | None:
    """The azimuth along which the cameras flew from image to image; None where they flew as much across it.

    Each step counts alike: from one pass to the next it is long, and across.
    """
    steps = np.diff(views.centre[:, :2], axis=0)
    length = np.linalg.norm(steps, axis=1)
    ways = steps[length > 0] / length[length > 0, None]
    (across, along), axes = np.linalg.eigh(ways.T @ ways)
    if not along > config.elongated**2 * max(float(across), 0.0):
        return None
    return float(np.arctan2(axes[1, 1], axes[0, 1])) % np.pi


def _footprint(votes: Votes, k: int, e: int, config: DirectionConfig) -> float:
    """The geometric mean of the footprints of the pairs that vote for a direction; 0 where none does."""
    pixels, footprints = (_around(part, config)[k, e] for part in (votes.all_pixels, votes.footprints))
    return round(float(np.exp(footprints / pixels)), 6) if pixels > 0 else 0.0


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
