"""Wires drawn into pictures come to a fraction of a pixel; what the pictures do not fix stays as it was."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from tests.support.drawn import FOCAL, HALF, pinhole_cameras, scene_of, two_passes
from tests.support.lit_wires import draw_lit

from plnerf.line.base import Base
from plnerf.line.curve import curve_at
from plnerf.line.ends import Evidence, Open
from plnerf.line.wire import Wire
from plnerf.scene.cameras import Cameras
from plnerf.scene.scene import Scene
from plnerf.survey.posed_photos import Photos, photos_of
from plnerf.survey.refine.adjust import Step, adjust
from plnerf.survey.refine.config import AdjustConfig, ProfileConfig, RefineConfig
from plnerf.survey.refine.diameter import likelier_widths
from plnerf.survey.refine.judge import stretches_seen
from plnerf.survey.refine.pose_prior import PosePrior
from plnerf.survey.refine.profiles import ProfileMeasurements, measure_profiles
from plnerf.survey.refine.projection import MOVES, Projection, crossings, places_along, project_wire
from plnerf.survey.refine.refine import refine_wires
from plnerf.survey.refine.unknowns import Prior, State

PIXEL = 0.45 / FOCAL
"""Width of a pixel at the distance of the passes."""
BASE = Base(np.array([-HALF, 0.0]), np.array([HALF, 0.0]))
CONFIG = RefineConfig(diameter_m=2 * PIXEL)
"""The drawn scenes are two metres long."""
LIGHT = np.array([0.0, 0.6, 0.8])
OFF = np.array([1.2, -0.8, -1.2, 0.8, 0.6, 0.0]) * PIXEL
END_ON, CROSSING = CONFIG.profile.end_on, CONFIG.profile.least_crossing
STILL = np.zeros(MOVES)
"""The pose residual of an image whose pose is right."""


def hung(y: float, z: float, sag: float = 0.04, *, askew: float = 0.0, climb: float = 0.0) -> Wire:
    """From end to end of the box; known to within four pixels."""
    theta = np.array([y - askew * HALF, y + askew * HALF, z - climb * HALF, z + climb * HALF, sag, 0.0])
    evidence = Evidence("a drawing", 1, reach_m=4 * PIXEL)
    return Wire(0, BASE, theta, np.diag([PIXEL**2] * 5 + [0.0]), (Open("drawn"), Open("drawn")), evidence)


WIRES = (hung(-0.08, 0.05), hung(0.06, 0.02, 0.03), hung(0.0, 0.1, 0.05, askew=0.01, climb=0.02))
MOVED = tuple(replace(wire, theta=wire.theta + OFF) for wire in WIRES)


def polyline(wire: Wire) -> np.ndarray:
    return wire.points(np.linspace(0.0, wire.base.length_m, 120))


def lit(cameras: Cameras, *wires: Wire) -> list[np.ndarray]:
    return draw_lit(cameras, [polyline(wire) for wire in wires], CONFIG.diameter_m, LIGHT)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    cameras = two_passes(8)
    return scene_of(tmp_path_factory.mktemp("drawn"), cameras, lit(cameras, *WIRES))


@pytest.fixture(scope="module")
def photos(scene: Scene) -> Photos:
    entered = photos_of(scene)
    assert entered.frame.to_scene(np.ones(3)) == pytest.approx(np.ones(3))  # these scenes are metric
    return entered


def off(found: Wire, wire: Wire) -> np.ndarray:
    """In pixels, y and z, over the middle nine tenths."""
    s = np.linspace(0.05, 0.95, 60) * BASE.length_m
    return (found.at(s) - wire.at(s)) / PIXEL


def refused(wire: Wire) -> str:
    """Why it was not refitted; empty if it was."""
    return " ".join(text for text in wire.notes if "not refitted" in text)


def test_wires_come_to_where_they_are_drawn(photos: Photos) -> None:
    done: list[tuple[int, int]] = []
    found = refine_wires(photos, MOVED, CONFIG, lambda *at: done.append(at))
    assert done[-1][0] == done[-1][1] and len(done) > 3
    assert found.pose_residual_px < 0.2
    for one, wire in zip(found.wires, WIRES, strict=True):
        assert not refused(one)
        assert np.abs(off(one, wire)).max() < 0.4 and np.sqrt((off(one, wire) ** 2).mean()) < 0.2
        assert one.evidence.count >= 12
        assert one.evidence.seen_m is not None
        assert sum(high - low for low, high in one.evidence.seen_m) > 0.6 * BASE.length_m
        sigma = np.sqrt(np.diag(one.covariance))[:5] / PIXEL
        assert (np.abs(one.theta - wire.theta)[:5] / PIXEL < 4 * sigma).all() and sigma.max() < 1
        assert one.swing_deg is not None and one.swing_deg.sigma < 6  # half a degree of it is a pixel
        assert abs(one.swing_deg.value) < 3 * one.swing_deg.sigma
    assert refine_wires(photos, [], CONFIG).wires == ()


def test_what_is_thicker_than_conductors_must_stand_out_more(photos: Photos) -> None:
    assert all(refine_wires(photos, WIRES, CONFIG).shown)
    thin = CONFIG.diameter_m / 2
    for least, shown in ((1.0, True), (1e9, False)):
        found = refine_wires(photos, WIRES, replace(CONFIG, thick_m=thin, least_beside_thick=least))
        assert found.shown == (shown,) * 3
    # Of what does not stand out nothing is known to be thick.
    faint = replace(CONFIG, thick_m=thin, least_beside=1e8, least_beside_thick=1e9, doubtful_diameters=1e9)
    assert refine_wires(photos, WIRES, faint).shown == (True,) * 3


@pytest.mark.slow
def test_pose_residuals_are_learnt_and_do_not_reach_the_wires(tmp_path: Path) -> None:
    """Each picture shifted by a pixel or so of its own."""
    cameras = two_passes(8)
    random = np.random.default_rng(3)
    pictures = lit(cameras, *WIRES)
    for picture in pictures:
        dx, dy = random.normal(size=2)
        move = np.array([[1, 0, dx], [0, 1, dy]])
        picture[:] = cv2.warpAffine(picture, move, picture.shape[1::-1], borderMode=cv2.BORDER_REPLICATE)
    found = refine_wires(photos_of(scene_of(tmp_path, cameras, pictures)), MOVED, CONFIG)
    assert 0.6 < found.pose_residual_px < 1.5
    for one, wire in zip(found.wires, WIRES, strict=True):
        assert not refused(one) and np.sqrt((off(one, wire) ** 2).mean()) < 0.5


def test_pose_residuals_turn_and_move_what_is_seen() -> None:
    """By what a camera that turns, or moves, sees of the same wire; mu and mv are of a pixel at `usual`."""
    camera, s, usual, small = doubled(two_passes(8)[[3]]), np.linspace(0.6, 1.0, 7), 0.5, 1e-4
    places = places_along(BASE, WIRES[0].theta, s)
    seen = project_wire(camera, places, STILL, usual, END_ON)
    assert seen.good.all()
    for k, unit in enumerate(np.eye(MOVES) * small):
        moved = project_wire(camera, places, unit, usual, END_ON)
        across = ((moved.pixel - seen.pixel) * seen.normal).sum(1)
        np.testing.assert_allclose(across, small * seen.by_pose[:, k], atol=1e-12)
    R, focal = camera.R_scene_camera[0].numpy(), float(camera.focal_px[0, 0])
    # What is seen moves against the camera, and outwards where it comes nearer.
    for axis, sign in enumerate((-1.0, -1.0, 1.0)):
        there = replace(camera, centre=camera.centre + torch.from_numpy(small * R[:, axis]))
        shift = project_wire(there, places, STILL, usual, END_ON).pixel - seen.pixel
        residual = sign * focal * small / usual * np.eye(MOVES)[3 + axis]
        told = project_wire(camera, places, residual, usual, END_ON).pixel - seen.pixel
        np.testing.assert_allclose(told, shift, atol=2e-3 * np.abs(shift).max())


@pytest.mark.slow
def test_cameras_that_are_moved_do_not_reach_the_wires(tmp_path: Path) -> None:
    """Each by a share of a hundredth of its distance: near wires move by more pixels than far ones."""
    told, random = two_passes(8), np.random.default_rng(4)
    moved = torch.from_numpy(random.normal(size=told.centre.shape) * 1.5 * PIXEL).to(told.centre)
    pictures = lit(replace(told, centre=told.centre + moved), *WIRES)
    found = refine_wires(photos_of(scene_of(tmp_path, told, pictures)), MOVED, CONFIG)
    assert 0.5 < found.pose_residual_px < 3
    s = np.linspace(0.05, 0.95, 60) * BASE.length_m
    for one, wire in zip(found.wires, WIRES, strict=True):
        assert not refused(one) and (np.abs(off(one, wire)) * PIXEL < 4 * one.sigma_at(s)).all()
        assert np.median(one.sigma_at(s)) < 3 * PIXEL  # few images show the ends


@pytest.mark.slow
def test_what_is_refitted_stands_out_more_than_what_is_beside_it(tmp_path: Path) -> None:
    """On ground full of short lines, a curve that is on no wire gathers as many as its neighbourhood."""
    cameras, random = two_passes(8), np.random.default_rng(5)
    pictures = lit(cameras, *WIRES)
    for picture in pictures:
        low = np.array([0, 0])
        for start, along in zip(
            random.uniform(low, picture.shape[1::-1], (400, 2)), random.normal(0, 12, (400, 2)), strict=True
        ):
            ends = (tuple(np.round(one).astype(int).tolist()) for one in (start, start + along))
            cv2.line(picture, *ends, (60, 60, 60), 2)
    photos = photos_of(scene_of(tmp_path, cameras, pictures))
    absent = replace(hung(0.14, -0.1, 0.02), covariance=np.diag([1e-4 * PIXEL] * 6))
    config = replace(CONFIG, least_near=0.0, most_moved=1e9)
    sharp = replace(config, doubtful_diameters=1e9)
    assert refine_wires(photos, [*MOVED, absent], sharp).shown == (True,) * 4
    blunt = refine_wires(photos, [*MOVED, absent], replace(config, doubtful_diameters=0.0))
    assert blunt.shown == (True, True, True, False)
    found = blunt.wires
    assert not any(refused(one) for one in found[:3])
    assert "times as often as what is beside it" in refused(found[3])
    assert found[3].worst_sigma() >= absent.evidence.reach_m


def test_what_light_leaves_of_each_view_is_in_the_stated_deviation(photos: Photos) -> None:
    """Of variances what it adds grows with its square; the curve is the same."""
    s, found = np.linspace(0.0, BASE.length_m, 5), []
    for px in (0.0, 0.3, 0.6):
        found.append(refine_wires(photos, MOVED, replace(CONFIG, systematic_px=px)).wires)
    for none, some, more in zip(*found, strict=True):
        np.testing.assert_array_equal(some.theta, none.theta)
        added = [one.sigma_at(s) ** 2 - none.sigma_at(s) ** 2 for one in (some, more)]
        assert (added[0] > 0).all()
        np.testing.assert_allclose(added[1], 4 * added[0], rtol=1e-6)


@pytest.mark.slow
def test_what_one_image_shows_makes_a_wire_no_more_certain(tmp_path: Path) -> None:
    """All show the first half of each wire; beside its second half one shows something else."""
    cameras = two_passes(8)
    pictures = lit(cameras, *(wire.between(0.0, BASE.length_m / 2) for wire in WIRES))
    bare = refine_wires(photos_of(scene_of(tmp_path / "bare", cameras, pictures)), WIRES, CONFIG).wires
    beside = [replace(wire, theta=wire.theta + np.array([0, 0, 0, 3 * PIXEL, 0, 0])) for wire in WIRES]
    pictures[3] = lit(cameras[[3]], *beside)[0]
    found = refine_wires(photos_of(scene_of(tmp_path / "beside", cameras, pictures)), WIRES, CONFIG).wires
    end = np.array([BASE.length_m])
    for one, other in zip(found, bare, strict=True):
        assert not refused(one) and not refused(other)
        assert (one.sigma_at(end) > 0.9 * other.sigma_at(end)).all()
        assert (np.abs(one.at(end) - other.at(end)) < 3 * one.sigma_at(end)).all()


def test_what_stands_out_here_and_there_makes_a_wire_no_more_certain() -> None:
    """Four images measure it at ten places of every half metre; of its first half each shows one of these."""
    L, images = 10.0, 4
    every = np.tile(np.arange(0.025, L, 0.05), images)
    image = np.repeat(np.arange(images), len(every) // images)
    stands_out = (every > L / 2) | (np.arange(len(every)) % 10 == image)
    pose = np.zeros((images, MOVES))
    state = State(np.zeros((1, 6)), pose, np.zeros((1, CONFIG.adjust.views)), np.zeros((1, 2)), np.zeros(2))
    nothing = np.zeros((0, 0))
    s = every[stands_out]
    step = Step(state, nothing, nothing, np.zeros((1, 6, 6)), (0 * s,), (s,), (image[stands_out],), 1.0)
    assert stretches_seen(step, 0, L, CONFIG) == ((0.0, L),)
    ((low, high),) = stretches_seen(step, 0, L, CONFIG, every)
    assert L / 2 - 1 <= low <= L / 2 and high == L
    assert stretches_seen(step, 0, L, CONFIG, every[every > L / 2]) == ((0.0, L),)


def test_one_that_goes_too_far_stays(photos: Photos) -> None:
    evidence = replace(MOVED[1].evidence, reach_m=0.4 * PIXEL)
    sure = replace(MOVED[1], evidence=evidence, covariance=MOVED[1].covariance / 16)
    found = refine_wires(photos, [MOVED[0], sure, MOVED[2]], CONFIG).wires
    assert "times as far as its detection may be off" in refused(found[1])
    np.testing.assert_allclose(found[1].theta, sure.theta, atol=1e-12)
    assert not refused(found[0])
    # Images show it elsewhere, and which is right is not known: what it states holds both.
    s = np.linspace(0.0, BASE.length_m, 60)
    away = float(np.linalg.norm(sure.at(s) - WIRES[1].at(s), axis=1).max())
    assert away / 2 > sure.worst_sigma()
    assert np.sqrt(np.diag(found[1].covariance)[:5]) == pytest.approx(away / 2, rel=0.1)


def test_no_wire_is_refined_where_none_is_seen(photos: Photos) -> None:
    empty = hung(0.14, -0.1, 0.02)
    (found,) = refine_wires(photos, [empty], CONFIG).wires
    assert refused(found) and np.allclose(found.theta, empty.theta, atol=1e-12)


@pytest.mark.slow
def test_what_stands_out_nowhere_is_told_from_what_is_not_refitted(photos: Photos) -> None:
    sure = replace(MOVED[1], evidence=replace(MOVED[1].evidence, reach_m=0.4 * PIXEL))
    config = replace(CONFIG, piece_m=0.05)
    found = refine_wires(photos, [MOVED[0], sure, hung(0.14, -0.1, 0.02)], config)
    assert [bool(refused(wire)) for wire in found.wires] == [False, True, True]
    assert found.shown == (True, True, False)


def test_what_no_image_shows_comes_to_what_was_known_before() -> None:
    random = np.random.default_rng(0)
    known = np.array([wire.theta for wire in WIRES])
    config = AdjustConfig()
    moved = random.normal(size=(3, 6)) * [*[PIXEL] * 5, 0.1]
    shapes = ((4, MOVES), (3, config.views), (3, 2), 2)
    state = State(known + moved, *(random.normal(size=shape) for shape in shapes), 0.1)
    nothing = ProfileMeasurements.none()
    prior = Prior(known, np.array([4 * PIXEL] * 3), PosePrior(np.full(MOVES, 0.1)))
    for _ in range(3):  # a curve does not depend linearly on its swing
        step = adjust(BASE, state, prior, [[nothing] * 3] * 4, config)
        state = step.state
    np.testing.assert_allclose(step.state.theta, known, atol=1e-3 * PIXEL)
    for name in ("pose", "bias", "shading", "common_shading"):
        np.testing.assert_allclose(getattr(step.state, name), 0, atol=1e-9)
    assert abs(step.state.common_swing) < 1e-4
    # Of the swing nothing is known but what wind there may be.
    swing = np.degrees(np.sqrt([step.of_wire(w)[5, 5] for w in range(3)]))
    assert swing == pytest.approx(np.hypot(config.swing_deg, config.own_swing_deg), rel=0.2)
    # Nor is there a spread among images that would say otherwise than what was known.
    np.testing.assert_allclose(step.spread, step.covariance, rtol=1e-6, atol=1e-9 * step.covariance.max())


def test_a_track_along_the_wires_fixes_none(tmp_path: Path) -> None:
    x = np.linspace(-0.75, 0.75, 12)
    centres = np.stack([x, 0 * x - 0.45, 0 * x + 0.05], 1)
    cameras = pinhole_cameras(centres, centres + np.array([0.0, 1.0, -0.1]))
    straight = hung(0.05, 0.05, 0.001)
    straight = replace(straight, evidence=replace(straight.evidence, reach_m=0.05))
    (found,) = refine_wires(
        photos_of(scene_of(tmp_path, cameras, lit(cameras, straight))), [straight], CONFIG
    ).wires
    assert "do not fix it" in refused(found)


def test_wires_of_unequal_extents_are_refitted_on_one_base(photos: Photos) -> None:
    cut = [wire.between(0.2, 1.7) for wire in MOVED[:2]]
    found = refine_wires(photos, [*cut, MOVED[2]], CONFIG)
    for one, wire in zip(found.wires, WIRES, strict=True):
        assert one.base.length_m == pytest.approx(BASE.length_m) and not refused(one)
        assert np.abs(off(one, wire)).max() < 0.5


def test_a_cut_wire_is_as_certain_as_the_whole() -> None:
    """By draws from the covariance."""
    random = np.random.default_rng(1)
    half = random.normal(size=(5, 5)) * 1e-3
    covariance = np.pad(half @ half.T, (0, 1))
    wire = replace(WIRES[2], covariance=covariance).between(0.4, 1.6)
    draws = random.multivariate_normal(WIRES[2].theta, covariance, 4000)
    s = np.array([0.4, 1.0, 1.6])
    spread = np.std([curve_at(one, BASE.length_m, s) for one in draws], axis=0)
    np.testing.assert_allclose(wire.sigma_at(s - 0.4), spread, rtol=0.06)


def test_a_moved_wire_is_measured_by_the_profile() -> None:
    """-B / A is where the wire is, wherever it is measured within a pixel: the mean of all views."""
    cameras = two_passes(8)
    s = np.linspace(0, BASE.length_m, 200)
    lines = [polyline(wire) for wire in WIRES]
    pictures = draw_lit(cameras, lines, CONFIG.diameter_m, np.zeros(3))
    for away in (-0.8, 0.0, 0.8):
        off_px = []
        for n in range(len(cameras)):
            camera = doubled(cameras[[n]])
            grey = cv2.cvtColor(pictures[n], cv2.COLOR_RGB2GRAY).astype(np.float32)
            theta = WIRES[0].theta + np.array([away, away, 0, 0, 0, 0]) * PIXEL
            moved, *others = (
                project_wire(camera, places_along(BASE, one, s), STILL, 1.0, END_ON)
                for one in (theta, *(wire.theta for wire in WIRES[1:]))
            )
            one = measure_profiles(grey, None, moved, others, 0.6, CONFIG.diameter_m, ProfileConfig())
            clear = np.abs(one.A) > 5 * np.sqrt(one.variance_A)
            if clear.sum() > 30:
                expected = -away * PIXEL * one.by_yz[clear, 0]
                off_px.append(np.median((-one.B / one.A)[clear] - expected))
        assert len(off_px) >= 8 and np.mean(off_px) == pytest.approx(0, abs=0.05)


def doubled(cameras: Cameras) -> Cameras:
    """In float64."""
    values = vars(cameras).values()
    return Cameras(*(value.double() if value.is_floating_point() else value for value in values))


@pytest.mark.slow
@pytest.mark.parametrize("width_px", [4.0, 8.0])
def test_a_wide_wire_comes_to_where_it_is_drawn(tmp_path: Path, width_px: float) -> None:
    """Lit from above, and thicker or thinner than is thought: the edges tell its place and its width."""
    cameras = two_passes(8)
    light = np.array([0.0, 0.9, 1.2])
    diameter = width_px * PIXEL
    drawn = draw_lit(cameras, [polyline(WIRES[0])], diameter, light)
    photos = photos_of(scene_of(tmp_path, cameras, drawn))
    for share in (0.6, 1.6):
        config = replace(CONFIG, diameter_m=share * diameter)
        (one,) = refine_wires(photos, MOVED[:1], config).wires
        assert not refused(one)
        s = np.linspace(0.05, 0.95, 60) * BASE.length_m
        apart = off(one, WIRES[0])
        assert np.sqrt((apart**2).mean()) < 0.25
        assert (np.abs(apart) < 4 * one.sigma_at(s) / PIXEL).all()


@pytest.mark.parametrize("seed", [0, 1])
def test_a_wire_whose_sunlit_half_is_as_bright_as_the_ground_is_not_left(tmp_path: Path, seed: int) -> None:
    """Half as thick as is thought: only its dark half shows, beside which a wider bar would settle."""
    cameras, diameter = two_passes(8), 2.5 * PIXEL
    random = np.random.default_rng(seed)

    def ground(shape: tuple[int, ...]) -> np.ndarray:
        texture = cv2.GaussianBlur(random.normal(0, 1, shape), (0, 0), 2.0)
        return 115 + 12 * texture / texture.std()

    light = np.array([0.0, 0.8, 0.6])
    drawn = draw_lit(cameras, [polyline(WIRES[0])], diameter, light, seed, ground, grey=(92, 28))
    config = replace(CONFIG, diameter_m=1.85 * diameter)
    (one,) = refine_wires(photos_of(scene_of(tmp_path, cameras, drawn)), MOVED[:1], config).wires
    assert not refused(one)
    assert np.sqrt((off(one, WIRES[0]) ** 2).mean()) < 0.25  # of a bar as wide as is thought at first: 2


def test_diameters_are_learnt_where_wires_are_wider_than_their_blur() -> None:
    """One wire of eight pixels, one of four: the same camera shows both."""
    s = np.linspace(0, BASE.length_m, 200)
    camera = doubled(two_passes(8)[[3]])
    true = np.array([8.0, 4.0]) * PIXEL
    seen, grey = [], []
    for wire, diameter in zip(WIRES[:2], true.tolist(), strict=True):
        picture = draw_lit(two_passes(8)[[3]], [polyline(wire)], diameter, np.zeros(3))[0]
        seen.append(project_wire(camera, places_along(BASE, wire.theta, s), STILL, 1.0, END_ON))
        grey.append(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY).astype(np.float32))
    config = replace(CONFIG, diameter_m=5.5 * PIXEL)
    learnt, blur_px = (config.diameter_m, config.diameter_m), config.blur_px
    for _ in range(8):
        rows = [
            measure_profiles(picture, None, one, [], blur_px, diameter, config.profile)
            for picture, one, diameter in zip(grey, seen, learnt, strict=True)
        ]
        learnt, blur_px = likelier_widths(learnt, blur_px, [rows], config)
    assert np.log(learnt / true) == pytest.approx(0, abs=0.1)
    assert 0.4 <= blur_px < 0.8
    nothing = likelier_widths((PIXEL, PIXEL), 0.9, [[ProfileMeasurements.none()] * 2], config)
    assert nothing[0] != (PIXEL, PIXEL)  # drawn towards what is usual
    for _ in range(5):
        nothing = likelier_widths(*nothing, [[ProfileMeasurements.none()] * 2], config)
    assert nothing[0] == pytest.approx((config.diameter_m,) * 2)
    assert nothing[1] == pytest.approx(config.blur_px)


def test_crossings_are_where_the_lines_meet() -> None:
    s = np.linspace(0, 1, 41)
    along = np.stack([10 + 80 * s, np.full(41, 50.0)], 1)
    other = np.stack([10 + 80 * s, 50 + 8 * (s - 0.5)], 1)
    lines = [_flat(along), _flat(other)]
    far = _flat(along + np.array([0, 60.0]))
    apart = crossings(lines[0], [lines[1], far], 3.0, 2, CROSSING)
    # Normals point to positive y for a line to the right.
    expected = other[:, 1] - 50
    near = np.abs(expected) < 2.8
    np.testing.assert_allclose(apart[near, 0], expected[near], atol=1e-6)
    assert np.isnan(apart[np.abs(expected) > 3.2]).all() and np.isnan(apart[:, 1]).all()
    across = np.stack([np.full(41, 50.2), 10 + 80 * s], 1)
    assert crossings(lines[0], [_flat(across)], 3.0, 1, CROSSING)[20, 0] == 0.0


def _flat(pixel: np.ndarray) -> Projection:
    tangent = np.gradient(pixel, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], 1)
    s, yes, still = np.linspace(0, 1, len(pixel)), np.ones(len(pixel), bool), np.zeros((len(pixel), MOVES))
    return Projection(s, pixel, tangent, normal, normal, still, yes, yes)
