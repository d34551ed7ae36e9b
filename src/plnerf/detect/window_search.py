"""The lines in one window: in all of its volume first, then around those that hang.

The ridges of the best curve are taken out of the maps before the next is searched, so that no ridge counts
for two.  Lines that do not hang are found too, and left out at the end: edges of roads and tracks would
otherwise lend their ridges to wires.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from jaxtyping import Float

from plnerf.detect.candidate import Candidate, hang_alike, hangs, leaders, without_gaps
from plnerf.detect.narrow import curve_point
from plnerf.detect.search import Search
from plnerf.detect.sweep import Box, candidates, candidates_like, sweep
from plnerf.detect.to_wire import typical_footprint
from plnerf.detect.windows import Window, box_around


def find_lines(search: Search, window: Window) -> list[Candidate]:
    """Lines of any shape, the best first; then those that hang as the leaders do, until none is new.

    Where the views fix no line that hangs, there are no others to look for.
    """
    config = search.config
    lines = _of_any_shape(search, window.box(config.coarse))
    first = leaders(lines, search.length, config.select, config.search)
    if not first or not first[0].fixed:
        return lines
    lines = refit_all(search, lines)
    box = _around_hanging(search, lines, window)
    for _ in range(config.search.max_sweeps):
        new = _like_the_leaders(search, box, lines)
        lines += new
        if not new:
            break
    lines = refit_all(search, lines)
    # Fitted again, the lines leave more of their ridges to others.
    if more := _like_the_leaders(search, box, lines):
        lines = refit_all(search, [*lines, *more])
    pixel = typical_footprint(search.views, first[0].theta, search.x, config.certainty)
    return without_gaps(lines, pixel, config.search)


def _of_any_shape(search: Search, box: Box) -> list[Candidate]:
    config, lines = search.config, list[Candidate]()
    for _ in range(config.search.max_sweeps):
        volume = sweep(search.views, search.odds, box, config.coarse)
        most = config.search.max_lines - len(lines)
        pending = search.settled(candidates(volume, box, config.coarse), box.x)
        new = _found_near(search, pending, box, config.select.min_odds, most)
        lines += new
        if not new or len(lines) == config.search.max_lines:
            break
    return lines


def _around_hanging(search: Search, lines: Sequence[Candidate], window: Window) -> Box:
    """The part of a window's volume in which lines are seen to hang, with room for more of them."""
    config, last = search.config, len(search.x) - 1
    hanging = [line for line in lines if hangs(line, search.length, config.select)]
    places = np.array([
        curve_point(line.theta, plane / last) for line in hanging for plane in np.linspace(*line.seen, 9)
    ])
    low = np.maximum(places.min(0) - config.windows.room, window.low)
    high = np.minimum(places.max(0) + config.windows.room, window.high)
    return box_around(low, high, config.sweep)


def _like_the_leaders(search: Search, box: Box, lines: Sequence[Candidate]) -> list[Candidate]:
    """Further lines that hang as the best of the lines do: of each span in the window."""
    config, length, last = search.config, search.length, len(search.x) - 1
    volume, new = sweep(search.views, search.odds, box, config.sweep), list[Candidate]()
    for leader in leaders(lines, length, config.select, config.search):
        most = config.search.max_lines - len(lines) - len(new)
        wanted = partial(hang_alike, leader, length=length, config=config.select)
        middle = sum(leader.seen) / 2 / last
        shifted = search.shifted(leader.theta, middle, box)
        similar = candidates_like(leader.theta, middle, volume, box, config.sweep)
        similar = search.settled(similar[: config.search.most_alike], box.x)
        pending = np.concatenate([shifted, similar])
        new += _found_near(search, pending, box, config.select.min_odds_similar, most, wanted)
    return new


def _found_near(
    search: Search,
    pending: Float[np.ndarray, "c 5"],
    box: Box,
    least: float,
    most: int,
    wanted: Callable[[Candidate], bool] | None = None,
) -> list[Candidate]:
    """The lines near some curves, best first, each without the ridges of those before it.

    least: nats that a line needs.
    """
    narrow = search.config.narrow
    reach = search.config.sweep.cell * narrow.cells[narrow.settle - 1] / 2
    lines, batch, fruitless = list[Candidate](), search.config.search.batch, 0
    while len(pending) and fruitless < search.config.search.fruitless and len(lines) < most:
        pending = pending[np.argsort(-search.score(pending, box.x, reach), kind="stable")]
        line = search.best(pending[:batch], least, wanted)
        if line is None:
            pending, fruitless = pending[batch:], fruitless + 1
            continue
        fruitless = 0
        lines.append(line)
        search.mask_ridges(line)
    return lines


def refit_all(search: Search, lines: Sequence[Candidate]) -> list[Candidate]:
    """Each line fitted again where the others are known: the first ones had others' ridges near them."""
    lines = list(lines)
    for _ in range(search.config.search.refits):
        before, lines = lines, []
        for line in before:
            again = search.refit(line, variants(line, before), search.config.select.min_odds_similar)
            if again is not None:
                lines.append(again)
    return lines


def variants(line: Candidate, lines: Sequence[Candidate]) -> Float[np.ndarray, "c 5"]:
    """The line, and those that hang as the others do and meet it at one of three places.

    Where two hang side by side, one may have been found as half of the one and half of the other.
    """
    own, out = line.theta, [line.theta]
    for other in lines:
        if other is not line:
            for s in (1 / 6, 1 / 2, 5 / 6):
                y, z = np.subtract(curve_point(own, s), curve_point(other.theta, s))
                out.append(other.theta + np.array([y, y, z, z, 0]))
    return np.array(out)
