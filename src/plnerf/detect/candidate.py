"""A line that may be a wire, and which of the lines are wires: those that hang.

Letters as in `parabola.py`; planes are those of the fit.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Float

from plnerf.detect.config import SearchConfig, SelectConfig
from plnerf.detect.parabola import curve_points


@dataclass(frozen=True, eq=False)
class Candidate:
    """A curve fitted to ridges; scene frame."""

    theta: Float[np.ndarray, "6"]
    """(y_A, y_B, z_A, z_B, b, d) between the first and the last plane."""
    covariance: Float[np.ndarray, "6 6"]
    """Covariance of theta, in scene units squared."""
    rms_px: float
    """Root mean square distance of its ridges."""
    images: int
    """Views in which it has ridges."""
    odds: float = 0.0
    """Nats, over the planes in `seen`; 0 until the search has rated it."""
    seen: tuple[int, int] = (0, 0)
    """First and last plane of the stretch with the largest odds."""
    fixed: bool = False
    """Whether the views fix its place where it was seen."""
    likeness: float = np.nan
    """Mean correlation of views beside it: 1 for a line on a surface, 0 for one in the air; NaN: unknown."""
    repeats: bool = False
    """Whether it lies to another line as two other lines lie to each other: less evidence is enough."""

    @property
    def planes(self) -> int:
        """Length of the stretch that was seen."""
        return self.seen[1] - self.seen[0]


def select_wires(lines: Sequence[Candidate], length: float, select: SelectConfig) -> list[Candidate]:
    """The lines that hang like one of the leaders.

    A line that hangs unlike the best, and as no other does, is a wire only if it is known to hang in the air:
    edges on the ground that views from two sides show meet in such lines too.  Less evidence is enough only
    beside the leader: past the end of its span are a structure's members, which run every way.  Views beside
    one that clearly hangs as a leader does may be more alike: edges on the ground seldom sag as wires do.
    """
    first = leaders(lines, length, select)

    def is_enough(line: Candidate, leader: Candidate) -> bool:
        clear = line.odds >= select.min_odds and sags(line, length, select.sag_sigmas, select)
        lies = line.likeness > (select.lies_alike if clear else select.lies)  # not of NaN
        least = needed(line, select) if seen_together(leader, line) else select.min_odds
        return line.planes > 0 and not lies and line.odds >= least

    def alike(leader: Candidate) -> list[Candidate]:
        return [
            line for line in lines if hang_alike(leader, line, length, select) and is_enough(line, leader)
        ]

    def is_known(group: Sequence[Candidate]) -> bool:
        return len(group) > 1 or any(line.likeness <= select.free for line in group)

    wires = {
        id(line)
        for leader in first
        if is_known(group := alike(leader)) or leader is first[0]
        for line in group
    }
    return [line for line in lines if id(line) in wires]


def seen_together(a: Candidate, b: Candidate) -> bool:
    """Whether both are seen over half of the stretch that shows the shorter one."""
    first, last = max(a.seen[0], b.seen[0]), min(a.seen[1], b.seen[1])
    return 2 * (last - first) >= min(a.planes, b.planes) > 0


def needed(line: Candidate, select: SelectConfig) -> float:
    """Nats that a line needs which hangs like a leader, beside it."""
    return select.min_odds_repeated if line.repeats else select.min_odds_similar


def leaders(lines: Sequence[Candidate], length: float, select: SelectConfig) -> list[Candidate]:
    """Of each way in which lines hang, the one with the highest odds; the best of all first.

    A window may show several spans, whose wires are pieces of other parabolas.
    """
    best = best_hanging(lines, length, select)
    if best is None:
        return []
    found = [best]
    beside = [line for line in lines if hangs_beside(best, line, length, select)]
    for line in sorted(beside, key=lambda line: -line.odds):
        if not any(hang_alike(leader, line, length, select) for leader in found):
            found.append(line)
    return found


def hangs_beside(best: Candidate, line: Candidate, length: float, select: SelectConfig) -> bool:
    """Whether a line that hangs unlike the best has enough evidence to be a wire nevertheless."""
    enough = line.odds >= select.min_odds and line.planes >= select.min_planes
    return enough and line.fixed >= best.fixed and hangs(line, length, select)


def best_hanging(lines: Sequence[Candidate], length: float, config: SelectConfig) -> Candidate | None:
    """The line with the highest odds of those that hang, or of those among them whose place is fixed.

    What is far away looks alike from all along a flight: it may have more odds than a wire, and hangs as
    nothing does.
    """
    hanging = [line for line in lines if hangs(line, length, config)]
    return max(hanging, key=lambda line: (line.fixed, line.odds)) if hanging else None


def without_gaps(
    lines: Sequence[Candidate], planes: int, pixel: float, config: SearchConfig
) -> list[Candidate]:
    """The lines without those that run in the middle between two stronger ones: the background between twins.

    planes: of the window; pixel: width of one where lines hang.
    """

    def apart_px(line: Candidate, theta: Float[np.ndarray, "6"]) -> float:
        s = np.linspace(*line.seen, 9) / (planes - 1)
        one, other = (np.stack(curve_points(curve, s)) for curve in (line.theta, theta))
        return float(np.hypot(*(one - other)).mean()) / pixel

    def near_enough_px(line: Candidate, other: Candidate) -> float:
        faint = line.odds * other.planes < config.faint * other.odds * line.planes
        return config.faint_gap_px if faint else config.gap_px

    def is_gap(line: Candidate) -> bool:
        near = [
            one
            for one in lines
            if one.odds > line.odds and apart_px(line, one.theta) <= near_enough_px(line, one)
        ]
        return any(
            apart_px(line, (a.theta + b.theta) / 2) <= config.middle_px for a, b in combinations(near, 2)
        )

    return [line for line in lines if not is_gap(line)]


def hangs(line: Candidate, length: float, config: SelectConfig) -> bool:
    """Whether a line sags significantly, and does not lie on something."""
    sigmas = config.sag_sigmas_free if line.likeness <= config.free else config.sag_sigmas
    lies = line.likeness > config.lies  # not of NaN
    return sags(line, length, sigmas, config) and not lies


def sags(line: Candidate, length: float, sigmas: float, config: SelectConfig) -> bool:
    """Whether a line's sag differs from 0 by so many of its standard deviations."""
    uncertainty = sigmas * float(line.covariance[4, 4]) ** 0.5
    return bool(line.theta[4] >= max(config.min_sag * length, uncertainty))


