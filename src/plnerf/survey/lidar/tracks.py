"""Follows wires, or bundles of them, through the places on lines: from a short piece outwards, as far as one
hanging curve fits.

The growing of piecewise catenaries: Y. Jwa, G. Sohn, "A piecewise catenary curve model growing for power line
reconstruction", PE&RS 78(12), 2012.  While growing, a parabola in an upright plane stands for the catenary.
At a structure the slope breaks, and the curve ends.

Letters: s along a track's horizontal direction u, metres; m places.
"""

import numpy as np
from jaxtyping import Float, Int

from plnerf.survey.lidar.config import LidarConfig, TrackConfig
from plnerf.survey.lidar.linear import Linear, pieces
from plnerf.survey.lidar.parabola import Parabola, fit_parabola


def find_tracks(found: Linear, config: LidarConfig) -> list[Parabola]:
    """All wires and bundles, each once, the longest first."""
    used = np.zeros(len(found.at), np.bool_)
    done: list[Parabola] = []
    cut = [_parts(found.at, piece, config.track) for piece in pieces(found, config.linear)]
    for seed in (part for parts in cut for part in parts):
        if used[seed].mean() > config.track.max_used_share:
            continue
        track = _grown(found, seed, config.track)
        if track is None:
            continue
        used |= track.near(found.at, config.track.beyond_m)
        done.append(track)
    return sorted(_joined(done, found, config.track), key=lambda track: -track.length_m)


def _parts(
    at: Float[np.ndarray, "m 3"], piece: Int[np.ndarray, " k"], config: TrackConfig
) -> list[np.ndarray]:
    """A piece cut into stretches of about `seed_length_m`, without the short ones."""
    flat = at[piece, :2] - at[piece, :2].mean(0)
    s = flat @ np.linalg.svd(flat, full_matrices=False)[2][0]
    count = max(1, round(float(np.ptp(s)) / config.seed_length_m))
    which = np.minimum(((s - s.min()) / max(float(np.ptp(s)), 1e-9) * count).astype(int), count - 1)
    parts = [piece[which == k] for k in range(count)]
    long = np.ptp(s) / count >= config.min_length_m
    return [part for part in parts if long and len(part) >= config.min_places]


def _grown(found: Linear, seed: Int[np.ndarray, " k"], config: TrackConfig) -> Parabola | None:
    """The track that a seed grows into; None where it is no hanging curve, or stays short."""
    track = fit_parabola(found.at[seed], config)
    if track.spread(found.at[seed]).max() > config.max_misfit_m or not _hangs(track, config):
        return None
    flat = found.along[:, :2] / np.linalg.norm(found.along[:, :2], axis=1)[:, None]
    parallel = np.flatnonzero(np.abs(flat @ track.u) >= _cosine(config))
    at, before = np.concatenate([found.at[parallel], found.loose]), 0
    for _ in range(config.max_rounds):
        reach = min(max(config.step_m, config.step_share * track.length_m), config.max_gap_m)
        mine = np.flatnonzero(track.near(at, reach))
        if len(mine) < config.min_places:
            return None
        grown = fit_parabola(at[mine], config)
        if len(mine) == before and abs(grown.length_m - track.length_m) < 0.01:
            break
        track, before = grown, len(mine)
    return track if track.length_m >= config.min_length_m and _hangs(track, config) else None


def _hangs(track: Parabola, config: TrackConfig) -> bool:
    """Whether its sag is possible."""
    return bool(track.z[2] * track.length_m / 4 <= config.max_sag_share)


def _cosine(config: TrackConfig) -> float:
    return float(np.cos(np.radians(config.max_angle_deg)))


def _joined(parts: list[Parabola], found: Linear, config: TrackConfig) -> list[Parabola]:
    """Merges tracks on either side of a gap that one curve fits; the longest first."""
    left = sorted(parts, key=lambda track: -track.length_m)
    whole: list[Parabola] = []
    while left:
        track = left.pop(0)
        for other in list(left):
            both = _one_curve(track, other, found, config)
            if both is not None:
                track = both
                left.remove(other)
        whole.append(track)
    return whole


def _one_curve(track: Parabola, other: Parabola, found: Linear, config: TrackConfig) -> Parabola | None:
    """The curve through the places of both; None where it fits either of them worse."""
    ends = track.local(other.points(np.array(other.ends)))
    gap = max(float(ends[:, 0].min()) - track.ends[1], track.ends[0] - float(ends[:, 0].max()))
    beside = np.abs(ends[:, 1]).max() > config.max_join_beside_m
    if gap > track.length_m or beside or abs(track.u @ other.u) < _cosine(config):
        return None
    at = np.concatenate([found.at, found.loose])
    mine, its = at[track.near(at, config.beyond_m)], at[other.near(at, config.beyond_m)]
    both = fit_parabola(np.concatenate([mine, its]), config)
    worse = [both.spread(mine) - track.spread(mine), both.spread(its) - other.spread(its)]
    return both if np.max(worse) <= config.max_worse_m else None
