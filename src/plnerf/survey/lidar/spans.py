"""Spans: the tracks that hang side by side between the same supports, in their order along the line.

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

from plnerf.survey.lidar.linear import Lines
from plnerf.survey.lidar.tracks import MISFIT_M, Track, fit_track, near

PARALLEL = np.cos(np.radians(5.0))
OVERLAP = 0.5
"""Share of a track beside which another must run to hang in the same span."""
CLOSE_M, WIDE_M, EVEN_M, EVEN_SHARE = 8.0, 20.0, 15.0, 0.15
"""Tracks so near side by side belong together; wider apart only where both ends are side by side too, but for
so many metres or such a share of the length: lines that run in parallel have towers of their own."""
LEAST_SPAN_M = 30.0
"""A span that stands alone is at least so long: booms and crossarms are shorter."""
MEET_M = 15.0
"""Ends of spans so near to each other hang on one support."""
SHARPEST_BEND = np.cos(np.radians(60.0))
"""Of a line at a support: what leaves at more is a crossarm."""
SECTION_M, BESIDE_M = 0.6, 8.0
"""Cells of a span's cross-section, and how far beside its tracks more are looked for."""
FEW, SPREAD = 8, 0.4
"""Places of a wire that was not followed, and the share of the span's tenths that must hold one."""


@dataclass(frozen=True, eq=False)
class Span:
    """Tracks between two supports, of which the cloud may not show one or both."""

    tracks: tuple[Track, ...]
    o: Float[np.ndarray, "2"]
    u: Float[np.ndarray, "2"]
    ends: tuple[float, float]

    def flat(self, points: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n 2"]:
        """s and y of points."""
        return (points[:, :2] - self.o) @ np.stack([self.u, [-self.u[1], self.u[0]]], 1)

    @property
    def length_m(self) -> float:
        return self.ends[1] - self.ends[0]

    def end(self, last: bool) -> Float[np.ndarray, "t 3"]:
        """The tracks' points at one end of the span."""
        s = self.ends[int(last)]
        points = []
        for track in self.tracks:
            at = float((self.o + s * self.u - track.o) @ track.u)
            points.append(track.points(np.array([at]))[0])
        return np.array(points)


def spans(tracks: Sequence[Track], found: Lines) -> list[Span]:
    """Spans in their order along the line, all directed along it, with wires that only their sum shows."""
    pairs = [(i, j) for i, j in combinations(range(len(tracks)), 2) if _side_by_side(tracks[i], tracks[j])]
    together = _span_of([[tracks[k] for k in group] for group in _groups(len(tracks), pairs)])
    long = [span for span in together if span.length_m >= LEAST_SPAN_M]
    short = [span for span in together if span.length_m < LEAST_SPAN_M]
    kept = long + [span for span in short if any(meet(span, other) is not None for other in long)]
    if not kept:
        return []
    ends = np.array([span.end(last)[:, :2].mean(0) for span in kept for last in (False, True)])
    main = np.linalg.svd(ends - ends.mean(0), full_matrices=False)[2][0]
    main = main if (main[0], main[1]) > (0, 0) else -main
    directed = [span if span.u @ main >= 0 else _turned(span) for span in kept]
    order = np.argsort((ends[::2] + ends[1::2]) @ main, kind="stable")
    return [_completed(directed[k], tracks, found) for k in order]


def meet(one: Span, other: Span) -> tuple[bool, bool] | None:
    """Which ends (True: the last) of two spans hang on one support, if any do."""
    if abs(one.u @ other.u) < SHARPEST_BEND:
        return None
    best, ends = MEET_M, None
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


def _side_by_side(one: Track, other: Track) -> bool:
    if abs(one.u @ other.u) < PARALLEL:
        return False
    ends = one.local(other.points(np.array(other.ends)))
    low, high = ends[:, 0].min(), ends[:, 0].max()
    both = min(high, one.ends[1]) - max(low, one.ends[0])
    uneven = max(abs(high - one.ends[1]), abs(low - one.ends[0]))
    even = uneven <= max(EVEN_M, EVEN_SHARE * one.length_m)
    apart = float(np.abs(ends[:, 1]).mean())
    beside = both >= OVERLAP * min(one.length_m, other.length_m)
    return bool(beside and (apart <= CLOSE_M or (apart <= WIDE_M and even)))


def _span_of(groups: list[list[Track]]) -> list[Span]:
    """Directed as the longest track; from where half of its longer tracks begin to where half end."""
    made = []
    for tracks in groups:
        first = max(tracks, key=lambda track: track.length_m)
        span = Span(tuple(tracks), first.middle[:2], first.u, (0.0, 0.0))
        long = [track for track in tracks if track.length_m > first.length_m / 2]
        s = np.array([np.sort(span.flat(track.points(np.array(track.ends)))[:, 0]) for track in long])
        made.append(Span(span.tracks, span.o, span.u, (float(np.median(s[:, 0])), float(np.median(s[:, 1])))))
    return made


def _turned(span: Span) -> Span:
    return Span(span.tracks, span.o, -span.u, (-span.ends[1], -span.ends[0]))


def _completed(span: Span, tracks: Sequence[Track], found: Lines) -> Span:
    """With the wires that were too sparse or too short to be followed.

    Where the span's common hang is taken out, a wire's places gather in one cell of the cross-section.
    """
    at = np.concatenate([found.at, found.loose])
    for track in tracks:
        at = at[~near(track, at, 3.0)]
    s, y = span.flat(at).T
    sides = span.flat(np.array([track.middle for track in span.tracks]))[:, 1]
    inside = (s >= span.ends[0] - 1) & (s <= span.ends[1] + 1)
    inside &= (y >= sides.min() - BESIDE_M) & (y <= sides.max() + BESIDE_M)
    at, s, y = at[inside], s[inside], y[inside]
    hang = max(span.tracks, key=lambda track: track.places)
    z = hang.local(at)[:, 2]
    more = []
    while len(at) >= FEW:
        cell = np.stack([y - y.min(), z - z.min()], 1) / SECTION_M
        counts = np.zeros(cell.max(0).astype(int) + 2)
        np.add.at(counts, tuple(cell.astype(int).T), 1.0)
        sums = uniform_filter(counts, 2, mode="constant", origin=-1) * 4  # of each cell and the next ones
        best = np.array(np.unravel_index(sums.argmax(), sums.shape))
        if sums.max() < FEW:
            break
        chosen = ((cell >= best) & (cell < best + 2)).all(1)
        tenths = np.unique(((s[chosen] - span.ends[0]) / span.length_m * 10).astype(int))
        if len(tenths) >= 10 * SPREAD:
            track = fit_track(at[chosen])
            if np.sqrt((track.local(at[chosen])[:, 1:] ** 2).mean(0)).max() <= MISFIT_M:
                more.append(track)
                chosen |= near(track, at, 3.0)
        at, s, y, z = at[~chosen], s[~chosen], y[~chosen], z[~chosen]
    return Span((*span.tracks, *more), span.o, span.u, span.ends)
