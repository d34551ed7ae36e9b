"""Every wire of the spans in a cloud: its points, its catenary, and what speaks for it.

Letters: n points that are above the ground; s along a track; metres, z up.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.polynomial.polynomial import polyval
from scipy.spatial import cKDTree

from plnerf.survey.fit import Base, CatenaryFit, fit_catenary
from plnerf.survey.lidar.bundles import split
from plnerf.survey.lidar.spans import LEAST_SPAN_M, Span
from plnerf.survey.lidar.towers import Held, Support
from plnerf.survey.lidar.tracks import DEEPEST, MOST_SWING, Track, fit_track, near

END_M = 8.0
"""A wire whose points end so near to its support's axis hangs there: the string's length, or a shadow."""
CLAMP_M = 2.0
"""So near to a support's axis clamps and crossarms are taken for wire: not used for the curve."""
SHORTEST_M, FEWEST = 8.0, 10
GAP_M = 5.0
"""Longer stretches without a point are not covered (the longest sampling gap that ArcGIS Pro allows)."""
LEAST_COVERAGE = 0.25
SPREAD_M = 0.15
"""Root mean square distance of a wire's points beyond which it is none."""
BESIDE_M, PIECE_M, MOST_CLUTTERED = 1.0, 2.0, 0.5
"""In this share of its pieces at most may a wire have more than half as many other points within so many
metres as own ones: the edge of a roof or of a tree is no wire."""
SAME_M = 0.12
"""Two curves with this mean distance are one wire."""
TAUTEST_M = 6000.0
"""Greatest p: what surely hangs less is a beam or a rail, or held in between; conductors have 300 to 2500."""
SURELY_SIGMAS = 4.0
"""In a span that stands alone one wire's sag is at least so many standard deviations."""
STRETCHES = 12
MISFIT_M = 0.05
"""A misfit that is told."""
BOW_M = 0.1
"""A sideways bow that is told."""
LEAST_BREAK_M, BREAK_SPACINGS = 20.0, 12.0
"""A wire ends at a gap longer than this and than so many times the mean spacing of its points."""
LEAST_SHARE = 0.5
"""Of its span that a wire must have, unless it is as long as a span by itself."""


@dataclass(frozen=True, eq=False)
class Wire:
    """One conductor and its points."""

    span: int
    fit: CatenaryFit
    points: Int[np.ndarray, " m"]
    coverage: float
    longest_gap_m: float
    bow_m: float
    """Sideways, in the middle: what an upright curve leaves of a wire that the wind swings."""
    misfit_m: float
    """Root mean square of its stretches' mean heights above or below its catenary."""
    seen: tuple[bool, bool]
    """Whether its ends are at supports."""

    def middle(self) -> Float[np.ndarray, "3"]:
        curve = self.fit.curve
        return curve.points(np.array([curve.span_m / 2]))[0]


def wires(
    spans: Sequence[Span], supports: Sequence[Support], held: Sequence[Held],
    points: Float[np.ndarray, "n 3"], taken: Bool[np.ndarray, " n"],
) -> list[Wire]:  # fmt: skip
    """Every wire once, span by span and in each from the left to the right.

    points: what is above the ground; taken: which of them are supports'.
    """
    found: list[Wire] = []
    for number, (span, hold) in enumerate(zip(spans, held, strict=True)):
        by = [None if k is None else supports[k] for k in hold.by]
        mine: list[Wire] = []
        for track in span.tracks:
            mine += _of_track(track, by, span, number, points)
        kept: list[Wire] = []
        for wire in sorted(mine, key=lambda wire: -len(wire.points)):
            if not any(_same(wire, other) for other in kept):
                kept.append(wire)
        if span.length_m >= LEAST_SPAN_M and not any(_surely_hangs(wire) for wire in kept):
            continue
        left = [-span.flat(wire.middle()[None])[0, 1] for wire in kept]
        found += [kept[k] for k in np.argsort(left, kind="stable")]
    clear = _clear(found, points, taken)
    return [wire for wire, good in zip(found, clear, strict=True) if good]


def _of_track(
    track: Track, by: Sequence[Support | None], span: Span, number: int, points: Float[np.ndarray, "n 3"]
) -> list[Wire]:
    """The wires of a track between its supports; number: the span's."""
    index = np.flatnonzero(near(track, points, END_M))
    for support, inward in zip(by, (1.0, -1.0), strict=True):
        if support is not None:
            along = support.flat(points[index])[:, 0] * np.sign(support.u @ span.u) * inward
            index = index[along >= CLAMP_M]
    if len(index) < FEWEST:
        return []
    track = fit_track(points[index])
    if track.u @ span.u < 0:
        track = track.turned()
    index = np.flatnonzero(near(track, points, 0.0))
    limits = [_axis(track, support) for support in by]
    least = min(LEAST_SPAN_M, LEAST_SHARE * span.length_m)
    made = [
        _wire(track, curve, points, index[mine], limits, number)
        for curve, mine in split(track, track.local(points[index]))
    ]
    return [wire for wire in made if wire is not None and wire.fit.curve.span_m >= least]


def _axis(track: Track, support: Support | None) -> float | None:
    """Where along a track its support's axis is."""
    if support is None:
        return None
    ends = np.array(track.ends)
    low, high = support.flat(track.points(ends))[:, 0]
    return float(ends[0] - low * (ends[1] - ends[0]) / (high - low))


