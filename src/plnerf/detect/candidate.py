"""A line that may be a wire, and which of the lines are wires: those that hang.

Letters as in `sweep.py`; planes are those of the fit.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from plnerf.detect.config import SearchConfig, SelectConfig


@dataclass(frozen=True, eq=False)
class Candidate:
    """A curve fitted to ridges; scene frame."""

    theta: Float[np.ndarray, "5"]
    """(y_A, y_B, z_A, z_B, b) between the first and the last plane."""
    covariance: Float[np.ndarray, "5 5"]
    """Covariance of theta, in scene units squared."""
    rms_px: float
    """Root mean square distance of its ridges."""
    images: int
    """Views in which it has ridges."""
    odds: float = 0.0
    """Nats, over the planes in `seen`; 0 until the search has rated it."""
    seen: tuple[int, int] = (0, 0)
    """First and last plane of the stretch with the largest odds."""
    ends: tuple[int, int] = (0, 0)
    """First and last plane of the longer stretch with hardly any evidence against it."""

    @property
    def planes(self) -> int:
        """Length of the stretch that was seen."""
        return self.seen[1] - self.seen[0]


def select_wires(
    lines: Sequence[Candidate], length: float, select: SelectConfig, search: SearchConfig
) -> list[Candidate]:
    """The lines that hang: like the best of them, or with much evidence over most of the span."""
    best = best_hanging(lines, length, select)
    if best is None:
        return []

    def is_wire(line: Candidate) -> bool:
        share, clear = line.planes / search.planes, line.odds >= select.min_odds
        if line.ends[0] == line.ends[1]:
            return False
        if hang_alike(best, line, length, select):
            return clear or share >= select.min_share_similar
        return hangs(line, length, select) and clear and share >= select.min_share

    return [line for line in lines if is_wire(line)]


def best_hanging(lines: Sequence[Candidate], length: float, config: SelectConfig) -> Candidate | None:
    """The line with the highest odds of those that hang."""
    hanging = [line for line in lines if hangs(line, length, config)]
    return max(hanging, key=lambda line: line.odds) if hanging else None


def hangs(line: Candidate, length: float, config: SelectConfig) -> bool:
    """Whether a line sags significantly."""
    uncertainty = config.sag_sigmas * float(line.covariance[4, 4]) ** 0.5
    return bool(line.theta[4] >= max(config.min_sag * length, uncertainty))


def hang_alike(a: Candidate, b: Candidate, length: float, config: SelectConfig) -> bool:
    """Whether two lines have about the same slope and sag."""
    slopes = [(line.theta[[1, 3]] - line.theta[[0, 2]]) / length for line in (a, b)]
    low, high = sorted((a.theta[4], b.theta[4]))
    similar = np.abs(slopes[0] - slopes[1]).max() < config.max_slope_difference
    return bool(similar and 0 < high <= config.max_sag_ratio * low)


def common_ends(
    line: Candidate, lines: Sequence[Candidate], length: float, config: SelectConfig
) -> tuple[int, int]:
    """First and last plane of a wire: all that hang alike hang from the same supports.

    Of three or more the second outermost counts: beyond the end, chance ridges deceive one wire, hardly two.
    """
    alike = [
        line.ends,
        *(other.ends for other in lines if other is not line and hang_alike(line, other, length, config)),
    ]
    ends = np.sort(np.array(alike), axis=0)
    nth = int(len(ends) > 2)
    return int(ends[nth, 0]), int(ends[-1 - nth, 1])