def hang_alike(a: Candidate, b: Candidate, length: float, config: SelectConfig) -> bool:
    """Whether two lines have about the same slope and sag."""
    slopes = [(line.theta[[1, 3]] - line.theta[[0, 2]]) / length for line in (a, b)]
    similar = np.abs(slopes[0] - slopes[1]).max() < config.max_slope_difference
    return bool(similar and sag_ratio(a, b) <= config.max_sag_ratio)


def sag_ratio(a: Candidate, b: Candidate) -> float:
    """The larger sag as a multiple of the smaller one; infinite where one does not hang."""
    low, high = sorted((float(a.theta[4]), float(b.theta[4])))
    return high / low if low > 0 else np.inf


def common_ends(
    line: Candidate, lines: Sequence[Candidate], length: float, config: SelectConfig
) -> tuple[int, int]:
    """First and last plane of a wire: all that hang alike hang from the same supports.

    Of three or more the second outermost counts: beyond the end, chance ridges deceive one wire, hardly two.
    """
    alike = [
        line.seen,
        *(
            other.seen
            for other in lines
            if other is not line and other.fixed and hang_alike(line, other, length, config)
        ),
    ]
    ends = np.sort(np.array(alike), axis=0)
    nth = int(len(ends) > 2)
    return int(ends[nth, 0]), int(ends[-1 - nth, 1])
