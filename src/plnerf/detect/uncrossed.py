"""Lines that are one wire in the images of one side, and another wire in those of the other.

Where all views look at a window from two directions only, as those of a flight to and fro do, the planes of
one wire's ridges from the one side and of another's from the other meet in a line too, beside both wires.
Once such a line has these ridges, each of the two wires has those of one side alone.  So of a line that is
fixed and one that is not, the latter is given the former's ridges of either side, and both are fitted anew.

Letters as in `parabola.py`; n views that see the lines, p places along them.
"""

from collections.abc import Iterator, Sequence
from itertools import permutations

import numpy as np
from jaxtyping import Float

from plnerf.detect.candidate import Candidate, seen_together
from plnerf.detect.parabola import curve_points
from plnerf.detect.search import Search
from plnerf.detect.together import PLACES, likelier_two
from plnerf.detect.views import seen_places
from plnerf.line.two_directions import second_direction, through_sights


def uncrossed(search: Search, lines: Sequence[Candidate]) -> list[Candidate]:
    """The lines, two in the place of two whose ridges were crossed, where these are likelier.

    Of these two one that views do not fix is left out: it began far from its wire, which a search among the
    ridges that are left now is to find.
    """
    before, lines = list(lines), list(lines)
    for i, j in permutations(range(len(lines)), 2):
        if lines[i].fixed and not lines[j].fixed and seen_together(lines[i], lines[j]):
            starts = [np.stack([lines[i].theta, other]) for other in _crossings(search, lines[i], lines[j])]
            if starts:
                lines[i], lines[j] = likelier_two(search, lines[i], lines[j], np.stack(starts))
    kept = [line for line in lines if line.fixed or line in before]
    for line in lines:
        if line not in kept:
            search.release(line)
    search.update_odds()
    return kept


def _crossings(search: Search, line: Candidate, beside: Candidate) -> Iterator[Float[np.ndarray, "6"]]:
    """Curves through lines of sight to one line from one side and to the other from the other side."""
    s = np.linspace(max(line.seen[0], beside.seen[0]), min(line.seen[1], beside.seen[1]), PLACES)
    s /= len(search.x) - 1
    y, z = np.stack([curve_points(one.theta, s) for one in (line, beside)], 1)
    middle = np.column_stack([search.x[0] + s * search.length, y.mean(0), z.mean(0)])
    sees = seen_places(search.views, middle)
    centres, sees = search.views.centre[sees.any(1), 1:], sees[sees.any(1)]
    if not len(centres):
        return
    rays = middle[PLACES // 2, 1:] - centres
    angles = np.degrees(np.arctan2(rays[:, 1], rays[:, 0]))
    second = second_direction(angles, 1.0, search.config.search.sides_deg)
    if second is None:
        return
    places = np.stack([y, z], -1)
    # Wires of one span hang alike, by far to within what may lie between two that are fitted together.
    (below, aside), tie = (line.theta[4:] + beside.theta[4:]) / 2, search.config.search.side_by_side
    for of_line in (second, ~second):
        targets = np.where(of_line[:, None, None], places[0], places[1])
        curve = through_sights(centres, sees, targets, s, np.array([aside, -below]), tie)
        (y_A, y_B, d), (z_A, z_B, rise) = curve
        yield np.array([y_A, y_B, z_A, z_B, -rise, d])
