"""All wires of a scene, detected in its training images: sweep, narrow, fit, and one curve for each ridge.

The axis of the line must be known (it is the scene frame's x).  The ridges of the best curve are taken out of
the maps before the next is searched, so that no ridge counts for two.  Lines that do not hang are found too,
and left out at the end: edges of roads and tracks would otherwise lend their ridges to wires.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from jaxtyping import Float, Float32

from plnerf.detect.candidate import Candidate, best_hanging, common_ends, hang_alike, select_wires
from plnerf.detect.config import DEFAULT, DetectConfig, SweepConfig
from plnerf.detect.evidence import line_evidence
from plnerf.detect.narrow import curve_point
from plnerf.detect.search import Search
from plnerf.detect.sweep import Box, candidates, candidates_like, sweep
from plnerf.detect.to_wire import typical_footprint, wire_of
from plnerf.detect.views import Views, views_of
from plnerf.line.frame import LineFrame
from plnerf.line.wire import Wire
from plnerf.scene.scene import Scene

Progress = Callable[[int, int], None]
"""Called with the steps done and their total."""


def detect_wires(
    scene: Scene, config: DetectConfig = DEFAULT, progress: Progress | None = None
) -> tuple[Wire, ...]:
    """The wires that the training images show, certain and uncertain, in the order in which they were found.

    In `LineFrame.of_scene(scene.frames)`; both ends are open, and the base runs along x for as far as the
    wires of the same shape are seen.  The steps of `progress` are images and sweeps.
    """
    images, steps = len(scene.train), len(scene.train) + config.search.max_sweeps + 1

    def report(done: int) -> None:
        if progress is not None:
            progress(done, steps)

    views, box = views_of(scene.cameras[list(scene.train)]), search_box(scene, config.sweep)
    x = np.linspace(box.x[0], box.x[-1], config.search.planes)
    responses = line_evidence(scene.images, scene.cameras, scene.train, config.evidence, report)
    search = Search(views, responses, x, config)
    lines = refit_all(search, _lines(search, box, lambda sweeps: report(images + sweeps)))
    # Fitted again, the lines leave more of their ridges to others.
    if more := _like_the_best(search, sweep(views, search.odds, box, config.sweep), box, lines):
        lines = refit_all(search, [*lines, *more])
    report(steps)
    return _wires(search, lines, LineFrame.of_scene(scene.frames))


def compile_kernels() -> None:
    """Has the kernels of the search compiled, on next to nothing; once, then they are on disk."""
    one = np.ones((1, 2))
    views = Views(np.eye(3)[None], np.zeros((1, 3)), 8 * one, 4 * one, np.zeros((1, 5)),
                  np.full((1, 2), 8), np.zeros(1, np.int64))  # fmt: skip
    x = np.linspace(-1, 1, 4)
    box = Box(x, (-0.5, -0.5), 0.25, (4, 4))
    search = Search(views, np.zeros(64, np.float32), x, DEFAULT)
    volume = sweep(views, search.odds, box, DEFAULT.sweep)
    candidates(volume, box, DEFAULT.sweep)
    candidates_like(np.zeros(5), volume, box, DEFAULT.sweep)
    search.score(np.zeros((1, 5)), x)
    search.best(np.zeros((1, 5)), -np.inf)
    search.mask_ridges(Candidate(np.zeros(5), np.eye(5), 1.0, images=1))


def _lines(search: Search, box: Box, swept: Callable[[int], None]) -> list[Candidate]:
    """Lines along the span of any shape, the best first; then of the best one's shape, until none is new."""
    config, lines = search.config, list[Candidate]()
    any_shape = True
    for done in range(config.search.max_sweeps):
        volume, new = sweep(search.views, search.odds, box, config.sweep), list[Candidate]()
        if any_shape:
            most = config.search.max_lines - len(lines)
            pending = candidates(volume, box, config.sweep)
            new = _found_near(search, pending, box, config.select.min_odds, most)
            any_shape = bool(new)
        new = new or _like_the_best(search, volume, box, lines)
        lines += new
        swept(done + 1)
        if not new or len(lines) == config.search.max_lines:
            break
    return lines


def _like_the_best(
    search: Search, volume: Float32[np.ndarray, "i j k"], box: Box, lines: Sequence[Candidate]
) -> list[Candidate]:
    """Further lines that hang as the best of the lines does."""
    config, length = search.config, box.x[-1] - box.x[0]
    best, most = best_hanging(lines, length, config.select), config.search.max_lines - len(lines)
    if best is None or most <= 0:
        return []
    wanted = partial(hang_alike, best, length=length, config=config.select)
    pending = candidates_like(best.theta, volume, box, config.sweep)
    return _found_near(search, pending, box, config.select.min_odds_similar, most, wanted)


def _found_near(
    search: Search,
    pending: Float[np.ndarray, "c 5"],
    box: Box,
    least: float,
    most: int,
    wanted: Callable[[Candidate], bool] | None = None,
) -> list[Candidate]:
    """The lines near some curves, best first, each without the ridges of those before it."""
    lines, batch, fruitless = list[Candidate](), search.config.search.batch, 0
    while len(pending) and fruitless < search.config.search.fruitless and len(lines) < most:
        pending = pending[np.argsort(-search.score(pending, box.x), kind="stable")]
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


def _wires(search: Search, lines: Sequence[Candidate], frame: LineFrame) -> tuple[Wire, ...]:
    """The lines that are wires, numbered from 1."""
    config, x = search.config, search.x
    length = x[-1] - x[0]
    found, wires = select_wires(lines, length, config.select, config.search), []
    for number, line in enumerate(found, 1):
        ends = common_ends(line, found, length, config.select)
        footprint = typical_footprint(search.views, line.theta, x, config.certainty)
        wires.append(wire_of(line, ends, x, footprint, frame, number, config.certainty))
    return tuple(wires)


def search_box(scene: Scene, config: SweepConfig) -> Box:
    """The volume to search: the span's box where the scene names it, else around the cameras."""
    low, high = scene.box
    shape = np.ceil((high - low)[1:] / config.cell).astype(int) + 1
    inset = 0.5 * (high[0] - low[0]) / config.planes
    x = np.linspace(low[0] + inset, high[0] - inset, config.planes)
    return Box(x, (float(low[1]), float(low[2])), config.cell, (int(shape[0]), int(shape[1])))
