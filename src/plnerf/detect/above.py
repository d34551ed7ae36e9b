"""Shield wires: lines that hang above wires, alone and with another sag.

By itself a line that hangs as no other does may be an edge on the ground, where nothing can be compared
beside it, as before a clear sky.  But an edge on the ground hardly ever lies above a span's wires, sags, and
runs as they do.
"""

from collections.abc import Sequence

import numpy as np

from plnerf.detect.candidate import Candidate, hangs, seen_together
from plnerf.detect.config import SelectConfig
from plnerf.detect.parabola import curve_points


def above_wires(
    lines: Sequence[Candidate],
    wires: Sequence[Candidate],
    planes: int,
    length: float,
    config: SelectConfig,
) -> list[Candidate]:
    """Of lines that are no wires so far those that hang above one.

    Such a line is seen beside a wire and parallel to it in plan, steeply above it, and has by itself the
    evidence that a window's first line needs.  planes, length: of the window.
    """

    def is_above(line: Candidate, wire: Candidate) -> bool:
        s = (max(line.seen[0], wire.seen[0]) + min(line.seen[1], wire.seen[1])) / 2 / (planes - 1)
        aside, up = np.subtract(curve_points(line.theta, s), curve_points(wire.theta, s))
        y_A, y_B = line.theta[:2] - wire.theta[:2]
        parallel = abs(y_B - y_A) <= config.max_slope_difference * length
        return parallel and seen_together(line, wire) and bool(abs(aside) <= config.steep * up)

    return [
        line
        for line in lines
        if line.fixed and line.odds >= config.min_odds and hangs(line, length, config)
        and any(is_above(line, wire) for wire in wires)
    ]  # fmt: skip
