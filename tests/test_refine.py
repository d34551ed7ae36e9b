"""Wires drawn into pictures are refitted to a fraction of a pixel, and what cannot be is left as it was."""

from pathlib import Path

import numpy as np
import pytest
from dataclasses import replace

from drawn import FOCAL, HALF, draw, hanging, pinhole_cameras, polyline, scene_of, two_passes
from plnerf.errors import SurveyError
from plnerf.scene.scene import Scene
from plnerf.survey.catenary import Base
from plnerf.survey.image_wires import conductors_in_images, of_curve
from plnerf.survey.refine import Refined, refine
from plnerf.wires.curves import Curve

WIRES = (hanging(-0.08, 0.05), hanging(0.06, 0.02, 0.03), hanging(0.0, 0.1, 0.05, askew=0.01, climb=0.02))
PIXEL = 0.45 / FOCAL
"""Width of a pixel at the distance of the passes; the wires are two pixels wide."""
BASE = Base(np.array([-HALF, 0.0]), np.array([1.0, 0.0]), 2 * HALF)
OFF = np.array([2.0, -1.0, -2.0, 1.5, 1.0]) * PIXEL


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    cameras = two_passes(8)
    return scene_of(
        tmp_path_factory.mktemp("drawn"), cameras, draw(cameras, [polyline(wire) for wire in WIRES])
    )


def off(found: Refined, wire: Curve) -> np.ndarray:
    """In pixels, y and z, over the middle nine tenths."""
    s = np.linspace(0.05, 0.95, 60) * BASE.length_m
    return (BASE.at(found.q, s) - wire.points(s - HALF)[:, 1:]) / PIXEL


def test_wires_come_to_their_ridges(scene: Scene) -> None:
    start = [of_curve(wire, BASE) + OFF for wire in WIRES]
    found = refine(scene, BASE, start, [8 * PIXEL] * 3, 2 * PIXEL)
    for one, wire in zip(found, WIRES, strict=True):
        assert one.refused is None
        assert np.abs(off(one, wire)).max() < 0.35 and np.sqrt((off(one, wire) ** 2).mean()) < 0.15
        assert one.rms_px < 0.5 and one.views == 16 and one.moved > PIXEL
        sigma = np.sqrt(np.diag(one.covariance)) / PIXEL
        truth = (one.q - of_curve(wire, BASE)) / PIXEL
        assert (np.abs(truth) < 4 * sigma).all() and sigma.max() < 2


def test_one_that_goes_too_far_stays(scene: Scene) -> None:
    start = [of_curve(wire, BASE) + OFF for wire in WIRES]
    found = refine(scene, BASE, start, [8 * PIXEL, PIXEL, 8 * PIXEL], 2 * PIXEL)
    assert found[1].refused is not None and "times as far as it may be off" in found[1].refused
    assert (found[1].q == start[1]).all() and found[0].refused is None


def test_no_wire_is_refined_where_none_is_seen(scene: Scene) -> None:
    empty = of_curve(hanging(0.14, -0.1, 0.02), BASE)
    (found,) = refine(scene, BASE, [empty], [8 * PIXEL], 2 * PIXEL)
    assert found.refused is not None and (found.q == empty).all()


def test_a_track_along_the_wires_fixes_none(tmp_path: Path) -> None:
    x = np.linspace(-0.75, 0.75, 12)
    centres = np.stack([x, 0 * x - 0.45, 0 * x + 0.05], 1)
    cameras = pinhole_cameras(centres, centres + [0.0, 1.0, -0.1])
    straight = Curve((0.05, 0.0), (0.05, 0.0, 0.001), (-HALF, HALF), 0.01, 0.05, True)
    scene = scene_of(tmp_path, cameras, draw(cameras, [polyline(straight)]))
    (found,) = refine(scene, BASE, [of_curve(straight, BASE)], [8 * PIXEL], 2 * PIXEL)
    assert found.refused is not None and "do not fix it" in found.refused


def test_conductors_are_in_world_units_with_their_evidence(scene: Scene) -> None:
    turn = np.array([[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1.0]])
    frames = replace(scene.frames, R_scene_world=turn, scale=0.05, shift_world=np.array([500.0, 60.0, 7.0]))
    rows = conductors_in_images(replace(scene, frames=frames), WIRES, 2 * PIXEL / 0.05)
    assert [row.id for row in rows] == [1, 2, 3] and len({row.fit.curve.a for row in rows}) == 3
    assert [row.kind for row in rows].count("shield") <= 1
    for row in rows:
        assert row.note is None and row.before is not None and row.coverage > 0.95
        world = row.fit.curve.points(np.linspace(0.1, 0.9, 30) * row.fit.curve.span_m)
        at = frames.to_scene(world)
        apart = [np.abs((at - wire.points(at[:, 0]))[:, 1:]).max() for wire in WIRES]
        assert min(apart) < 0.5 * PIXEL
        # 2 x 0.9 scene units are 36 m; the pictures show all of it.
        assert row.fit.curve.span_m == pytest.approx(36.0, abs=1.5)
        assert 0 < row.fit.sag_sigma_m < 0.2
    heights = [row.fit.curve.lowest[2] for row in rows]
    assert heights == sorted(heights, reverse=True)


def test_a_world_that_lies_on_its_side_is_told(scene: Scene) -> None:
    turn = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    with pytest.raises(SurveyError, match=r"a world with z up, but this scene's up direction is \[0"):
        conductors_in_images(replace(scene, frames=replace(scene.frames, R_scene_world=turn)), WIRES, 0.03)
    assert conductors_in_images(scene, [replace(WIRES[0], certain=False)], 0.03) == []
