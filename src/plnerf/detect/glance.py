"""A look at thin lines alone: whether any in a direction are in the air, and how they run.

The thin lines that voted for directions are at hand in all images, while the ridges along a direction take
seconds to compute.  Few of them show a whole wire, but where wires run in a direction some of them meet in a
line that lies on nothing.  Its own direction is better known than that of the votes, which clutter draws
aside.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np
from jaxtyping import Float

from plnerf.detect.candidate import Candidate
from plnerf.detect.config import DetectConfig
from plnerf.detect.continuations import slopes_of
from plnerf.detect.directions import Direction, turned_to
from plnerf.detect.in_window import Known, search_of
from plnerf.detect.line_maps import LineMaps, ridges_of
from plnerf.detect.surroundings import Surroundings
from plnerf.detect.views import Views
from plnerf.detect.window_search import judge, lines_met
from plnerf.detect.windows import Window


def direction_in_air(
    direction: Direction,
    windows: Sequence[Window],
    views: Views,
    maps: LineMaps,
    surroundings: Surroundings,
    known: Known,
    least: float,
    config: DetectConfig,
) -> Direction | None:
    """A direction if thin lines that no line has taken meet near to it in some that lie on nothing; theirs,
    where it is another; None where there are none.

    windows: along it.  least: nats that such a line needs.
    """
    left = Known([], known.taken, known.taken, known.sharpness)
    slopes, odds = list[Float[np.ndarray, "2"]](), list[float]()
    for window in windows:
        search = search_of(window, views, ridges_of(maps, views, window.views), left, config)
        for line in lines_met(search, window, least, partial(judge, search, window, surroundings)):
            if in_air(line, config):
                slopes.append(slopes_of(line, search.x))
                odds.append(line.odds)
    if not odds:
        return None
    aside, up = np.arctan(np.average(slopes, axis=0, weights=odds))
    other = abs(aside) > config.directions.aside_rad
    return turned_to(direction, float(aside), float(up)) if other else direction


def in_air(line: Candidate, config: DetectConfig) -> bool:
    """Whether views do not see beside a line what it would lie on.  Before a clear sky they see nothing."""
    return not line.likeness > config.select.free
