"""The wires of a track: those of a bundle are told apart in the cross-section left without the hang.

Letters: n points; s along the track, (y, z) off its curve; k wires; metres.
"""

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import gaussian_filter, map_coordinates, maximum_filter

from plnerf.survey.lidar.tracks import GATE_M, SWINGS_FROM_M, Track

CELL_M = 0.04
BLUR_M = 0.06
"""Standard deviation by which the cross-section is smoothed: as the noise of a good cloud, so that wires four
times as far apart are two."""
LEAST_PEAK = 0.2
"""Of the highest: lower peaks are no wires."""
VALLEY = 0.6
"""Two peaks are two wires where the section between them falls below this share of the lower one."""
APART_M = 0.15
"""Wires are farther from each other: their clamps are."""
MINE_M = 0.25
"""Points farther from every wire belong to none."""
ROUNDS = 4
PIECE_M, LEAST_SHARE = 5.0, 0.4
"""A wire of a bundle has points in this share of the pieces of so many metres that its best seen one has."""
LEAST_POINTS = 8


def split(
    track: Track, local: Float[np.ndarray, "n 3"]
) -> list[tuple[Float[np.ndarray, "3 2"], Int[np.ndarray, " m"]]]:
    """Each wire of a track, and the indices of its points.

    local: s, y and z of points off the track's curve (`Track.local`), within its gate.  A wire is
    off(t) = (y0 + y1 t + y2 t^2, z0 + ...) with t = -1 and 1 at the track's ends, added to its own curve.
    """
    s, off = local[:, 0], local[:, 1:]
    peaks = _peaks(off)
    curves = np.zeros((len(peaks), 3, 2))
    curves[:, 0] = peaks
    owner = np.zeros(len(local), np.int64)
    terms = 3 if track.length_m >= SWINGS_FROM_M else 2
    middle, half = sum(track.ends) / 2, track.length_m / 2
    t = (s - middle) / half
    A = np.stack([np.ones_like(t), t, t * t], 1)
    for _ in range(ROUNDS):
        gap = np.linalg.norm(np.einsum("ni,kij->nkj", A, curves) - off[:, None], axis=2)
        owner = np.where(gap.min(1) <= MINE_M, gap.argmin(1), -1)
        for k in range(len(curves)):
            mine = owner == k
            if mine.sum() >= LEAST_POINTS and np.ptp(t[mine]) > 0.5:
                curves[k, :terms] = np.linalg.lstsq(A[mine, :terms], off[mine], rcond=None)[0]
    found = [np.flatnonzero(owner == k) for k in range(len(curves))]
    seen = [len(np.unique(np.floor(s[mine] / PIECE_M))) for mine in found]
    return [
        (curve, mine)
        for curve, mine, pieces in zip(curves, found, seen, strict=True)
        if len(mine) >= LEAST_POINTS and pieces >= LEAST_SHARE * max(seen)
    ]


def _peaks(off: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "k 2"]:
    """Places of the cross-section where points gather, the most crowded first."""
    count = int(np.ceil(2 * GATE_M / CELL_M)) + 1
    cell = np.clip(((off + GATE_M) / CELL_M).astype(int), 0, count - 1)
    section = np.zeros((count, count))
    np.add.at(section, tuple(cell.T), 1.0)
    section = gaussian_filter(section, BLUR_M / CELL_M, mode="constant")
    top = (section == maximum_filter(section, 3)) & (section >= LEAST_PEAK * section.max())
    places = np.argwhere(top)[np.argsort(-section[top], kind="stable")]
    kept: list[np.ndarray] = []
    for place in places:
        if all(_two(section, place, other) for other in kept):
            kept.append(place)
    return (np.array(kept) + 0.5) * CELL_M - GATE_M


def _two(
    section: Float[np.ndarray, "r r"], lower: Int[np.ndarray, "2"], higher: Int[np.ndarray, "2"]
) -> bool:
    """Whether the section falls between two peaks that are far enough apart."""
    between = np.linspace(lower, higher, 20).T
    valley = map_coordinates(section, between, order=1).min()
    apart = float(np.linalg.norm(lower - higher)) * CELL_M
    return bool(apart >= APART_M and valley <= VALLEY * section[tuple(lower)])
