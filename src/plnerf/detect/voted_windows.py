"""The windows along a direction whose own views vote for it.

A long line bends: each of its directions runs past the whole flight, but most windows along it show wires of
other directions alone, and their views vote for those.
"""

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from plnerf.detect.config import DetectConfig
from plnerf.detect.config_lines import DirectionConfig
from plnerf.detect.directions import Direction, Votes, bins
from plnerf.detect.views import Views
from plnerf.detect.windows import Window, windows_along


def voted_windows(direction: Direction, views: Views, votes: Votes, config: DetectConfig) -> list[Window]:
    """All windows along a direction where none has such votes, or where it is one window."""
    windows = list(windows_along(direction, views, config.windows))
    voted = [one for one in windows if is_voted(direction, votes.of_views[one.views], config.directions)]
    return voted or windows


def is_voted(direction: Direction, of_views: Float[np.ndarray, "k a"], config: DirectionConfig) -> bool:
    """Whether views have enough votes for a direction, and not more for another one little beside it."""
    azimuths, _ = bins(config)
    votes = gaussian_filter1d(of_views.sum(0), config.smooth_rad / config.step_rad, mode="wrap")
    usual = float(np.median(votes))
    aside = np.abs((azimuths - direction.azimuth_rad + np.pi / 2) % np.pi - np.pi / 2)
    near, around = (float(votes[aside <= reach].max()) for reach in (config.peak_rad, config.around_rad))
    excess = (near - usual) / (usual + config.few_px)
    return excess >= config.min_excess and near >= config.least_near * around
