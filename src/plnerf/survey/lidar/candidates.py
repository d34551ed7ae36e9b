"""Every wire of the spans in a cloud: its points, its curve, and the evidence for it.

Letters: n points that are above the ground; s along a track or a wire's base; metres, z up.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.polynomial.polynomial import polyval
from scipy.spatial import cKDTree

from plnerf.line.base import Base, jacobian
from plnerf.line.curve import vertical_sag
from plnerf.line.ends import Evidence
from plnerf.line.wire import Wire
from plnerf.survey.fit import fit_wire
from plnerf.survey.lidar.bundles import split
from plnerf.survey.lidar.config import LidarConfig, WireConfig
from plnerf.survey.lidar.parabola import Parabola, fit_parabola
from plnerf.survey.lidar.spans import TrackSpan
from plnerf.survey.lidar.structures import Holder, Outline


@dataclass(frozen=True, eq=False)
class Candidate:
    """A wire that was found, before it is known what it is called and what holds it."""

    span: int
    """Index of its span."""
    wire: Wire
    points: Int[np.ndarray, " m"]
    """Indices of its points."""
    bow_m: float
    """How far its points bow sideways from its curve."""
    misfit_m: float
    """Root mean square of its stretches' mean heights above or below its curve."""
    seen: tuple[bool, bool]
    """Whether its ends are at structures."""

    @property
    def drop_m(self) -> float:
        """Greatest vertical drop below the chord between its ends, attached or not."""
        return self.wire.drop_between(0.0, self.wire.base.length_m)


def find_wires(
    spans: Sequence[TrackSpan], outlines: Sequence[Outline], holders: Sequence[tuple[Holder, Holder]],
    points: Float[np.ndarray, "n 3"], taken: Bool[np.ndarray, " n"], config: LidarConfig,
) -> list[Candidate]:  # fmt: skip
    """Every wire once, span by span and in each from the left to the right.

    points: what is above the ground; taken: which of them belong to structures.
    """
    found: list[Candidate] = []
    for number, (span, hold) in enumerate(zip(spans, holders, strict=True)):
        by = [outlines[k] if isinstance(k, int) else None for k in hold]
        mine: list[Candidate] = []
        for track in span.tracks:
            mine += _of_track(track, by, span, number, points, config)
        kept: list[Candidate] = []
        for one in sorted(mine, key=lambda one: -len(one.points)):
            if not any(_same(one.wire, other.wire, config.wire.same_m) for other in kept):
                kept.append(one)
        alone = span.length_m >= config.span.min_length_m
        if alone and not any(_surely_hangs(one, config.wire) for one in kept):
            continue
        left = [-span.flat(_middle(one.wire)[None])[0, 1] for one in kept]
        found += [kept[k] for k in np.argsort(left, kind="stable")]
    clear = _clear(found, points, taken, config.wire)
    return [one for one, good in zip(found, clear, strict=True) if good]


def _middle(wire: Wire) -> Float[np.ndarray, "3"]:
    return wire.points(np.array([wire.base.length_m / 2]))[0]


def _of_track(
    track: Parabola, by: Sequence[Outline | None], span: TrackSpan, number: int,
    points: Float[np.ndarray, "n 3"], config: LidarConfig,
) -> list[Candidate]:  # fmt: skip
    """The wires of a track between its structures; number: the span's."""
    own = config.wire
    index = np.flatnonzero(track.near(points, own.end_m))
    for outline, inward in zip(by, (1.0, -1.0), strict=True):
        if outline is not None:
            along = outline.flat(points[index])[:, 0] * np.sign(outline.u @ span.u) * inward
            index = index[along >= own.clamp_m]
    if len(index) < own.min_points:
        return []
    track = fit_parabola(points[index], config.track)
    if track.u @ span.u < 0:
        track = track.turned()
    index = np.flatnonzero(track.near(points, 0.0))
    limits = [_axis(track, outline) for outline in by]
    least = min(config.span.min_length_m, own.min_span_share * span.length_m)
    made = [
        _candidate(track, curve, points, index[mine], limits, number, config)
        for curve, mine in split(track, track.local(points[index]), config.bundle, config.track)
    ]
    return [one for one in made if one is not None and one.wire.base.length_m >= least]


