"""What begins where wires end is found, whichever way it turns, and nothing is where nothing is."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree
from tests.support.drawn import (
    FOCAL,
    FRAME,
    draw,
    hanging,
    pinhole_cameras,
    polyline,
    scene_of,
    two_passes,
    uncertain,
)

from plnerf.detect.config import DetectConfig
from plnerf.detect.config_lines import DirectionConfig, OnwardConfig
from plnerf.detect.detect import detect_wires
from plnerf.detect.onward import places
from plnerf.detect.views import views_of

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
