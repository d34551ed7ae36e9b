"""Wires drawn into pictures come to a fraction of a pixel; what the pictures do not fix stays as it was."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from tests.support.drawn import FOCAL, HALF, hanging, pinhole_cameras, polyline, scene_of, two_passes
from tests.support.lit_wires import draw_lit

from plnerf.detect.curves import Curve
from plnerf.scene.cameras import Cameras
from plnerf.scene.scene import Scene
from plnerf.scene.transforms import Frames
from plnerf.survey.fit import Base
from plnerf.survey.refine.adjust import VIEWS, Prior, State, adjust
from plnerf.survey.refine.curves import Held, cut, of_curve, refit_curves
from plnerf.survey.refine.profile import Sightings, sightings
from plnerf.survey.refine.projection import Track, crossings, track
from plnerf.survey.refine.refine import Refined, double, refine

WIRES = (hanging(-0.08, 0.05), hanging(0.06, 0.02, 0.03), hanging(0.0, 0.1, 0.05, askew=0.01, climb=0.02))
PIXEL = 0.45 / FOCAL
"""Width of a pixel at the distance of the passes."""
DIAMETER = 2 * PIXEL
LIGHT = np.array([0.0, 0.6, 0.8])
BASE = Base(np.array([-HALF, 0.0]), np.array([1.0, 0.0]), 2 * HALF)
OFF = np.array([1.2, -0.8, -1.2, 0.8, 0.6]) * PIXEL
TRUST = [4 * PIXEL] * 3


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    cameras = two_passes(8)
    return scene_of(tmp_path_factory.mktemp("drawn"), cameras, lit(cameras, *WIRES))


def lit(cameras: Cameras, *wires: Curve) -> list[np.ndarray]:
    return draw_lit(cameras, [polyline(wire, 120) for wire in wires], DIAMETER, LIGHT)


def off(found: Refined, wire: Curve) -> np.ndarray:
    """In pixels, y and z, over the middle nine tenths."""
    s = np.linspace(0.05, 0.95, 60) * BASE.length_m
    return (BASE.at(found.q, s) - wire.points(s - HALF)[:, 1:]) / PIXEL


def test_wires_come_to_where_they_are_drawn(scene: Scene) -> None:
    start = [of_curve(wire, BASE) + OFF for wire in WIRES]
    done: list[tuple[int, int]] = []
    found = refine(scene, BASE, start, TRUST, DIAMETER, lambda *at: done.append(at))
    assert done[-1][0] == done[-1][1] and len(done) > 3
    assert found.motion_px < 0.2
    for one, wire in zip(found.wires, WIRES, strict=True):
        assert one.refused is None
        assert np.abs(off(one, wire)).max() < 0.4 and np.sqrt((off(one, wire) ** 2).mean()) < 0.2
        assert one.views >= 12
        sigma = np.sqrt(np.diag(one.covariance)) / PIXEL
        assert (np.abs(one.q - of_curve(wire, BASE)) / PIXEL < 4 * sigma).all() and sigma.max() < 1


def test_what_images_are_off_by_is_learnt_and_does_not_reach_the_wires(tmp_path: Path) -> None:
    """Each picture shifted by a pixel or so of its own."""
    cameras = two_passes(8)
    random = np.random.default_rng(3)
    pictures = lit(cameras, *WIRES)
    for picture in pictures:
        dx, dy = random.normal(size=2)
        move = np.array([[1, 0, dx], [0, 1, dy]])
        picture[:] = cv2.warpAffine(picture, move, picture.shape[1::-1], borderMode=cv2.BORDER_REPLICATE)
    start = [of_curve(wire, BASE) + OFF for wire in WIRES]
    found = refine(scene_of(tmp_path, cameras, pictures), BASE, start, TRUST, DIAMETER)
    assert 0.6 < found.motion_px < 1.5
    for one, wire in zip(found.wires, WIRES, strict=True):
        assert one.refused is None and np.sqrt((off(one, wire) ** 2).mean()) < 0.5


def test_one_that_goes_too_far_stays(scene: Scene) -> None:
    start = [of_curve(wire, BASE) + OFF for wire in WIRES]
    found = refine(scene, BASE, start, [4 * PIXEL, 0.4 * PIXEL, 4 * PIXEL], DIAMETER).wires
    assert found[1].refused is not None and "times as far as it may be off" in found[1].refused
    assert (found[1].q == start[1]).all() and found[0].refused is None


def test_no_wire_is_refined_where_none_is_seen(scene: Scene) -> None:
    empty = of_curve(hanging(0.14, -0.1, 0.02), BASE)
    (found,) = refine(scene, BASE, [empty], [4 * PIXEL], DIAMETER).wires
    assert found.refused is not None and (found.q == empty).all()


def test_what_no_image_shows_comes_to_what_was_known_before() -> None:
    random = np.random.default_rng(0)
    known = np.array([of_curve(wire, BASE) for wire in WIRES])
    state = State(
        known + random.normal(size=(3, 5)) * PIXEL,
        *(random.normal(size=shape) for shape in ((4, 3), (3, VIEWS), (3, 2), 2)),
    )
    nothing = Sightings(*(np.zeros((0, *rest)) for rest in ((), (2,), (3,), (), (), (), ())))
    step = adjust(BASE, state, Prior(known, np.array(TRUST), DIAMETER, 0.1), [[nothing] * 3] * 4)
    np.testing.assert_allclose(step.state.q, known, atol=1e-3 * PIXEL)
    for name in ("motion", "bias", "light", "common_light"):
        np.testing.assert_allclose(getattr(step.state, name), 0, atol=1e-9)
    # Nor is there a spread among images that would tell otherwise than what was known.
    np.testing.assert_allclose(step.spread, step.covariance, rtol=1e-6, atol=1e-9 * step.covariance.max())


def test_a_track_along_the_wires_fixes_none(tmp_path: Path) -> None:
    x = np.linspace(-0.75, 0.75, 12)
    centres = np.stack([x, 0 * x - 0.45, 0 * x + 0.05], 1)
    cameras = pinhole_cameras(centres, centres + np.array([0.0, 1.0, -0.1]))
    straight = Curve((0.05, 0.0), (0.05, 0.0, 0.001), (-HALF, HALF), 0.01, 0.05, True)
    scene = scene_of(tmp_path, cameras, lit(cameras, straight))
    (found,) = refine(scene, BASE, [of_curve(straight, BASE)], [0.05], DIAMETER).wires
    assert found.refused is not None and "do not fix it" in found.refused


def test_curves_come_out_in_world_units_and_cut(scene: Scene) -> None:
    turn = np.array([[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1.0]])
    frames = replace(scene.frames, R_scene_world=turn, scale=0.05, shift_world=np.array([500.0, 60.0, 7.0]))
    curves = [replace(wire, ends=(-0.7, 0.8), reach=4 * PIXEL) for wire in WIRES]
    rows, motion_px = refit_curves(replace(scene, frames=frames), curves, DIAMETER / 0.05 / 0.03)
    assert motion_px < 0.2
    for row, wire in zip(rows, curves, strict=True):
        assert row.refused is None and row.images >= 12
        for line in (row.before, row.after):
            assert line.base.length_m == pytest.approx(1.5 / 0.05)
            points = line.base.curve(line.q).points(np.linspace(0, line.base.length_m, 30))
            at = frames.to_scene(points)
            assert np.abs((at - wire.points(at[:, 0]))[:, 1:]).max() < 0.5 * PIXEL
            assert at[[0, -1], 0] == pytest.approx([-0.7, 0.8], abs=1e-3)
    assert refit_curves(scene, [], 1.0) == ([], 0.0)


def test_a_cut_wire_is_as_certain_as_the_whole() -> None:
    """By draws from the covariance."""
    random = np.random.default_rng(1)
    q, half = of_curve(WIRES[2], BASE), random.normal(size=(5, 5)) * 1e-3
    covariance = half @ half.T
    frames = Frames(np.eye(3), 1.0, np.zeros(3), "m", None, "file")
    line = cut(BASE, q, covariance, (-0.5, 0.7), frames)
    draws = random.multivariate_normal(q, covariance, 4000)
    s = np.array([0.4, 1.0, 1.6])
    spread = np.std([BASE.at(one, s) for one in draws], axis=0)
    J = line.base.by_q(line.q, s - 0.4)
    stated = np.sqrt(np.einsum("kij,jl,kil->ki", J, line.covariance, J))
    np.testing.assert_allclose(stated, spread, rtol=0.06)


def test_a_moved_wire_is_told_by_the_profile() -> None:
    """-B / A is where the wire is, wherever it is looked for within a pixel."""
    cameras = two_passes(8)[[3]]
    camera, s = double(cameras), np.linspace(0, BASE.length_m, 200)
    lines = [polyline(wire, 120) for wire in WIRES]
    grey = cv2.cvtColor(draw_lit(cameras, lines, DIAMETER, np.zeros(3))[0], cv2.COLOR_RGB2GRAY)
    grey = grey.astype(np.float32)
    q = of_curve(WIRES[0], BASE)
    tracks = [track(camera, BASE, of_curve(wire, BASE), s, np.zeros(3)) for wire in WIRES[1:]]
    for away in (-0.8, 0.0, 0.8):
        moved = q + np.array([away, away, 0, 0, 0]) * PIXEL
        one = sightings(grey, None, track(camera, BASE, moved, s, np.zeros(3)), tracks, 0.6, DIAMETER)
        clear = np.abs(one.A) > 5 * np.sqrt(one.variance_A)
        assert clear.sum() > 30
        expected = -away * PIXEL * one.g[clear, 0]
        np.testing.assert_allclose(np.median((-one.B / one.A)[clear] - expected), 0, atol=0.1)


def test_crossings_are_where_the_lines_meet() -> None:
    s = np.linspace(0, 1, 41)
    along = np.stack([10 + 80 * s, np.full(41, 50.0)], 1)
    other = np.stack([10 + 80 * s, 50 + 8 * (s - 0.5)], 1)
    lines = [_flat(along), _flat(other)]
    apart = crossings(lines[0], [lines[1], _flat(along + np.array([0, 60.0]))], 3.0, 2)
    # Normals point to positive y for a line to the right.
    expected = other[:, 1] - 50
    near = np.abs(expected) < 2.8
    np.testing.assert_allclose(apart[near, 0], expected[near], atol=1e-6)
    assert np.isnan(apart[np.abs(expected) > 3.2]).all() and np.isnan(apart[:, 1]).all()
    across = np.stack([np.full(41, 50.2), 10 + 80 * s], 1)
    assert crossings(lines[0], [_flat(across)], 3.0, 1)[20, 0] == 0.0


def _flat(pixel: np.ndarray) -> Track:
    tangent = np.gradient(pixel, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], 1)
    s, yes, still = np.linspace(0, 1, len(pixel)), np.ones(len(pixel), bool), np.zeros((len(pixel), 3))
    return Track(s, pixel, tangent, normal, normal, still, yes, yes)


def test_a_seen_support_makes_ends_uncertain(scene: Scene) -> None:
    curves = [replace(wire, ends=(-0.6, 0.6), reach=4 * PIXEL) for wire in WIRES]
    rows, _ = refit_curves(scene, curves, DIAMETER / 0.03, (Held(-0.65, 0.1), None))
    for row in rows:
        assert row.end_sigma == (pytest.approx(0.1 * DIAMETER / 0.03), 0.0)
        first, last = row.after.base.curve(row.after.q).points(np.array([0.0, row.after.base.length_m]))
        assert scene.frames.to_scene(np.array([first, last]))[:, 0] == pytest.approx([-0.65, 0.6], abs=1e-3)