def _wire(
    track: Track, off: Float[np.ndarray, "3 2"], points: Float[np.ndarray, "n 3"],
    index: Int[np.ndarray, " m"], limits: Sequence[float | None], number: int,
) -> Wire | None:  # fmt: skip
    """A wire between its ends from the points that may be its own; None where it is no wire."""
    local = track.local(points[index])
    t = (local[:, 0] - sum(track.ends) / 2) / (track.length_m / 2)
    apart = local[:, 1:] - polyval(t, off).T
    sigma = np.maximum(1.4826 * np.median(np.abs(apart), axis=0), 0.02)
    good = np.flatnonzero((np.abs(apart) <= 4 * sigma).all(1))
    if len(good):
        good = good[_without_gap(local[good, 0])]
    if len(good) < FEWEST or np.sqrt((apart[good] ** 2).mean(0)).max() > SPREAD_M:
        return None
    s = local[good, 0]
    ends, seen = [float(s.min()), float(s.max())], [False, False]
    for k, limit in enumerate(limits):
        if limit is not None and abs(limit - ends[k]) <= END_M:
            ends[k], seen[k] = limit, True
    length = ends[1] - ends[0]
    if length < SHORTEST_M:
        return None
    gaps = np.diff(np.concatenate([[ends[0]], np.sort(s), [ends[1]]]))
    coverage = 1 - float(gaps[gaps > GAP_M].sum()) / length
    a, b = track.points(np.array(ends))[:, :2]
    straight = float(np.linalg.norm(b - a))
    fit = fit_catenary(points[index[good]], Base(a, (b - a) / straight, straight))
    sag = fit.curve.sag_m
    bow = abs(float(track.y[2] + off[2, 0] / (track.length_m / 2) ** 2)) * length**2 / 4
    if coverage < LEAST_COVERAGE or sag > DEEPEST * straight or bow > max(BOW_M, MOST_SWING * sag):
        return None
    if sag + 3 * fit.sag_sigma_m < straight**2 / (8 * TAUTEST_M):
        return None
    misfit = _misfit(fit, points[index[good]])
    return Wire(number, fit, index[good], coverage, float(gaps.max()), bow, misfit, (seen[0], seen[1]))


def _misfit(fit: CatenaryFit, points: Float[np.ndarray, "m 3"]) -> float:
    local = fit.base.local(points)
    up = local[:, 2] - fit.base.at(fit.q, local[:, 0])[:, 1]
    stretch = np.floor(np.clip(local[:, 0] / fit.base.length_m, 0, 1 - 1e-9) * STRETCHES).astype(int)
    count = np.bincount(stretch, minlength=STRETCHES)
    mean = np.bincount(stretch, up, STRETCHES) / np.maximum(count, 1)
    return float(np.sqrt(np.average(mean**2, weights=count)))


def _without_gap(s: Float[np.ndarray, " m"]) -> Bool[np.ndarray, " m"]:
    """Which points belong to the longest stretch without a gap that is out of proportion to their spacing."""
    order = np.argsort(s, kind="stable")
    gaps = np.diff(s[order])
    longest = max(LEAST_BREAK_M, BREAK_SPACINGS * float(np.ptp(s)) / len(s))
    stretch = np.concatenate([[0], np.cumsum(gaps > longest)])
    length = [np.ptp(s[order][stretch == k]) for k in range(stretch[-1] + 1)]
    keep = np.zeros(len(s), np.bool_)
    keep[order[stretch == np.argmax(length)]] = True
    return keep


def _surely_hangs(wire: Wire) -> bool:
    """Whether a wire is no straight bar for all that its points tell."""
    curve, sigma = wire.fit.curve, wire.fit.sag_sigma_m
    return curve.sag_m > max(SURELY_SIGMAS * sigma, curve.span_m**2 / (8 * TAUTEST_M))


def _same(one: Wire, other: Wire) -> bool:
    """Whether two curves lie on each other where both are."""
    curve = one.fit.curve
    points = curve.points(np.linspace(0, curve.span_m, 40))
    local = other.fit.base.local(points)
    both = (local[:, 0] >= 0) & (local[:, 0] <= other.fit.base.length_m)
    if not both.any():
        return False
    apart = local[both, 1:] - other.fit.base.at(other.fit.q, local[both, 0])
    return bool(np.linalg.norm(apart, axis=1).mean() < SAME_M)


def _clear(
    found: Sequence[Wire], points: Float[np.ndarray, "n 3"], taken: Bool[np.ndarray, " n"]
) -> list[bool]:
    """Which wires hang free of what is neither wire nor support."""
    rest = ~taken
    for wire in found:
        rest[wire.points] = False
    others = points[rest]
    if not len(others):
        return [True] * len(found)
    tree = cKDTree(others)
    clear = []
    for wire in found:
        curve = wire.fit.curve
        s = np.arange(PIECE_M / 2, curve.span_m, PIECE_M)
        beside = tree.query_ball_point(curve.points(s), BESIDE_M, return_length=True)
        along = wire.fit.base.local(points[wire.points])[:, 0]
        own = np.histogram(along, np.append(s - PIECE_M / 2, s[-1] + PIECE_M / 2))[0]
        clear.append(bool((beside > np.maximum(own / 2, 1)).mean() <= MOST_CLUTTERED))
    return clear
