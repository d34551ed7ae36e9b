"""All conductors of a scene, found in its training images: sweep, narrow, fit, and one curve for each ridge.

The axis of the line must be known (it is the scene frame's x).  What speaks for the best curve is taken out
of the maps before the next is looked for, so that no ridge speaks for two.  Lines that do not hang are found
too, and left out at the end: edges of roads and tracks would otherwise lend their ridges to conductors.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float, Float32

from plnerf.detect.curves import Curve
from plnerf.detect.evidence import line_evidence
from plnerf.detect.narrow import curve_point
from plnerf.detect.refit import Fit
from plnerf.detect.search import BATCH, Line, Search
from plnerf.detect.sweep import Box, alike, candidates, sweep
from plnerf.detect.views import Views, views_of
from plnerf.scene.scene import Scene

PLANES, ROWS = 48, 96
"""Planes of the sweep, and of the fit."""
FRUITLESS = 4
"""Batches without a line after which a sweep has given what it has."""
SWEEPS = 5
SETTLING = 2
LEAST_ODDS = 250.0
"""Nats for a line.  Neighbouring planes and views share their evidence: this is less than it looks."""
LEAST_ODDS_ALIKE = 200.0
"""The same for one that hangs like the best."""
LEAST_SHARE, LEAST_SHARE_ALIKE = 0.7, 0.4
"""Of the planes: stretch that a conductor needs which hangs unlike the best, or like it but with less than
`LEAST_ODDS`."""
LEAST_SAG = 0.001
"""Of the length.  A conductor hangs; edges of roads do not."""
SLOPES_ALIKE = 0.03
SAGS_ALIKE = 1.6
"""Conductors that hang alike: differences of their chords' slopes, ratio of their sags at most."""


@dataclass(frozen=True)
class FindConfig:
    """How finely conductors are looked for; lengths in units of the scene frame."""

    cell: float = 0.004
    """Width of a cell across the line: 9 cm where the span's longest side is 44 m."""
    most: int = 40
    """Lines at most, edges of roads included."""


def find_curves(scene: Scene, config: FindConfig | None = None) -> tuple[Curve, ...]:
    """The conductors that the training images show, in the order in which they were found."""
    config = config or FindConfig()
    views = views_of(scene.cameras[list(scene.train)])
    box = search_box(scene, config.cell)
    x = np.linspace(box.x[0], box.x[-1], ROWS)
    search = Search(views, line_evidence(scene.images, scene.cameras, scene.train), x, config.cell)
    lines = settled(search, _lines(search, box, config.most))
    # In their places, the lines leave more of their ridges to others.
    if more := _like_the_best(search, sweep(views, search.odds, box), box, lines, config.most):
        lines = settled(search, [*lines, *more])
    found = conductors(lines, x[-1] - x[0])
    return tuple(_curve(views, line, ends_of(line, found, x[-1] - x[0]), x) for line in found)


def compile_search() -> None:
    """Has the kernels of the search compiled, on next to nothing; once, then they are on disk."""
    one = np.ones((1, 2))
    views = Views(np.eye(3)[None], np.zeros((1, 3)), 8 * one, 4 * one, np.zeros((1, 5)),
                  np.full((1, 2), 8), np.zeros(1, np.int64))  # fmt: skip
    x = np.linspace(-1, 1, 4)
    box = Box(x, (-0.5, -0.5), 0.25, (4, 4))
    search = Search(views, np.zeros(64, np.float32), x, box.cell)
    volume = sweep(views, search.odds, box)
    candidates(volume, box)
    alike(volume, box, np.zeros(5))
    search.promise(np.zeros((1, 5)), x)
    search.best(np.zeros((1, 5)), -np.inf)
    search.claim(Line(Fit(np.zeros(5), np.eye(5), 1.0), 0.0, 1, (0, 1)))


def _lines(search: Search, box: Box, most: int) -> list[Line]:
    """Lines along the span of any shape, the best first; then of the best one's shape, until none is new."""
    lines: list[Line] = []
    any_shape = True
    for _ in range(SWEEPS):
        volume, new = sweep(search.views, search.odds, box), []
        if any_shape:
            new = _taken(search, candidates(volume, box), box, LEAST_ODDS, most - len(lines))
            any_shape = bool(new)
        new = new or _like_the_best(search, volume, box, lines, most)
        lines += new
        if not new or len(lines) == most:
            break
    return lines


def _like_the_best(
    search: Search, volume: Float32[np.ndarray, "i j k"], box: Box, lines: Sequence[Line], most: int
) -> list[Line]:
    """Further lines that hang as the best of the lines does."""
    best = best_hanging(lines, box.x[-1] - box.x[0])
    if best is None or len(lines) >= most:
        return []
    like = alike(volume, box, best.fit.q)
    return _taken(search, like, box, LEAST_ODDS_ALIKE, most - len(lines), best)