def _axis(track: Parabola, outline: Outline | None) -> float | None:
    """Where along a track its structure's axis is."""
    if outline is None:
        return None
    ends = np.array(track.ends)
    low, high = outline.flat(track.points(ends))[:, 0]
    return float(ends[0] - low * (ends[1] - ends[0]) / (high - low))


def _candidate(
    track: Parabola, off: Float[np.ndarray, "3 2"], points: Float[np.ndarray, "n 3"],
    index: Int[np.ndarray, " m"], limits: Sequence[float | None], number: int, config: LidarConfig,
) -> Candidate | None:  # fmt: skip
    """A wire between its ends from the points that may be its own; None where it is no wire."""
    own = config.wire
    local = track.local(points[index])
    t = (local[:, 0] - sum(track.ends) / 2) / (track.length_m / 2)
    apart = local[:, 1:] - polyval(t, off).T
    sigma = np.maximum(1.4826 * np.median(np.abs(apart), axis=0), own.min_sigma_m)
    good = np.flatnonzero((np.abs(apart) <= own.outlier_sigmas * sigma).all(1))
    if len(good):
        good = good[_without_gap(local[good, 0], own)]
    if len(good) < own.min_points or np.sqrt((apart[good] ** 2).mean(0)).max() > own.max_spread_m:
        return None
    s = local[good, 0]
    ends, seen = [float(s.min()), float(s.max())], [False, False]
    for k, limit in enumerate(limits):
        if limit is not None and abs(limit - ends[k]) <= own.end_m:
            ends[k], seen[k] = limit, True
    length = ends[1] - ends[0]
    if length < own.min_length_m:
        return None
    a, b = track.points(np.array(ends))[:, :2]
    mine = points[index[good]]
    wire = fit_wire(mine, Base(a, b), config.fit)[0]
    wire = replace(wire, evidence=_evidence(wire, s, (ends[0], ends[1]), own.uncovered_gap_m))
    bow = abs(float(track.y[2] + off[2, 0] / (track.length_m / 2) ** 2)) * length**2 / 4
    left = _bow(wire, mine) if bow else 0.0  # short ones say nothing of it
    found = Candidate(number, wire, index[good], left, _misfit(wire, mine, own.stretches), (seen[0], seen[1]))
    swings = max(own.reported_bow_m, config.track.max_bow_share * found.drop_m)
    deep = found.drop_m > config.track.max_sag_share * wire.base.length_m
    if wire.evidence.coverage < own.min_coverage or deep or bow > swings:
        return None
    if found.drop_m + own.taut_sigmas * _drop_sigma(wire) < _straightest(wire, own):
        return None
    return found


def _evidence(wire: Wire, s: Float[np.ndarray, " m"], ends: tuple[float, float], longest: float) -> Evidence:
    """What its points at s along its track show of a wire between its ends."""
    at = np.concatenate([[ends[0]], np.sort(s), [ends[1]]])
    gaps = np.diff(at)
    wide = np.flatnonzero(gaps > longest)
    covered = 1 - float(gaps[wide].sum()) / (ends[1] - ends[0])
    stretches = None
    if len(wide):
        per_s = wire.base.length_m / (ends[1] - ends[0])
        low, high = np.append(0, wide + 1), np.append(wide, len(at) - 1)
        where = (at[np.stack([low, high], 1)] - ends[0]) * per_s
        stretches = tuple((float(first), float(last)) for first, last in where if last > first)
    return replace(
        wire.evidence, source=f"{len(s):,} points", count=len(s), coverage=covered,
        longest_gap_m=float(gaps.max()), seen_m=stretches,
    )  # fmt: skip


