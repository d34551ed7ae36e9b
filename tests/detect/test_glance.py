"""Thin lines tell a direction of wires from one of clutter before anything is searched."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.support.drawn import draw, hanging, polyline, scene_of, two_passes

from plnerf.detect import next_direction
from plnerf.detect.config import DetectConfig
from plnerf.detect.config_lines import DirectionConfig
from plnerf.detect.directions import Direction
from plnerf.detect.glance import direction_in_air
from plnerf.detect.in_window import Known
from plnerf.detect.line_maps import LineMaps, line_maps
from plnerf.detect.next_direction import Directions
from plnerf.detect.segments import Segments, segments_of
from plnerf.detect.surroundings import Surroundings
from plnerf.detect.views import Views, views_of
from plnerf.detect.windows import Window, windows_along
from plnerf.scene.scene import Scene

CONFIG = DetectConfig()
LEAST = CONFIG.directions.least_in_air
SPAN = (hanging(-0.08, 0.05), hanging(0.06, 0.02))
Shown = tuple[Scene, Views, LineMaps, Surroundings]


def shown(folder: Path, lines: list[np.ndarray]) -> Shown:
    """What a search begins with, where two passes see these lines."""
    cameras = two_passes(8)
    scene = scene_of(folder, cameras, draw(cameras, lines))
    views = views_of(scene.photo_cameras[list(scene.train)], 1280)
    maps = line_maps(scene.photos, scene.photo_cameras, scene.train, 1280, CONFIG.lines)
    return scene, views, maps, Surroundings(scene.photos, scene.train, 1280, CONFIG.surroundings)


def nothing_known(views: Views) -> Known:
    none = np.zeros(int(views.sizes.prod(1).sum()), np.uint8)
    return Known([], none, none.copy())


def along(direction: Direction, views: Views) -> list[Window]:
    return list(windows_along(direction, views, CONFIG.windows))


@pytest.fixture(scope="module")
def span(tmp_path_factory: pytest.TempPathFactory) -> Shown:
    """Two wires along x."""
    return shown(tmp_path_factory.mktemp("span"), [polyline(wire) for wire in SPAN])


def test_a_direction_of_wires_stays_unless_clutter_has_drawn_it_aside(span: Shown) -> None:
    _, views, maps, surroundings = span
    known = nothing_known(views)
    for aside_deg, stays in ((1.0, True), (4.0, False)):
        voted = Direction(np.radians(aside_deg), 0.1, 3.0, 1.0)
        found = direction_in_air(voted, along(voted, views), views, maps, surroundings, known, LEAST, CONFIG)
        assert found is not None and (found == voted) == stays
        if not stays:
            off = (found.azimuth_rad + np.pi / 2) % np.pi - np.pi / 2
            assert abs(off) < np.radians(0.5) and (found.excess, found.footprint) == (3.0, 1.0)


def test_what_lines_took_and_other_directions_show_nothing(span: Shown) -> None:
    _, views, maps, surroundings = span
    of_wires, across = Direction(0.0, 0.0, 3.0), Direction(np.pi / 2, 0.0, 3.0)
    known = nothing_known(views)
    rest = (views, maps, surroundings, known, LEAST, CONFIG)
    assert direction_in_air(across, along(across, views), *rest) is None
    known.taken[:] = 1
    assert direction_in_air(of_wires, along(of_wires, views), *rest) is None
    assert not known.others.any()


Looks = list[tuple[Direction, float]]


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> Looks:
    """What was looked at, and the nats that a line needed: nothing is shown."""
    made: Looks = []

    def nothing(direction: Direction, *rest: object) -> None:
        made.append((direction, rest[-2]))  # type: ignore[arg-type]

    monkeypatch.setattr(next_direction, "direction_in_air", nothing)
    return made


def vote_for(monkeypatch: pytest.MonkeyPatch, *excess: float) -> list[Direction]:
    some = [Direction(0.3 * k, 0.0, one) for k, one in enumerate((*excess, 0.0))]
    monkeypatch.setattr(next_direction, "strongest", lambda votes, looked, config: some[len(looked)])
    return some


def test_without_lines_in_the_air_directions_are_searched_until_wires_are_found(
    span: Shown, looks: Looks, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the order of their votes, and at last the one in which the cameras flew.  The faint ones are not,
    but had a look; once wires are found only those with more votes have one."""
    scene, views, maps, surroundings = span
    known, none = nothing_known(views), segments_of(maps, views, CONFIG.segments)[0]
    some = vote_for(monkeypatch, 19.0, 8.0, 1.8, 1.2, 0.6, 0.4)
    directions = Directions(scene, views, maps, surroundings, CONFIG)
    assert [directions.following(none, known) for _ in range(2)] == some[:2]
    flown = directions.following(none, known)
    assert flown is not None and abs(np.sin(flown.azimuth_rad)) < 0.05
    assert len(directions.windows(flown)) == len(along(flown, views)) > 0
    assert directions.following(none, known) is None
    usual, much = CONFIG.directions.least_in_air, CONFIG.select.min_odds
    clear = [(some[0], usual), (some[1], usual), (some[2], much)]
    assert looks == [*clear, (some[3], much), (some[4], much)]
    looks.clear()
    directions = Directions(scene, views, maps, surroundings, CONFIG)
    known.wires.append(SPAN[0])
    assert directions.following(none, known) is None
    assert looks == clear


def test_a_direction_to_which_votes_on_both_sides_lead_is_searched_once(
    span: Shown, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, views, maps, surroundings = span
    known, none = nothing_known(views), segments_of(maps, views, CONFIG.segments)[0]
    voted, theirs = Direction(0.50, 0.0, 5.0), Direction(0.43, 0.0, 5.0)
    asked: list[list[float]] = []

    def strongest(votes: object, looked: list[float], config: object) -> Direction:
        asked.append(list(looked))
        return replace(voted, excess=0.0) if looked else voted

    monkeypatch.setattr(next_direction, "strongest", strongest)
    monkeypatch.setattr(next_direction, "direction_in_air", lambda *_: theirs)
    directions = Directions(scene, views, maps, surroundings, CONFIG)
    assert directions.following(none, known) == theirs
    known.wires.append(SPAN[0])
    assert directions.following(none, known) is None
    assert asked == [[], [0.50, 0.43]]


def test_what_many_lines_vote_for_is_searched_without_a_look(
    span: Shown, looks: Looks, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, views, maps, surroundings = span
    known, none = nothing_known(views), segments_of(maps, views, CONFIG.segments)[0]
    some = vote_for(monkeypatch, 300.0, 21.0, 19.0)
    directions = Directions(scene, views, maps, surroundings, CONFIG)
    assert [directions.following(none, known) for _ in range(2)] == some[:2]
    known.wires.append(SPAN[0])
    assert directions.following(none, known) is None
    assert looks == [(some[2], CONFIG.select.min_odds)]


def test_directions_are_no_more_than_asked_and_a_given_one_is_the_only_one(
    span: Shown, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, views, maps, surroundings = span
    segments: Segments = segments_of(maps, views, CONFIG.segments)[0]
    config = replace(CONFIG, directions=DirectionConfig(most=1))
    directions, known = Directions(scene, views, maps, surroundings, config), nothing_known(views)
    first = directions.following(segments, known)
    assert first is not None and abs(np.sin(first.azimuth_rad)) < 0.03
    assert directions.following(segments, known) is None
    directions = Directions(scene, views, maps, surroundings, CONFIG.along(90.0))
    given = directions.following(segments, known)
    assert given is not None and abs(np.sin(given.azimuth_rad)) < 1e-9
    assert directions.following(segments, known) is None
