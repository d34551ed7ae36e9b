"""Where wires go on that end: at a structure the next span begins, in another direction and at another slope.

A few metres of it beyond the structure are often all that images show, too few to be told from chance
anywhere else.  That a line runs through the end of a wire is evidence by itself.

Letters: c curves, m ends; window frame, theta as in `parabola.py`.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from plnerf.detect.candidate import Candidate
from plnerf.detect.config import SearchConfig, SelectConfig
from plnerf.detect.parabola import curve_points
from plnerf.detect.windows import Window
from plnerf.line.frame import LineFrame
from plnerf.line.wire import Wire


def ends_of_wires(
    wires: Sequence[Wire], window: Window, frame: LineFrame, around: float
) -> Float[np.ndarray, "m 2 3"]:
    """The pieces of certain wires about their ends, from first to last point.

    around: how far to both sides of an end, because the structure may be before it or beyond.
    """
    reach_m = around * window.unit_m(frame)
    pieces = [np.zeros((0, 2, 3))]
    for wire in wires:
        if wire.evidence.certain:
            ends = np.array([0.0, wire.base.length_m])
            places = (ends[:, None] + [-reach_m, reach_m]).ravel()
            pieces.append(window.of_scene(frame.to_scene(wire.points(places))).reshape(2, 2, 3))
    return np.concatenate(pieces)


def ends_of_lines(
    lines: Sequence[Candidate], x: Float[np.ndarray, " i"], around: float
) -> Float[np.ndarray, "m 2 3"]:
    """The same of lines of the window itself whose place is fixed."""
    pieces = [np.zeros((0, 2, 3))]
    for line in lines:
        if line.fixed:
            at = x[list(line.seen)][:, None] + [-around, around]
            y, z = curve_points(line.theta, (at - x[0]) / (x[-1] - x[0]))
            pieces.append(np.stack([at, y, z], -1))
    return np.concatenate(pieces)


def goes_on(
    curves: Float[np.ndarray, "c 6"],
    seen: Float[np.ndarray, "c 2"],
    ends: Float[np.ndarray, "m 2 3"],
    x: Float[np.ndarray, " i"],
    config: SearchConfig,
) -> Bool[np.ndarray, " c"]:
    """Whether curves run through the end of a wire and are seen beside it.

    seen: first and last place x that shows each curve; x: planes of the curves.
    """
    if not len(ends):
        return np.zeros(len(curves), bool)
    y, z = curve_points(curves.T[:, :, None, None], (ends[:, :, 0] - x[0]) / (x[-1] - x[0]))
    apart = np.stack([y - ends[:, :, 1], z - ends[:, :, 2]], -1)
    first, along = apart[:, :, 0], apart[:, :, 1] - apart[:, :, 0]
    part = np.clip(-(first * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-12), 0, 1)
    nearest = np.linalg.norm(first + part[..., None] * along, axis=-1)
    at = ends[:, 0, 0] + part * (ends[:, 1, 0] - ends[:, 0, 0])
    beside = (at >= seen[:, :1] - config.around) & (at <= seen[:, 1:] + config.around)
    return ((nearest <= config.onward) & beside).any(1)


def runs_through(
    line: Candidate, ends: Float[np.ndarray, "m 2 3"], x: Float[np.ndarray, " i"], config: SearchConfig
) -> bool:
    """The same of one line."""
    return bool(goes_on(line.theta[None], x[np.array([line.seen])], ends, x, config)[0])


def of_next_span(
    lines: Sequence[Candidate], x: Float[np.ndarray, " i"], config: SelectConfig
) -> list[Candidate]:
    """Of lines that go on where wires end those in the air that run as another one does, or that hang and
    have by themselves the evidence that a window's first line needs.  None that bends upwards is a wire.

    Views may be more alike beside them than beside a wire: a structure is behind their beginning.
    """

    def may_hang(line: Candidate) -> bool:
        least = -config.sag_sigmas_free * np.sqrt(line.covariance[4, 4])
        return not line.likeness > config.lies_alike and bool(line.theta[4] > least)  # not of NaN

    in_air = [line for line in lines if may_hang(line)]
    parallel = in_parallel(in_air, x, config)

    def is_clear(line: Candidate) -> bool:
        return line.odds >= config.min_odds and bool(line.theta[4] > 0)

    return [line for line in in_air if is_clear(line) or line in parallel]


def in_parallel(
    lines: Sequence[Candidate], x: Float[np.ndarray, " i"], config: SelectConfig
) -> list[Candidate]:
    """The lines that run as another one does where both are seen: a span has more than one wire."""
    slopes = [slopes_of(line, x) for line in lines]

    def has_another(k: int) -> bool:
        apart = [np.abs(slopes[k] - other).max() for j, other in enumerate(slopes) if j != k]
        return min(apart, default=np.inf) <= config.max_slope_difference

    return [line for k, line in enumerate(lines) if has_another(k)]


def slopes_of(line: Candidate, x: Float[np.ndarray, " i"]) -> Float[np.ndarray, "2"]:
    """Of y and z by x, in the middle of the stretch that shows a line."""
    y_A, y_B, z_A, z_B, b, d = line.theta
    bend = 4 * (1 - sum(line.seen) / (len(x) - 1))
    return np.array([y_B - y_A + bend * d, z_B - z_A - bend * b]) / (x[-1] - x[0])
