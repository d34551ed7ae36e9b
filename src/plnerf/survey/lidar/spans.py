"""Spans: the tracks that hang side by side between the same structures, in their order along the line.

Letters: s along a span's direction u from o, y to its left; metres, z up.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Float
from scipy.ndimage import uniform_filter
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from plnerf.survey.lidar.config import LidarConfig, SpanConfig
from plnerf.survey.lidar.linear import Linear
from plnerf.survey.lidar.parabola import Parabola, fit_parabola


@dataclass(frozen=True, eq=False)
class TrackSpan:
    """Tracks between two structures, of which the cloud may not show one or both."""

    tracks: tuple[Parabola, ...]
    o: Float[np.ndarray, "2"]
    u: Float[np.ndarray, "2"]
    ends: tuple[float, float]

    def flat(self, points: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n 2"]:
        """s and y of points."""
        return (points[:, :2] - self.o) @ np.stack([self.u, [-self.u[1], self.u[0]]], 1)

    @property
    def length_m(self) -> float:
        """Between its ends."""
        return self.ends[1] - self.ends[0]

    def end(self, last: bool) -> Float[np.ndarray, "t 3"]:
        """The tracks' points at one end of the span, without tracks that end farther from it than
        they are long, if there are others: the curve of a few metres may be anywhere at the other end."""
        s = self.ends[int(last)]
        points, sure = [], []
        for track in self.tracks:
            at = float((self.o + s * self.u - track.o) @ track.u)
            points.append(track.points(np.array([at]))[0])
            sure.append(max(track.ends[0] - at, at - track.ends[1]) <= track.length_m)
        return np.array(points)[sure if any(sure) else slice(None)]


def find_spans(tracks: Sequence[Parabola], found: Linear, config: LidarConfig) -> list[TrackSpan]:
    """Spans in their order along the line, all directed along it, with wires that only their sum shows."""
    pairs = [
        (i, j)
        for i, j in combinations(range(len(tracks)), 2)
        if _side_by_side(tracks[i], tracks[j], config.span)
    ]
    together = _span_of([[tracks[k] for k in group] for group in _groups(len(tracks), pairs)])
    long = [span for span in together if span.length_m >= config.span.min_length_m]
    short = [span for span in together if span.length_m < config.span.min_length_m]
    kept = [
        *long,
        *(span for span in short if any(meet(span, other, config.span) is not None for other in long)),
    ]
    if not kept:
        return []
    ends = np.array([span.end(last)[:, :2].mean(0) for span in kept for last in (False, True)])
    main = np.linalg.svd(ends - ends.mean(0), full_matrices=False)[2][0]
    main = main if (main[0], main[1]) > (0, 0) else -main
    directed = [span if span.u @ main >= 0 else _turned(span) for span in kept]
    order = np.argsort((ends[::2] + ends[1::2]) @ main, kind="stable")
    return [_completed(directed[k], tracks, found, config) for k in order]


def meet(one: TrackSpan, other: TrackSpan, config: SpanConfig) -> tuple[bool, bool] | None:
    """Which ends (True: the last) of two spans hang on one structure, if any do."""
    if abs(one.u @ other.u) < np.cos(np.radians(config.max_bend_deg)):
        return None
    best, ends = config.max_meeting_m, None
    for mine in (False, True):
        for its in (False, True):
            apart = one.end(mine).mean(0) - other.end(its).mean(0)
            inward = (one.u * (1 - 2 * mine)) @ (other.u * (1 - 2 * its)) < 0
            if inward and np.linalg.norm(apart[:2]) < best:
                best, ends = float(np.linalg.norm(apart[:2])), (mine, its)
    return ends


def _groups(count: int, pairs: list[tuple[int, int]]) -> list[np.ndarray]:
    one, other = np.array(pairs, np.int64).reshape(-1, 2).T
    graph = coo_array((np.ones(len(one)), (one, other)), shape=(count, count))
    number, group = connected_components(graph, directed=False)
    return [np.flatnonzero(group == k) for k in range(number)]


def _side_by_side(one: Parabola, other: Parabola, config: SpanConfig) -> bool:
    if abs(one.u @ other.u) < np.cos(np.radians(config.max_angle_deg)):
        return False
    ends = one.local(other.points(np.array(other.ends)))
    low, high = ends[:, 0].min(), ends[:, 0].max()
    both = min(high, one.ends[1]) - max(low, one.ends[0])
    uneven = max(abs(high - one.ends[1]), abs(low - one.ends[0]))
    even = uneven <= max(config.even_m, config.even_share * one.length_m)
    apart = float(np.abs(ends[:, 1]).mean())
    beside = both >= config.min_overlap * min(one.length_m, other.length_m)
    return bool(beside and (apart <= config.close_m or (apart <= config.wide_m and even)))


def _span_of(groups: list[list[Parabola]]) -> list[TrackSpan]:
    """Directed as the longest track; from where half of its longer tracks begin to where half end."""
    made = []
    for tracks in groups:
        first = max(tracks, key=lambda track: track.length_m)
        span = TrackSpan(tuple(tracks), first.middle[:2], first.u, (0.0, 0.0))
        long = [track for track in tracks if track.length_m > first.length_m / 2]
        s = np.array([np.sort(span.flat(track.points(np.array(track.ends)))[:, 0]) for track in long])
        low, high = np.median(s, axis=0)
        made.append(TrackSpan(span.tracks, span.o, span.u, (float(low), float(high))))
    return made


def _turned(span: TrackSpan) -> TrackSpan:
    return TrackSpan(span.tracks, span.o, -span.u, (-span.ends[1], -span.ends[0]))


def _completed(span: TrackSpan, tracks: Sequence[Parabola], found: Linear, config: LidarConfig) -> TrackSpan:
    """A span with the wires that were too sparse or too short to be followed.

    Without the span's common hang, a wire's places gather in one cell of the cross-section.
    """
    own = config.span
    at = np.concatenate([found.at, found.loose])
    for track in tracks:
        at = at[~track.near(at, own.beyond_m)]
    s, y = span.flat(at).T
    sides = span.flat(np.array([track.middle for track in span.tracks]))[:, 1]
    inside = (s >= span.ends[0] - own.margin_m) & (s <= span.ends[1] + own.margin_m)
    inside &= (y >= sides.min() - own.beside_m) & (y <= sides.max() + own.beside_m)
    at, s, y = at[inside], s[inside], y[inside]
    hang = max(span.tracks, key=lambda track: track.places)
    z = hang.local(at)[:, 2]
    more = []
    while len(at) >= own.min_places:
        cell = np.stack([y - y.min(), z - z.min()], 1) / own.cell_m
        counts = np.zeros(cell.max(0).astype(int) + 2)
        np.add.at(counts, tuple(cell.astype(int).T), 1.0)
        sums = uniform_filter(counts, 2, mode="constant", origin=-1) * 4  # of each cell and the next ones
        best = np.array(np.unravel_index(sums.argmax(), sums.shape))
        if sums.max() < own.min_places:
            break
        chosen = ((cell >= best) & (cell < best + 2)).all(1)
        tenths = np.unique(((s[chosen] - span.ends[0]) / span.length_m * 10).astype(int))
        if len(tenths) >= 10 * own.min_tenths_share:
            track = fit_parabola(at[chosen], config.track)
            if track.spread(at[chosen]).max() <= config.track.max_misfit_m:
                more.append(track)
                chosen |= track.near(at, own.beyond_m)
        at, s, y, z = at[~chosen], s[~chosen], y[~chosen], z[~chosen]
    return TrackSpan((*span.tracks, *more), span.o, span.u, span.ends)