def _taken(
    search: Search,
    pending: Float[np.ndarray, "c 5"],
    box: Box,
    least: float,
    most: int,
    like: Line | None = None,
) -> list[Line]:
    """The lines near some curves, best first, each without the ridges of those before it."""
    lines: list[Line] = []
    length, fruitless = box.x[-1] - box.x[0], 0
    wanted = None if like is None else partial(hang_alike, like, length=length)
    while len(pending) and fruitless < FRUITLESS and len(lines) < most:
        pending = pending[np.argsort(-search.promise(pending, box.x), kind="stable")]
        line = search.best(pending[:BATCH], least, wanted)
        if line is None:
            pending, fruitless = pending[BATCH:], fruitless + 1
            continue
        fruitless = 0
        lines.append(line)
        search.claim(line)
    return lines


def settled(search: Search, lines: Sequence[Line]) -> list[Line]:
    """Each line again where the others are: what was taken first had others' ridges before it."""
    lines = list(lines)
    for _ in range(SETTLING):
        before, lines = lines, []
        for line in before:
            again = search.again(line, variants(line, before), LEAST_ODDS_ALIKE)
            if again is not None:
                lines.append(again)
    return lines


def variants(line: Line, lines: Sequence[Line]) -> Float[np.ndarray, "c 5"]:
    """The line, and those that hang as the others do and meet it at one of three places.

    Where two hang side by side, one may have been found as half of the one and half of the other.
    """
    own, out = line.fit.q, [line.fit.q]
    for other in lines:
        if other is not line:
            for s in (1 / 6, 1 / 2, 5 / 6):
                y, z = np.subtract(curve_point(own, s), curve_point(other.fit.q, s))
                out.append(other.fit.q + np.array([y, y, z, z, 0]))
    return np.array(out)


def conductors(lines: Sequence[Line], length: float) -> list[Line]:
    """Those of the lines that hang: like the best of them, or with much evidence over most of the span."""
    best = best_hanging(lines, length)
    if best is None:
        return []
    return [line for line in lines if _is_conductor(line, best, length)]


def _is_conductor(line: Line, best: Line, length: float) -> bool:
    share, clear = line.planes / ROWS, line.odds >= LEAST_ODDS
    if hang_alike(best, line, length):
        return clear or share >= LEAST_SHARE_ALIKE
    return hangs(line, length) and clear and share >= LEAST_SHARE


def best_hanging(lines: Sequence[Line], length: float) -> Line | None:
    """The line with the highest odds of those that hang."""
    hanging = [line for line in lines if hangs(line, length)]
    return max(hanging, key=lambda line: line.odds) if hanging else None


def hangs(line: Line, length: float) -> bool:
    """Whether a line sags, beyond doubt."""
    doubt = 3 * float(line.fit.covariance[4, 4]) ** 0.5
    return bool(line.fit.q[4] >= max(LEAST_SAG * length, doubt))


def hang_alike(a: Line, b: Line, length: float) -> bool:
    """Whether two lines have about the same slope and sag."""
    slopes = [(line.fit.q[[1, 3]] - line.fit.q[[0, 2]]) / length for line in (a, b)]
    low, high = sorted((a.fit.q[4], b.fit.q[4]))
    return bool(np.abs(slopes[0] - slopes[1]).max() < SLOPES_ALIKE and 0 < high <= SAGS_ALIKE * low)


def ends_of(line: Line, lines: Sequence[Line], length: float) -> tuple[int, int]:
    """From which plane to which a conductor is: all that hang alike hang from the same supports."""
    ends = np.array([line.ends, *(other.ends for other in lines if hang_alike(line, other, length))])
    return int(ends[:, 0].min()), int(ends[:, 1].max())


def _curve(views: Views, line: Line, ends: tuple[int, int], x: Float[np.ndarray, " i"]) -> Curve:
    """A line as a curve of the scene frame between two planes."""
    footprint = typical_footprint(views, line.fit.q, x)
    between = float(x[ends[0]]), float(x[ends[1]])
    return Curve.of_fit(line.fit.q, line.fit.covariance, (x[0], x[-1]), between, footprint)


def typical_footprint(views: Views, q: Float[np.ndarray, "5"], x: Float[np.ndarray, " i"]) -> float:
    """Median width of a pixel on the curve, over planes, of the nearest views: those that resolve it."""
    s = np.linspace(0, 1, len(x))
    y, z = curve_point(q, s)
    points = np.stack([x, y, z], 1)
    distance = np.linalg.norm(points[:, None] - views.centre[None], axis=2) / views.focal[:, 0]
    return float(np.median(np.sort(distance, 1)[:, : max(3, len(views.centre) // 4)]))


def search_box(scene: Scene, cell: float) -> Box:
    """Where to look: the span's box where the scene names it, else around the cameras."""
    low, high = scene.box
    shape = np.ceil((high - low)[1:] / cell).astype(int) + 1
    inset = 0.5 * (high[0] - low[0]) / PLANES
    x = np.linspace(low[0] + inset, high[0] - inset, PLANES)
    return Box(x, (float(low[1]), float(low[2])), cell, (int(shape[0]), int(shape[1])))
