"""Lines fitted again where the others are known: one by one, and two side by side together.

The first lines were fitted with others' ridges near them.  Of twin conductors each may have been found as one
of the pair at one end and as the other at the other: then neither can be mended alone, since the ridges that
it needs are the other's.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from jaxtyping import Float

from plnerf.detect.candidate import Candidate, hang_alike, hangs, needed, seen_together
from plnerf.detect.parabola import curve_points
from plnerf.detect.search import Search

PLACES = 9
"""Places at which the distance of two lines is compared."""


def refit_all(search: Search, lines: Sequence[Candidate]) -> list[Candidate]:
    """Each line fitted again where the others are known: the first ones had others' ridges near them."""
    lines = list(lines)
    for _ in range(search.config.search.refits):
        before, lines = lines, []
        for line in before:
            near = variants(line, before, len(search.x))
            again = search.refit(line, near, needed(line, search.config.select))
            if again is not None:
                lines.append(again)
    search.update_odds()
    return lines


def followed(search: Search, lines: Sequence[Candidate]) -> list[Candidate]:
    """Each line fitted again as far as it is seen to go on, beside the others."""
    longer = []
    for line in lines:
        again = search.refit(line, line.theta[None], needed(line, search.config.select))
        if again is None:
            search.mask_ridges(line)
        longer.append(again or line)
    search.update_odds()
    return longer


def variants(line: Candidate, lines: Sequence[Candidate], planes: int) -> Float[np.ndarray, "c 6"]:
    """The line, and those that hang as the others do and meet it at one of three places that show it.

    Where two hang side by side, one may have been found as half of the one and half of the other.
    """
    own, out = line.theta, [line.theta]
    first, last = (plane / (planes - 1) for plane in line.seen)
    for other in lines:
        if other is not line:
            for s in (first + part * (last - first) for part in (1 / 6, 1 / 2, 5 / 6)):
                y, z = np.subtract(curve_points(own, s), curve_points(other.theta, s))
                out.append(other.theta + np.array([y, y, z, z, 0, 0]))
    return np.array(out)


def untangled(search: Search, lines: Sequence[Candidate]) -> list[Candidate]:
    """The lines, two that lie side by side in the place of two that came nearer to each other at one end.

    The two are fitted again from curves of one shape, as wires of one span have it, and take the old ones'
    places where they are likelier together.
    """
    lines, most = list(lines), search.config.search.parallel
    pairs = {(i, j): parallel(lines[i], lines[j], search) for i, j in combinations(range(len(lines)), 2)}
    for i, j in sorted((pair for pair in pairs if pairs[pair] < most), key=lambda pair: pairs[pair]):
        if parallel(lines[i], lines[j], search) < most:
            starts = of_one_shape(lines[i], lines[j], lines, len(search.x))
            lines[i], lines[j] = likelier_two(search, lines[i], lines[j], starts)
    search.update_odds()
    return lines


def parallel(a: Candidate, b: Candidate, search: Search) -> float:
    """The least distance of two lines over the largest where both are seen; 1 where that is no pair.

    Lines are a pair that hang alike, near each other, and that are seen together over half of the one that is
    seen over less.
    """
    config = search.config
    if not seen_together(a, b) or not hang_alike(a, b, search.length, config.select):
        return 1.0
    first, last = max(a.seen[0], b.seen[0]), min(a.seen[1], b.seen[1])
    s = np.linspace(first, last, PLACES) / (len(search.x) - 1)
    apart = np.hypot(*np.subtract(curve_points(a.theta, s), curve_points(b.theta, s)))
    return float(apart.min() / apart.max()) if apart.max() <= config.search.side_by_side else 1.0


def likelier_two(
    search: Search, a: Candidate, b: Candidate, starts: Float[np.ndarray, "k 2 6"]
) -> tuple[Candidate, Candidate]:
    """The likeliest two lines in the place of two, fitted together from pairs of curves; these if no others
    are likelier."""
    best, least = (a, b), tuple(needed(line, search.config.select) for line in (a, b))
    for line in best:
        search.release(line)
    search.update_odds()
    likely = np.argsort(-sum(search.rated(starts[:, k])[0] for k in range(2)), kind="stable")
    for curves in starts[likely[: search.config.search.starts_together]]:
        new = _fitted_together(search, replace(a, theta=curves[0]), replace(b, theta=curves[1]), least)
        if new is not None and _better(new, best, search):
            best = new
    for line in best:
        search.claim(line)
    search.update_odds()
    return best


def _fitted_together(
    search: Search, a: Candidate, b: Candidate, least: tuple[float, ...]
) -> tuple[Candidate, Candidate] | None:
    """Two lines fitted each with the ridges of the other taken; None where one of them becomes no line."""
    search.claim(b)
    search.update_odds()
    one, _ = search.best(a.theta[None], least[0])
    search.release(b)
    if one is None:
        return None
    search.claim(one)
    search.update_odds()
    other, _ = search.best(b.theta[None], least[1])
    if other is None:
        search.release(one)
        return None
    search.claim(other)
    again = search.refit(one, one.theta[None], least[0])
    search.release(other)
    if again is None:
        return None
    search.release(again)
    return (
        replace(again, likeness=a.likeness, repeats=a.repeats),
        replace(other, likeness=b.likeness, repeats=b.repeats),
    )


def of_one_shape(
    a: Candidate, b: Candidate, lines: Sequence[Candidate], planes: int
) -> Float[np.ndarray, "c 2 6"]:
    """Curves of the shape of one of some lines, or of the middle of two, through both of these in one place.

    Of the first, the middle and the last place that shows both; a and b are among the lines.
    """
    s = np.linspace(max(a.seen[0], b.seen[0]), min(a.seen[1], b.seen[1]), 3) / (planes - 1)
    shapes = np.array([(a.theta + b.theta) / 2, *(line.theta for line in lines)])
    here = np.stack(curve_points(shapes.T[:, :, None], s))
    moved = []
    for line in (a, b):
        y, z = np.stack(curve_points(line.theta, s))[:, None] - here
        moved.append(shapes[:, None] + np.stack([y, y, z, z, 0 * y, 0 * y], -1))
    return np.stack(moved, 2).reshape(-1, 2, 6)


def _better(new: Sequence[Candidate], old: Sequence[Candidate], search: Search) -> bool:
    """Whether two lines are likelier than two others, hang as wires of one span do, and are fixed as well."""
    a, b = new
    wires = hang_alike(a, b, search.length, search.config.select) and all(
        hangs(line, search.length, search.config.select) for line in new
    )
    fixed = sum(line.fixed for line in new) >= sum(line.fixed for line in old)
    return wires and fixed and sum(line.odds for line in new) > sum(line.odds for line in old)
