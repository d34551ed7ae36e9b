"""Wires, or bundles of them, followed through the places on lines: from a short piece outwards, as far as one
hanging curve holds.

The growing of piecewise catenaries: Y. Jwa, G. Sohn, "A piecewise catenary curve model growing for power line
reconstruction", PE&RS 78(12), 2012.  While growing, a parabola in an upright plane stands for the catenary: a
span of 400 m that sags 12 m departs from it by 1 cm.  At a support the slope breaks, and the curve ends.

Letters: s along a track's horizontal direction u, y to its left, z up, all in metres; m places.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.polynomial.polynomial import polyval

from plnerf.survey.lidar.linear import ALIKE, Lines, pieces

SEED_M = 20.0
"""Pieces are cut to this length: a support within one would bend it."""
LEAST_M, LEAST_PLACES = 10.0, 8
LEAST_GATE_M, GATE_M, GATE_SIGMAS = 0.25, 0.6, 3.0
"""How far from the curve, sideways and in height, its places may lie: so many standard deviations, within
limits.  A bundle needs half its width; a single wire must not take its neighbour's places."""
STEP_M, STEP_SHARE, GAP_M = 5.0, 0.3, 20.0
"""At each step a track is looked for this far beyond its ends, or a share of its length if that is more, but
no farther than the longest gap."""
DEEPEST = 0.15
"""Sag as a share of the length beyond which nothing hangs on poles or towers."""
SWINGS_FROM_M, MOST_SWING = 60.0, 0.6
"""From this length on a track may bow sideways, up to this share of its hang (30 degrees)."""
MISFIT_M = 0.35
"""Root mean square distance of a seed from its curve beyond which it is not one."""
WORSE_M = 0.05
"""By how much two tracks may spread more about one curve than each about its own, if they are one."""
ROUNDS = 60
DECIMETRES = 0.1
"""Distances beyond which places count less (Cauchy)."""


