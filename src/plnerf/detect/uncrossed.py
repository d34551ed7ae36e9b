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
from jaxtyping import Bool, Float

from plnerf.detect.candidate import Candidate, seen_together
from plnerf.detect.parabola import curve_points
from plnerf.detect.search import Search
from plnerf.detect.together import PLACES, likelier_two
from plnerf.detect.views import seen_places
from plnerf.line.two_directions import second_direction

SIGHT_RAD = 1e-3
"""To about which angle lines of sight are known."""


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
    hang = (line.theta[4:] + beside.theta[4:]) / 2
    tie = search.config.search.side_by_side
    for of_line in (second, ~second):
        targets = np.where(of_line[:, None, None], places[0], places[1])
        yield _through(centres, sees, targets, s, hang, tie)


def _through(
    centres: Float[np.ndarray, "n 2"],
    sees: Bool[np.ndarray, "n p"],
    targets: Float[np.ndarray, "n p 2"],
    s: Float[np.ndarray, " p"],
    hang: Float[np.ndarray, "2"],
    tie: float,
) -> Float[np.ndarray, "6"]:
    """The curve nearest to lines of sight from centres to targets, by angle; b and d are tied to `hang`."""
    to = (targets - centres[:, None])[sees]
    across = np.column_stack([-to[:, 1], to[:, 0]]) / (to**2).sum(1, keepdims=True) / SIGHT_RAD
    by_y = np.column_stack([1 - s, s, 0 * s, 0 * s, 0 * s, 4 * s * (1 - s)])
    by_z = np.column_stack([0 * s, 0 * s, 1 - s, s, -4 * s * (1 - s), 0 * s])
    along = np.broadcast_to(np.arange(len(s)), sees.shape)[sees]
    rows = across[:, :1] * by_y[along] + across[:, 1:] * by_z[along]
    values = (across * targets[sees]).sum(1)
    tied = np.eye(6)[4:] / tie
    theta, *_ = np.linalg.lstsq(
        np.concatenate([rows, tied]), np.concatenate([values, hang / tie]), rcond=None
    )
    return theta