def _drop_sigma(wire: Wire) -> float:
    """Standard deviation of the drop below the chord."""
    length = wire.base.length_m
    J = jacobian(lambda theta: np.array([vertical_sag(theta, length)]), wire.theta)[0]
    return float(np.sqrt(J @ wire.covariance @ J))


def _straightest(wire: Wire, config: WireConfig) -> float:
    """Drop below its chord of the tautest wire of this length."""
    return wire.base.length_m**2 / (8 * config.max_p_m)


def _bow(wire: Wire, points: Float[np.ndarray, "m 3"]) -> float:
    """How far the points of a wire bow sideways from it over its whole length, by a parabola."""
    local = wire.base.local(points)
    t = local[:, 0] / wire.base.length_m
    A = np.stack([np.ones_like(t), t, 4 * t * (1 - t)], 1)
    return abs(float(np.linalg.lstsq(A, local[:, 1] - wire.at(local[:, 0])[:, 0], rcond=None)[0][2]))


def _misfit(wire: Wire, points: Float[np.ndarray, "m 3"], stretches: int) -> float:
    local = wire.base.local(points)
    up = local[:, 2] - wire.at(local[:, 0])[:, 1]
    share = np.clip(local[:, 0] / wire.base.length_m, 0, 1 - 1e-9)
    stretch = np.floor(share * stretches).astype(int)
    count = np.bincount(stretch, minlength=stretches)
    mean = np.bincount(stretch, up, stretches) / np.maximum(count, 1)
    return float(np.sqrt(np.average(mean**2, weights=count)))


def _without_gap(s: Float[np.ndarray, " m"], config: WireConfig) -> Bool[np.ndarray, " m"]:
    """Which points belong to the longest stretch without a gap that is out of proportion to their spacing."""
    order = np.argsort(s, kind="stable")
    gaps = np.diff(s[order])
    longest = max(config.min_break_m, config.break_spacings * float(np.ptp(s)) / len(s))
    stretch = np.concatenate([[0], np.cumsum(gaps > longest)])
    length = [np.ptp(s[order][stretch == k]) for k in range(stretch[-1] + 1)]
    keep = np.zeros(len(s), np.bool_)
    keep[order[stretch == np.argmax(length)]] = True
    return keep


def _surely_hangs(one: Candidate, config: WireConfig) -> bool:
    """Whether a wire cannot be a straight bar, by what its points show."""
    least = max(config.min_drop_sigmas * _drop_sigma(one.wire), _straightest(one.wire, config))
    return one.drop_m > least


def _same(one: Wire, other: Wire, same_m: float) -> bool:
    """Whether two curves lie on each other where both are."""
    local = other.base.local(one.points(np.linspace(0, one.base.length_m, 40)))
    both = (local[:, 0] >= 0) & (local[:, 0] <= other.base.length_m)
    if not both.any():
        return False
    apart = local[both, 1:] - other.at(local[both, 0])
    return bool(np.linalg.norm(apart, axis=1).mean() < same_m)


def _clear(
    found: Sequence[Candidate], points: Float[np.ndarray, "n 3"], taken: Bool[np.ndarray, " n"],
    config: WireConfig,
) -> list[bool]:  # fmt: skip
    """Which wires hang free of what is neither wire nor structure."""
    rest = ~taken
    for one in found:
        rest[one.points] = False
    others = points[rest]
    if not len(others):
        return [True] * len(found)
    tree = cKDTree(others)
    clear = []
    for one in found:
        s = np.arange(config.piece_m / 2, one.wire.base.length_m, config.piece_m)
        beside = tree.query_ball_point(one.wire.points(s), config.beside_m, return_length=True)
        along = one.wire.base.local(points[one.points])[:, 0]
        edges = np.append(s - config.piece_m / 2, s[-1] + config.piece_m / 2)
        own = np.histogram(along, edges)[0]
        clear.append(bool((beside > np.maximum(own / 2, 1)).mean() <= config.max_cluttered_share))
    return clear