@dataclass(frozen=True, eq=False)
class Track:
    """y = y0 + y1 s + y2 s^2 and z likewise for s in `ends`, counted from o; y2 is wind."""

    o: Float[np.ndarray, "2"]
    u: Float[np.ndarray, "2"]
    y: Float[np.ndarray, "3"]
    z: Float[np.ndarray, "3"]
    ends: tuple[float, float]
    places: int
    """How many it was fitted to."""
    gate_m: Float[np.ndarray, "2"]
    """How far off its own places may lie, sideways and in height."""

    @property
    def length_m(self) -> float:
        return self.ends[1] - self.ends[0]

    def local(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """s of points, and their distances y and z from the curve there."""
        flat = points[:, :2] - self.o
        s = flat @ self.u
        y = flat @ np.array([-self.u[1], self.u[0]])
        return np.stack([s, y - polyval(s, self.y), points[:, 2] - polyval(s, self.z)], 1)

    def points(self, s: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """World points of the curve."""
        flat = self.o + s[:, None] * self.u + polyval(s, self.y)[:, None] * np.array([-self.u[1], self.u[0]])
        return np.concatenate([flat, polyval(s, self.z)[:, None]], 1)

    def turned(self) -> "Track":
        """The same curve, directed the other way."""
        back, up = np.array([-1.0, 1.0, -1.0]), np.array([1.0, -1.0, 1.0])
        ends = (-self.ends[1], -self.ends[0])
        return Track(self.o, -self.u, self.y * back, self.z * up, ends, self.places, self.gate_m)

    @property
    def middle(self) -> Float[np.ndarray, "3"]:
        return self.points(np.array([sum(self.ends) / 2]))[0]


def fit_track(points: Float[np.ndarray, "m 3"]) -> Track:
    """The parabola through points, outliers counting less; it hangs, and wind swings it little."""
    o = points[:, :2].mean(0)
    u = np.linalg.svd(points[:, :2] - o, full_matrices=False)[2][0]
    u = u if (u[0], u[1]) > (0, 0) else -u
    flat = points[:, :2] - o
    s, across, up = flat @ u, flat @ np.array([-u[1], u[0]]), points[:, 2]
    line = np.stack([np.ones_like(s), s], 1)
    hanging = np.stack([np.ones_like(s), s, s * s], 1)
    z = _robust(hanging, up)
    if z[2] < 0:
        z = np.append(_robust(line, up), 0.0)
    y = _robust(hanging, across)
    if np.ptp(s) < SWINGS_FROM_M or abs(y[2]) > MOST_SWING * z[2]:
        y = np.append(_robust(line, across), 0.0)
    off = np.abs([across - polyval(s, y), up - polyval(s, z)])
    gate = np.clip(GATE_SIGMAS * 1.4826 * np.median(off, axis=1), LEAST_GATE_M, GATE_M)
    return Track(o, u, y, z, (float(s.min()), float(s.max())), len(points), gate)


def _robust(A: Float[np.ndarray, "m k"], b: Float[np.ndarray, " m"]) -> Float[np.ndarray, " k"]:
    """Least squares, weighted anew by Cauchy's function."""
    x = np.linalg.lstsq(A, b, rcond=None)[0]
    for _ in range(4):
        off = A @ x - b
        scale = max(1.4826 * float(np.median(np.abs(off))), DECIMETRES)
        root = 1 / np.sqrt(1 + (off / (2 * scale)) ** 2)
        x = np.linalg.lstsq(A * root[:, None], b * root, rcond=None)[0]
    return x


def tracks(found: Lines) -> list[Track]:
    """All wires and bundles, each once, those of the longest pieces first."""
    used = np.zeros(len(found.at), np.bool_)
    done: list[Track] = []
    for seed in (part for piece in pieces(found) for part in _parts(found.at, piece)):
        if used[seed].mean() > 0.5:
            continue
        track = _grown(found, seed)
        if track is None:
            continue
        used |= near(track, found.at)
        done.append(track)
    return sorted(_joined(done, found), key=lambda track: -track.length_m)


def _parts(at: Float[np.ndarray, "m 3"], piece: Int[np.ndarray, " k"]) -> list[np.ndarray]:
    """A piece cut into stretches of about `SEED_M`, short ones left out."""
    flat = at[piece, :2] - at[piece, :2].mean(0)
    s = flat @ np.linalg.svd(flat, full_matrices=False)[2][0]
    count = max(1, round(float(np.ptp(s)) / SEED_M))
    which = np.minimum(((s - s.min()) / max(float(np.ptp(s)), 1e-9) * count).astype(int), count - 1)
    parts = [piece[which == k] for k in range(count)]
    long = np.ptp(s) / count >= LEAST_M
    return [part for part in parts if long and len(part) >= LEAST_PLACES]


def _grown(found: Lines, seed: Int[np.ndarray, " k"]) -> Track | None:
    track = fit_track(found.at[seed])
    if _spread(track, found.at[seed]).max() > MISFIT_M or not _hangs(track):
        return None
    flat = found.along[:, :2] / np.linalg.norm(found.along[:, :2], axis=1)[:, None]
    parallel = np.flatnonzero(np.abs(flat @ track.u) >= ALIKE)
    at, before = np.concatenate([found.at[parallel], found.loose]), 0
    for _ in range(ROUNDS):
        mine = _reached(track, at)
        if len(mine) < LEAST_PLACES:
            return None
        grown = fit_track(at[mine])
        if len(mine) == before and abs(grown.length_m - track.length_m) < 0.01:
            break
        track, before = grown, len(mine)
    return track if track.length_m >= LEAST_M and _hangs(track) else None


def _hangs(track: Track) -> bool:
    """Whether its sag is possible."""
    return bool(track.z[2] * track.length_m / 4 <= DEEPEST)


def _reached(track: Track, at: Float[np.ndarray, "m 3"]) -> Int[np.ndarray, " k"]:
    """Places on the track and on both its continuations."""
    reach = min(max(STEP_M, STEP_SHARE * track.length_m), GAP_M)
    return np.flatnonzero(near(track, at, reach))


def near(track: Track, at: Float[np.ndarray, "m 3"], beyond_m: float = 1.0) -> Bool[np.ndarray, " m"]:
    """Which places lie within the gate of a track, or of its continuation this far beyond its ends."""
    local = track.local(at)
    inside = (local[:, 0] >= track.ends[0] - beyond_m) & (local[:, 0] <= track.ends[1] + beyond_m)
    return inside & (np.abs(local[:, 1:]) <= track.gate_m).all(1)


def _joined(parts: list[Track], found: Lines) -> list[Track]:
    """Tracks that one curve goes through, on either side of a gap, made one; the longest first."""
    left = sorted(parts, key=lambda track: -track.length_m)
    whole: list[Track] = []
    while left:
        track = left.pop(0)
        for other in list(left):
            both = _one_curve(track, other, found)
            if both is not None:
                track = both
                left.remove(other)
        whole.append(track)
    return whole


def _one_curve(track: Track, other: Track, found: Lines) -> Track | None:
    """A track through the places of both, if it leaves neither."""
    ends = track.local(other.points(np.array(other.ends)))
    gap = max(float(ends[:, 0].min()) - track.ends[1], track.ends[0] - float(ends[:, 0].max()))
    if gap > track.length_m or np.abs(ends[:, 1]).max() > 4 * GATE_M or abs(track.u @ other.u) < ALIKE:
        return None
    at = np.concatenate([found.at, found.loose])
    mine, its = at[near(track, at)], at[near(other, at)]
    both = fit_track(np.concatenate([mine, its]))
    worse = [_spread(both, mine) - _spread(track, mine), _spread(both, its) - _spread(other, its)]
    return both if np.max(worse) <= WORSE_M else None


def _spread(track: Track, points: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "2"]:
    """Root mean square distances of points from a track, sideways and in height."""
    return np.sqrt((track.local(points)[:, 1:] ** 2).mean(0))
