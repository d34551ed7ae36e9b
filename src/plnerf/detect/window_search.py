"""The lines in one window: first of any shape, then those that hang as the best of these do.

The ridges of the best curve are taken out of the maps before the next is searched, so that no ridge counts
for two.  Lines that do not hang are found too, and left out at the end: edges of roads and tracks would
otherwise lend their ridges to wires.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import permutations

import numpy as np
from jaxtyping import Bool, Float

from plnerf.detect.above import above_wires
from plnerf.detect.candidate import (
    Candidate,
    hang_alike,
    hangs,
    leaders,
    seen_together,
    select_wires,
    without_gaps,
)
from plnerf.detect.config import SelectConfig
from plnerf.detect.continuations import (
    ends_of_lines,
    goes_on,
    in_parallel,
    of_next_span,
    runs_through,
)
from plnerf.detect.merged import merged
from plnerf.detect.parabola import curve_points
from plnerf.detect.search import Search
from plnerf.detect.surroundings import Surroundings
from plnerf.detect.to_wire import typical_footprint
from plnerf.detect.together import followed, refit_all, untangled
from plnerf.detect.uncrossed import uncrossed
from plnerf.detect.windows import Window

Judge = Callable[[Candidate], Candidate]
"""Gives a line back with what is seen beside it."""


def find_lines(
    search: Search,
    window: Window,
    surroundings: Surroundings,
    ends: Float[np.ndarray, "m 2 3"],
    report: Callable[[float], None],
) -> tuple[list[Candidate], list[Candidate]]:
    """The wires, the best first, and lines that are none: edges of roads, say.

    Lines of any shape come first; then those that hang as the leaders do, until none is new.  Where the views
    fix no line that hangs, there are no others to look for.  Wires are followed beyond the window at last,
    and those are found that go on where they end.

    ends: of wires of other directions (`continuations.py`).  report: takes the share that is done, roughly.
    """
    config = search.config
    judged = partial(judge, search, window, surroundings)
    lines = lines_met(search, window, config.select.min_odds, judged)
    first = leaders(lines, search.length, config.select)
    report(0.4)
    if first and first[0].fixed:
        lines = without_mixtures(search, refit_all(search, lines))
        met = search.distinct(search.met(window, config.chains.spare_alike))
        for _ in range(config.search.rounds):
            new = _like_the_leaders(search, met, lines, judged)
            lines += new
            if not new:
                break
        report(0.6)
        lines = refit_all(search, lines)
        # Fitted again, the lines leave more of their ridges to others.
        if more := _like_the_leaders(search, met, lines, judged):
            lines = refit_all(search, [*lines, *more])
        lines = merged(search, untangled(search, uncrossed(search, lines)))
        # A wire beside the camera is ten pixels wide: its ridges lie farther from it than the first one's.
        with search.blurred():
            lines += refit_all(search, _like_the_leaders(search, met, lines, judged))
        pixel = typical_footprint(search.views, first[0].theta, search.x, config.certainty)
        lines = without_gaps(lines, len(search.x), pixel, config.search)
    report(0.8)
    wires = select_wires(lines, search.length, config.select)
    others = [line for line in lines if line not in wires]
    lines = search.lengthen(*window.follow, [*wires, *others])
    wires, others = followed(search, lines[: len(wires)]), lines[len(wires) :]
    others = without_mixtures(search, others, hanging=False)
    ends = np.concatenate([ends, ends_of_lines(wires, search.x, config.search.around)])
    onwards = [line for line in others if runs_through(line, ends, search.x, config.search)]
    onwards += lines_onward(search, window, ends, judged)
    # Of a few metres the sag is not known: those were found, and are no wires by themselves.
    wires += of_next_span(onwards, search.x, config.select)
    rest = [line for line in others if line not in wires]
    shields = above_wires(rest, wires, len(search.x), search.length, config.select)
    return [*wires, *shields], [line for line in rest if line not in shields]


def lines_met(search: Search, window: Window, least: float, judged: Judge) -> list[Candidate]:
    """The lines of any shape near curves in which chains of two views meet, the best first.

    least: nats that a line needs.
    """
    config = search.config
    met = search.distinct(search.met(window, config.chains.spare))
    return _found_near(search, met, least, config.search.max_lines, judged)


def _like_the_leaders(
    search: Search, met: Float[np.ndarray, "c 6"], lines: Sequence[Candidate], judged: Judge
) -> list[Candidate]:
    """Further lines that hang as the best of the lines do: of each span in the window."""
    config, length, new = search.config, search.length, list[Candidate]()
    for leader in leaders(lines, length, config.select):
        most = config.search.max_lines - len(lines) - len(new)
        wanted = partial(_beside, leader, length=length, select=config.select)
        pending = search.alike(leader.theta, met)
        new += _found_near(search, pending, config.select.min_odds_similar, most, judged, wanted)
        most = config.search.max_lines - len(lines) - len(new)
        pending = repeated([one for one in (*lines, *new) if one.fixed and wanted(one)], len(search.x))
        if len(pending):
            least = config.select.min_odds_repeated
            found = _found_near(search, pending, least, most, judged, wanted)
            new += [replace(line, repeats=True) for line in found]
    return new


def _beside(leader: Candidate, line: Candidate, length: float, select: SelectConfig) -> bool:
    """Whether a line hangs like a leader, and in its span."""
    return seen_together(leader, line) and hang_alike(leader, line, length, select)


def lines_onward(
    search: Search, window: Window, ends: Float[np.ndarray, "m 2 3"], judged: Judge
) -> list[Candidate]:
    """Further lines that begin where wires end."""
    config, x = search.config, search.x
    if not len(ends):
        return []

    def onward(curves: Float[np.ndarray, "c 6"]) -> Bool[np.ndarray, " c"]:
        seen = x[0] + search.rated(curves)[1:].T * search.length
        return goes_on(curves, seen, ends, x, config.search)

    def wanted(line: Candidate) -> bool:
        return runs_through(line, ends, x, config.search)

    met = search.met(window, config.chains.spare_alike)
    least, most = config.select.min_odds_continued, config.search.max_lines
    lines = _found_near(search, met[onward(met)], least, most, judged, wanted)
    # Of twins one may be left, and the other's ridges be a mixture's: rows of wires show where they are.
    for line in sorted(lines, key=lambda line: line.odds):
        others = [one for one in in_parallel(lines, x, config.select) if one is not line and one.fixed]
        again = repeated(others, len(x))
        again = again[onward(again)]
        if not len(again):
            continue
        search.free_ridges(line)
        new = _found_near(search, again, least, most - len(lines), judged, wanted)
        if sum(one.odds for one in new) > line.odds:
            lines.remove(line)
            lines += [replace(one, repeats=True) for one in new]
        else:
            for one in new:
                search.release(one)
            search.mask_ridges(line)
    return lines


def judge(search: Search, window: Window, surroundings: Surroundings, line: Candidate) -> Candidate:
    """A `Judge` of a window, but for its last argument."""
    certainty = search.config.certainty
    likeness = surroundings.likeness(line, search.views, window.views, search.x, certainty)
    return replace(line, likeness=likeness)


def repeated(lines: Sequence[Candidate], planes: int) -> Float[np.ndarray, "c 6"]:
    """The lines moved by what lies between any two of them: wires hang in rows, and in pairs."""
    out = [np.zeros((0, 6))]
    for a, b in permutations(lines, 2):
        first, last = max(a.seen[0], b.seen[0]), min(a.seen[1], b.seen[1])
        s = (first + last) / 2 / (planes - 1)
        y, z = np.subtract(curve_points(b.theta, s), curve_points(a.theta, s))
        move = np.array([y, y, z, z, 0, 0])
        out += [line.theta[None] + move for line in lines if line is not a]
    return np.concatenate(out)


def _found_near(
    search: Search,
    pending: Float[np.ndarray, "c 6"],
    least: float,
    most: int,
    judged: Judge,
    wanted: Callable[[Candidate], bool] | None = None,
) -> list[Candidate]:
    """The lines near some curves, best first, each without the ridges of those before it.

    least: nats that a line needs; most: lines at most; judged: a line with what is seen beside it.
    """
    lines, config = list[Candidate](), search.config.search
    pending = search.distinct(pending)
    while len(pending) and len(lines) < most:
        line, tried = search.best(pending[: config.fruitless], least, wanted)
        pending = pending[tried:]
        if line is None:
            break
        lines.append(judged(line))
        search.mask_ridges(lines[-1])
        pending = search.ranked(pending)
    return lines


def without_mixtures(search: Search, lines: Sequence[Candidate], hanging: bool = True) -> list[Candidate]:
    """The lines without those in the air that are no wires, whose ridges are free again.

    Nothing else is straight there: each is a part of one wire and a part of another, or of a wire's piece,
    from which its sag does not follow.  hanging: those that hang stay, for the wires are not known yet.
    """
    select, kept = search.config.select, list[Candidate]()
    for line in lines:
        if line.likeness <= select.free and not (hanging and hangs(line, search.length, select)):
            search.free_ridges(line)
        else:
            kept.append(line)
    return kept
