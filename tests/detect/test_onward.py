"""What begins where wires end is found, whichever way it turns, and nothing is where nothing is."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree
from tests.support.drawn import (
    FOCAL,
    FRAME,
    HALF,
    draw,
    hanging,
    pinhole_cameras,
    polyline,
    scene_of,
    two_passes,
    uncertain,
)

from plnerf.detect.config import DetectConfig
from plnerf.detect.config_lines import DirectionConfig
from plnerf.detect.config_windows import OnwardConfig
from plnerf.detect.detect import detect_wires
from plnerf.detect.in_window import Known, search_of, wires_in
from plnerf.detect.line_maps import line_maps, ridges_of
from plnerf.detect.line_ridges import LineRidges
from plnerf.detect.onward import places
from plnerf.detect.views import Views, views_of
from plnerf.detect.windows import Window

PIXEL = 0.45 / FOCAL
"""Width of a pixel at the distance of the passes."""
CONFIG = DetectConfig(directions=DirectionConfig(most=1), onward=OnwardConfig(half_px=100.0))
"""Pictures of 240 pixels; a second direction is not voted for."""
SPAN = (hanging(-0.08, 0.05), hanging(0.06, 0.02))
TURN = np.radians(40.0)


def onward(corner: np.ndarray, length: float) -> np.ndarray:
    """The next span's wire from the structure on, until it is seen no more."""
    s = np.linspace(0, length, 60)[:, None]
    hung = 0.15 * s * (s - 1.2)  # the low point is far beyond
    return corner + s * np.array([np.cos(TURN), np.sin(TURN), 0.0]) + hung * np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize("length", [0.3, 0.0], ids=["next span", "nothing"])
def test_the_first_metres_of_a_span_that_turns_are_found(tmp_path: Path, length: float) -> None:
    cameras = two_passes(14)
    corners = [wire.points(np.array([0.72 * wire.base.length_m]))[0] for wire in SPAN]  # both at one x
    first = [polyline(wire)[:289] for wire in SPAN]
    beyond = [onward(corner, length) for corner in corners if length]
    pictures = draw(cameras, [*first, *beyond])
    found = [wire for wire in detect_wires(scene_of(tmp_path, cameras, pictures), CONFIG)
             if wire.evidence.certain]  # fmt: skip
    assert len(found) == 2 + len(beyond)
    seen = cKDTree(np.concatenate([polyline(wire) for wire in found]))
    for line in beyond:
        assert seen.query(line)[0].mean() < 2 * PIXEL


def test_wires_that_end_together_are_one_place_with_the_views_that_see_it() -> None:
    """Two wires of 1.8 end together at both sides; of a third, whose place nothing fixes, nobody asks."""
    near_one_end = np.stack([np.full(8, 0.85), np.linspace(-0.6, 0.6, 8), np.full(8, 0.7)], 1)
    target = np.tile([0.9, 0.0, 0.05], (8, 1))
    cameras = pinhole_cameras(near_one_end - [0.4, 0.0, 0.0], target)
    views = views_of(cameras, 1280)
    wires = [*SPAN, uncertain(hanging(0.0, 0.3))]
    ((place, half, seen),) = places(wires, views, FRAME, CONFIG)
    np.testing.assert_allclose(place, np.mean([wire.points(np.array([1.8]))[0] for wire in SPAN], 0))
    distance = np.linalg.norm(SPAN[0].points(np.array([1.8]))[0] - views.centre, axis=1)
    assert 100 * distance.min() / FOCAL < half < 100 * distance.max() / FOCAL
    assert seen.tolist() == list(range(8))
    many = replace(CONFIG, onward=replace(CONFIG.onward, least_views=9))
    assert list(places(wires, views, FRAME, many)) == []
    assert list(places([], views, FRAME, CONFIG)) == []


def drawn_window(tmp_path: Path) -> tuple[Window, Views, LineRidges, Known]:
    """Along one wire that is drawn, of which nothing is known."""
    cameras = two_passes(6)
    scene = scene_of(tmp_path, cameras, draw(cameras, [polyline(SPAN[0])]))
    views = views_of(scene.photo_cameras[list(scene.train)], 1280)
    maps = line_maps(scene.photos, scene.photo_cameras, scene.train, 1280, CONFIG.lines)
    every = np.arange(len(views.R))
    window = Window(np.zeros(3), 0.0, HALF, -np.ones(2), np.ones(2), every, 60)
    nothing = np.zeros(int(views.sizes.prod(1).sum()), np.uint8)
    return window, views, ridges_of(maps, views, every), Known([], nothing, nothing.copy())


def test_a_search_that_is_turned_finds_the_same_and_leaves_the_first_as_it_is(tmp_path: Path) -> None:
    """In a window that lies the other way: the same line, its ends exchanged."""
    window, views, ridges, known = drawn_window(tmp_path)
    other = replace(window, azimuth_rad=np.pi)
    first = search_of(window, views, ridges, known, CONFIG)
    turned = first.turned(other.seen_by(views))
    (y_A, y_B, z_A, z_B, b, d), least = SPAN[0].theta / HALF, CONFIG.select.min_odds
    line, _ = first.best(np.array([[y_A, y_B, z_A, z_B, b, d]]), least)
    before = first.odds
    same, _ = turned.best(np.array([[-y_B, -y_A, z_B, z_A, b, -d]]), least)
    assert line is not None and same is not None
    assert same.odds == pytest.approx(line.odds, rel=0.02)
    turned.mask_ridges(same)
    assert not first.claims.masks.any() and first.odds is before and turned.claims.masks.any()
    assert turned.chains is first.chains


def test_a_line_that_is_known_in_one_plane_is_no_wire(tmp_path: Path) -> None:
    """Its ends are moved up to where its place is known, and these are one."""
    window, views, ridges, known = drawn_window(tmp_path)
    line, _ = search_of(window, views, ridges, known, CONFIG).best(
        SPAN[0].theta[None] / HALF * [1, 1, 1, 1, 1, 0], CONFIG.select.min_odds
    )
    assert line is not None
    one = replace(line, covariance=line.covariance + np.diag([1.0] * 4 + [0.0] * 2), seen=(7, 7))
    assert len(wires_in(window, views, ridges, known, FRAME, CONFIG, lambda _: ([line], []))) == 1
    assert wires_in(window, views, ridges, known, FRAME, CONFIG, lambda _: ([one], [])) == []
