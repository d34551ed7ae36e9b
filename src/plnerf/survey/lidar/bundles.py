"""The wires of a track: those of a bundle are separated in its cross-section, with the hang taken out.

Letters: n points; s along the track, (y, z) off its curve; k wires; metres.
"""

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import gaussian_filter, map_coordinates, maximum_filter

from plnerf.survey.lidar.config import BundleConfig, TrackConfig
from plnerf.survey.lidar.parabola import Parabola


def split(
    track: Parabola, local: Float[np.ndarray, "n 3"], config: BundleConfig, tracks: TrackConfig
) -> list[tuple[Float[np.ndarray, "3 2"], Int[np.ndarray, " m"]]]:
    """Each wire of a track, and the indices of its points.

    local: s, y and z of points off the track's curve (`Parabola.local`), within its gate.  A wire is
    off(t) = (y0 + y1 t + y2 t^2, z0 + ...) with t = -1 and 1 at the track's ends, added to its own curve.
    """
    s, off = local[:, 0], local[:, 1:]
    peaks = _peaks(off, config, tracks.max_gate_m)
    curves = np.zeros((len(peaks), 3, 2))
    curves[:, 0] = peaks
    owner = np.zeros(len(local), np.int64)
    terms = 3 if track.length_m >= tracks.bow_from_m else 2
    middle, half = sum(track.ends) / 2, track.length_m / 2
    t = (s - middle) / half
    A = np.stack([np.ones_like(t), t, t * t], 1)
    for _ in range(config.rounds):
        gap = np.linalg.norm(np.einsum("ni,kij->nkj", A, curves) - off[:, None], axis=2)
        owner = np.where(gap.min(1) <= config.max_distance_m, gap.argmin(1), -1)
        for k in range(len(curves)):
            mine = owner == k
            if mine.sum() >= config.min_points and np.ptp(t[mine]) > 0.5:
                curves[k, :terms] = np.linalg.lstsq(A[mine, :terms], off[mine], rcond=None)[0]
    found = [np.flatnonzero(owner == k) for k in range(len(curves))]
    seen = [len(np.unique(np.floor(s[mine] / config.piece_m))) for mine in found]
    return [
        (curve, mine)
        for curve, mine, pieces in zip(curves, found, seen, strict=True)
        if len(mine) >= config.min_points and pieces >= config.min_share * max(seen)
    ]


def _peaks(off: Float[np.ndarray, "n 2"], config: BundleConfig, gate_m: float) -> Float[np.ndarray, "k 2"]:
    """Places of the cross-section where points gather, the most crowded first."""
    count = int(np.ceil(2 * gate_m / config.cell_m)) + 1
    cell = np.clip(((off + gate_m) / config.cell_m).astype(int), 0, count - 1)
    section = np.zeros((count, count))
    np.add.at(section, tuple(cell.T), 1.0)
    section = gaussian_filter(section, config.blur_m / config.cell_m, mode="constant")
    top = (section == maximum_filter(section, 3)) & (section >= config.min_peak * section.max())
    places = np.argwhere(top)[np.argsort(-section[top], kind="stable")]
    kept: list[np.ndarray] = []
    for place in places:
        if all(_two(section, place, other, config) for other in kept):
            kept.append(place)
    return (np.array(kept) + 0.5) * config.cell_m - gate_m


def _two(
    section: Float[np.ndarray, "r r"], lower: Int[np.ndarray, "2"], higher: Int[np.ndarray, "2"],
    config: BundleConfig,
) -> bool:  # fmt: skip
    """Whether the section falls between two peaks that are far enough apart."""
    between = np.linspace(lower, higher, 20).T
    valley = map_coordinates(section, between, order=1).min()
    apart = float(np.linalg.norm(lower - higher)) * config.cell_m
    return bool(apart >= config.min_apart_m and valley <= config.max_valley * section[tuple(lower)])
