"""Which way lines run: the planes of thin lines in posed images vote for directions in space.

A line in space with direction d lies in the planes of all views that show it: n . d = 0 for each normal n.
For every azimuth each plane holds one direction; its slope is where the plane votes.  Where lines run, planes
of many views meet in one azimuth *and* slope; what else there is spreads over all of them (Bretscher et al.
call such planes interpretation planes; the vote is a Hough transform).

Letters: m ridge pixels; a azimuths in [0, pi) from the scene's x towards its y; e slopes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import uniform_filter1d

from plnerf.detect.config_lines import DirectionConfig
from plnerf.detect.line_maps import LineMaps


@dataclass(frozen=True)
class Direction:
    """A direction in which lines run."""

    azimuth_rad: float
    """From the scene's x towards its y, in [0, pi)."""
    slope_rad: float
    """Upwards along the azimuth."""
    excess: float
    """Votes over those of the median azimuth, as a fraction of these."""

    @property
    def vector(self) -> Float[np.ndarray, "3"]:
        """Unit vector."""
        flat = np.cos(self.slope_rad)
        return np.array([
            flat * np.cos(self.azimuth_rad), flat * np.sin(self.azimuth_rad), np.sin(self.slope_rad),
        ])  # fmt: skip


def vote(maps: LineMaps, config: DirectionConfig) -> Float[np.ndarray, "a e"]:
    """Votes for each azimuth and slope, of those that respond clearly.

    Each has the weight of its response, divided among all the azimuths that it may vote for: a plane that
    lies nearly level holds a direction of every azimuth, and says next to nothing of which.
    """
    clear = maps.response >= config.min_response
    normal, weight = maps.normal[clear].astype(np.float64), maps.response[clear].astype(np.float64)
    upward = np.where(normal[:, 2] < 0, -1.0, 1.0)[:, None] * normal
    azimuths, slopes = bins(config)
    level = np.tan(config.max_slope_rad) * upward[:, 2] / np.maximum(np.hypot(*upward[:, :2].T), 1e-12)
    share = 2 / np.pi * np.arcsin(np.minimum(level, 1.0))  # of azimuths in which its slope is not too steep
    weight /= np.maximum(share, 1 / len(azimuths))
    edges = np.append(slopes - config.step_rad / 2, slopes[-1] + config.step_rad / 2)
    votes = np.zeros((len(azimuths), len(slopes)))
    for k, azimuth in enumerate(azimuths):
        along = upward[:, 0] * np.cos(azimuth) + upward[:, 1] * np.sin(azimuth)
        votes[k] = np.histogram(np.arctan2(-along, upward[:, 2]), bins=edges, weights=weight)[0]
    return votes


def strongest(
    votes: Float[np.ndarray, "a e"], searched: Sequence[float], config: DirectionConfig
) -> Direction:
    """The direction with most votes; not near azimuths that were searched before."""
    azimuths, slopes = bins(config)
    around = _with_sag(votes, config)
    # Steep planes of few views vote for single bins, which by chance may be any near the direction.
    width = max(1, round(config.smooth_rad / config.step_rad))
    best = uniform_filter1d(around.max(1), width, mode="wrap")
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
    return Direction(round(float(azimuth), 6), slope, excess / max(usual, 1e-12))


def given(azimuth_rad: float, votes: Float[np.ndarray, "a e"], config: DirectionConfig) -> Direction:
    """An azimuth that is known, with the slope that lines vote for."""
    azimuths, slopes = bins(config)
    around = _with_sag(votes, config)
    k = int(np.abs((azimuths - azimuth_rad + np.pi / 2) % np.pi - np.pi / 2).argmin())
    return Direction(azimuth_rad, float(slopes[around[k].argmax()]), np.inf)


def _with_sag(votes: Float[np.ndarray, "a e"], config: DirectionConfig) -> Float[np.ndarray, "a e"]:
    """Votes within the slopes that sag adds to that of the chord."""
    width = max(1, round(2 * config.sag_rad / config.step_rad))
    around: Float[np.ndarray, "a e"] = uniform_filter1d(votes, width, axis=1, mode="constant") * width
    return around


def bins(config: DirectionConfig) -> tuple[Float[np.ndarray, " a"], Float[np.ndarray, " e"]]:
    """The azimuths and slopes that are voted for."""
    count = round(config.max_slope_rad / config.step_rad)
    return (
        np.arange(0.0, np.pi - 1e-9, np.pi / round(np.pi / config.step_rad)),
        config.step_rad * np.arange(-count, count + 1),
    )
