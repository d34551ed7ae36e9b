"""The first metres of the next spans, whichever way the line turns where wires end.

Beyond a structure images often show a few metres of each wire: too few to vote for a direction, and no more
than two or three planes of a window along a whole flight.  So each place where wires end is searched in small
windows of its own, in all directions in which a line goes on.  The thin lines that voted for directions are
looked through first, which costs little; where some run through the ends of wires, the ridges along them are
searched as in any window.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from jaxtyping import Float, Int

from plnerf.detect.config import DetectConfig
from plnerf.detect.config_windows import OnwardConfig
from plnerf.detect.continuations import ends_of_wires, of_next_span, slopes_of
from plnerf.detect.directions import Direction
from plnerf.detect.in_window import Found, KeptRidges, Known, search_of, wires_in
from plnerf.detect.join import with_onward
from plnerf.detect.line_maps import LineMaps, ridges_of
from plnerf.detect.search import Search
from plnerf.detect.surroundings import Surroundings, projected
from plnerf.detect.views import Views
from plnerf.detect.window_search import judge, lines_onward
from plnerf.detect.windows import Window
from plnerf.line.frame import LineFrame
from plnerf.line.wire import Wire
from plnerf.scene.scene import Scene


def wires_onward(
    scene: Scene,
    views: Views,
    maps: LineMaps,
    surroundings: Surroundings,
    known: Known,
    config: DetectConfig,
) -> list[Wire]:
    """The known wires, longer where they go on, and those that begin where they end; what these take is known
    then."""
    frame, begun = LineFrame.of_scene(scene.frames), list[Wire]()
    onward = config.onward
    near = replace(
        config,
        chains=replace(config.chains, places=onward.places),
        search=replace(config.search, around=onward.around, onward=onward.past),
    )
    sure = replace(near, select=replace(config.select, min_odds_continued=onward.min_odds))
    for place, half, seen in places(known.wires, views, frame, config):
        window = Window(place, 0.0, half, -np.ones(2), np.ones(2), seen, onward.planes)
        for direction in _directions(window, views, maps, surroundings, known, frame, near):
            along = replace(window, azimuth_rad=direction.azimuth_rad)
            ends = ends_of_wires(known.wires, along, frame, near.search.around)

            def find(search: Search, along: Window = along, ends: np.ndarray = ends) -> Found:
                judged = partial(judge, search, along, surroundings)
                lines = lines_onward(search, along, ends, judged)
                wires = of_next_span(lines, search.x, search.config.select)
                return wires, [line for line in lines if line not in wires]

            ridges = KeptRidges(scene, direction, config.evidence).of(seen)
            begun += wires_in(along, views, ridges, known, frame, sure, find)
            known.others = known.taken.copy()
    return with_onward(known.wires, begun)


def places(
    wires: Sequence[Wire], views: Views, frame: LineFrame, config: DetectConfig
) -> Iterator[tuple[Float[np.ndarray, "3"], float, Int[np.ndarray, " k"]]]:
    """Where certain wires end: the middle of their ends, how far windows reach to all sides of it, and the
    views that see anything about it, if these are enough.  Scene frame."""
    left = [np.zeros((0, 2, 3))]
    for wire in wires:
        if wire.evidence.certain:
            a, b = frame.to_scene(wire.points(np.array([0.0, wire.base.length_m])))
            along = (b - a) / np.linalg.norm(b - a)
            left.append(np.array([[a, along], [b, along]]))
    ends, along = np.concatenate(left).transpose(1, 0, 2)
    while len(ends):
        half = config.onward.half_px * _pixel_at(ends[0], views)
        here = np.linalg.norm(ends - ends[0], axis=1) <= half
        about = [ends[here] + side * config.onward.around * half * along[here] for side in (-1, 0, 1)]
        place, shown = ends[here].mean(0), np.concatenate(about)
        ends, along = ends[~here], along[~here]
        seen = np.array([n for n in range(len(views.R)) if (projected(views, n, shown)[2] > 0).any()], int)
        if len(seen) >= config.onward.least_views:
            width = _widths_at(place, views)[seen]
            finest = np.sort(width)[config.onward.least_views - 1]
            yield place, half, seen[width <= config.onward.finest * finest]


def _widths_at(place: Float[np.ndarray, "3"], views: Views) -> Float[np.ndarray, " n"]:
    """Width of each view's pixels at the distance of a place."""
    width: Float[np.ndarray, " n"] = np.linalg.norm(place - views.centre, axis=1) / views.focal[:, 0]
    return width


def _pixel_at(place: Float[np.ndarray, "3"], views: Views) -> float:
    """Median width of a pixel of the views that see a place, or of all."""
    width = _widths_at(place, views)
    seen = np.array([projected(views, n, place[None])[2, 0] > 0 for n in range(len(views.R))])
    return float(np.median(width[seen if seen.any() else slice(None)]))


def _directions(
    window: Window,
    views: Views,
    maps: LineMaps,
    surroundings: Surroundings,
    known: Known,
    frame: LineFrame,
    config: DetectConfig,
) -> list[Direction]:
    """Those in which thin lines run through the ends of wires, the clearest first."""
    onward, found = config.onward, list[tuple[float, Direction]]()
    around = search_of(window, views, ridges_of(maps, views, window.views), known, config)
    for azimuth in _azimuths(onward):
        along = replace(window, azimuth_rad=float(azimuth))
        ends = ends_of_wires(known.wires, along, frame, config.search.around)
        search = around.turned(along.seen_by(views))
        for line in lines_onward(search, along, ends, partial(judge, search, along, surroundings)):
            if not line.likeness > config.select.lies:
                aside, up = np.arctan(slopes_of(line, search.x))
                found.append((line.odds, Direction(float(azimuth + aside) % np.pi, float(up), 0.0)))
    chosen: list[Direction] = []
    for _, one in sorted(found, key=lambda pair: -pair[0]):
        turns = [(one.azimuth_rad - other.azimuth_rad + np.pi / 2) % np.pi - np.pi / 2 for other in chosen]
        if len(chosen) < onward.most and min(np.abs(turns), default=np.inf) > onward.step_rad / 2:
            chosen.append(one)
    return chosen


def _azimuths(config: OnwardConfig) -> Float[np.ndarray, " a"]:
    """All around: a line may turn, another may end there, and neither has a first end."""
    count = int(np.ceil(np.pi / config.step_rad))
    return np.arange(count) * (np.pi / count)
