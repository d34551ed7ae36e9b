"""All wires of a scene, detected in its training images: which way lines run, then where they hang.

Thin lines of all images vote for a direction; windows along it are searched (`window_search.py`); what was
found there votes no longer, and the next direction is searched, as long as lines of many images agree on one
(`next_direction.py`).
At last the ends of wires are searched for what begins there (`onward.py`).  Nobody needs to know where a line
runs, how many there are, and where they bend.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from jaxtyping import Bool, Int, UInt8

from plnerf.detect.candidate import Candidate
from plnerf.detect.chains import chains_of
from plnerf.detect.config import DEFAULT, DetectConfig
from plnerf.detect.continuations import ends_of_wires
from plnerf.detect.directions import Direction, vote
from plnerf.detect.in_window import KeptRidges, Known, wires_in
from plnerf.detect.join import joined
from plnerf.detect.line_maps import LineMaps, line_maps
from plnerf.detect.line_ridges import LineRidges
from plnerf.detect.meets import curves_where_chains_meet
from plnerf.detect.next_direction import Directions
from plnerf.detect.onward import wires_onward
from plnerf.detect.refit_sums import design_matrix, left_by_views, rests, sums_of_views
from plnerf.detect.search import Search
from plnerf.detect.segments import Segments, linked, segments_of
from plnerf.detect.structures import ended_where_they_meet, in_one_piece
from plnerf.detect.surroundings import Surroundings, projected
from plnerf.detect.views import Views, views_of
from plnerf.detect.window_search import find_lines
from plnerf.detect.windows import Window
from plnerf.line.frame import LineFrame
from plnerf.line.wire import Wire
from plnerf.scene.scene import Scene

Progress = Callable[[int, int], None]
"""Called with the steps done and their total."""
STEPS, MAPS, EVIDENCE, LATER = 1000, 0.2, 0.15, 0.2
"""Of progress: its steps; how much of the work it is to find the thin lines of all images; how much of
a window the evidence is; and how much is left after each direction, of which the first has most wires."""
FindWires = Callable[[Scene, DetectConfig, Progress | None], tuple[Wire, ...]]
"""`detect_wires`, or what stands in its place."""


def detect_wires(
    scene: Scene, config: DetectConfig = DEFAULT, progress: Progress | None = None
) -> tuple[Wire, ...]:
    """The wires that the training images show, certain and uncertain, in the order in which they were found.

    Photos are read at their full size, whatever the resolution that the scene is trained at.  The wires
    are in `LineFrame.of_scene(scene.frames)`.  Each is one conductor over a stretch in which it is one
    catenary, its base along its own direction; both ends are open.  Progress is counted in thousandths of
    the work, roughly.  Raises SceneError where an azimuth is given and the scene has no north.
    """
    images, count, shown = len(scene.train), 0, 0

    def report(share: float) -> None:
        nonlocal shown
        done = round(STEPS * share)
        if progress is not None and done > shown:
            progress(done, STEPS)
        shown = max(shown, done)

    cameras, most_px = scene.photo_cameras, config.evidence.most_px
    views = views_of(cameras[list(scene.train)], most_px)
    maps = line_maps(
        scene.photos, cameras, scene.train, most_px, config.lines, lambda done: report(MAPS * done / images)
    )
    segments, piece = segments_of(maps, views, config.segments)
    at = views.starts[maps.view] + maps.pixel
    none = np.zeros(int(views.sizes.prod(1).sum()), np.uint8)
    surroundings = Surroundings(scene.photos, scene.train, most_px, config.surroundings)
    known, directions = Known([], none, none.copy()), Directions(scene, views, maps, surroundings, config)

    def following() -> Direction | None:
        left = _left(piece[piece >= 0], known.taken[at[piece >= 0]], len(segments.owner))
        return directions.following(segments.of(left), known)

    while (direction := following()) is not None:
        ridges = KeptRidges(scene, direction, config.evidence)
        begin, end = (1 - (1 - MAPS) * LATER**k for k in (count, count + 1))
        count += 1
        windows, pieces = directions.windows(direction), list[list[Wire]]()
        edges = np.linspace(begin, end, len(windows) + 1)
        for window, *edge in zip(windows, edges, edges[1:], strict=False):
            part = partial(_within, report, *edge)
            pieces.append(_in_window(scene, views, window, ridges, surroundings, known, config, part))
        known.wires += joined(pieces, config.join)
        known.others = known.taken.copy()
    if config.directions.azimuth_deg is None:
        known.wires = wires_onward(scene, views, maps, surroundings, known, config)
    report(1.0)
    wires = ended_where_they_meet(in_one_piece(known.wires, config.meet, config.join), config.meet)
    return tuple(replace(wire, id=number) for number, wire in enumerate(wires, 1))


def _within(report: Callable[[float], None], begin: float, end: float, share: float) -> None:
    """Reports a share of a part of the work, from `begin` to `end`."""
    report(begin + (end - begin) * share)


def compile_kernels() -> None:
    """Has the kernels of the search compiled, on next to nothing; once, then they are on disk."""
    one = np.ones((1, 2))
    views = Views(np.eye(3)[None], np.zeros((1, 3)), 8 * one, 4 * one, np.zeros((1, 5)),
                  np.full((1, 2), 8), np.zeros(1, np.int64))  # fmt: skip
    x = np.linspace(-1, 1, 4)
    two = Views(*(np.repeat(part, 2, axis=0) for part in views))
    first, dot = np.zeros(1, np.int64), np.ones((1, 3), np.float32)
    linked(LineMaps(first, first, dot[:, 0], dot), views, DEFAULT.segments)
    seen = Segments(np.arange(2), np.eye(3)[:2], np.ones((2, 2, 3)), np.ones(2))
    vote(seen, two, DEFAULT.directions)
    search = Search(views, LineRidges(np.zeros(64, np.float32), np.zeros(64, np.uint8)), x, DEFAULT)
    chains = chains_of(search.responses, views, DEFAULT.odds.min_response, DEFAULT.chains)
    curves_where_chains_meet(chains, views, x, np.full(2, -1.0), np.full(2, 1.0), DEFAULT.chains)
    projected(views, 0, np.ones((1, 3)))
    search.distinct(np.zeros((1, 6)))
    search.best(np.zeros((1, 6)), -np.inf)
    J = design_matrix(np.ones((1, 6)), 2, 4)
    sums = sums_of_views(J, np.ones(1), np.ones(1, np.int64), 2)
    left_by_views(sums, 1.0)
    rests(J, np.ones(1, np.int64), np.zeros((2, 2)), sums, np.zeros(6), 1.0)
    line = Candidate(np.zeros(6), np.eye(6), 1.0, images=1)
    search.odds_in_planes(line, search.odds.sharp_px)
    search.mask_ridges(line)


def _left(piece: Int[np.ndarray, " m"], taken: UInt8[np.ndarray, " m"], count: int) -> Bool[np.ndarray, " s"]:
    """Which segments are not found yet: lines took less than half of their pixels."""
    return 2 * np.bincount(piece, taken, count) < np.bincount(piece, minlength=count)


def _in_window(
    scene: Scene,
    views: Views,
    window: Window,
    ridges: KeptRidges,
    surroundings: Surroundings,
    known: Known,
    config: DetectConfig,
    report: Callable[[float], None],
) -> list[Wire]:
    """The wires in a window along a direction."""
    frame, seen = LineFrame.of_scene(scene.frames), ridges.of(window.views)
    before = ends_of_wires(known.wires, window, frame, config.search.around)
    report(EVIDENCE)
    find = partial(
        find_lines, window=window, surroundings=surroundings, ends=before,
        report=partial(_within, report, EVIDENCE, 1.0),
    )  # fmt: skip
    wires = wires_in(window, views, seen, known, frame, config, find)
    report(1.0)
    return wires
