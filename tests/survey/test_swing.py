"""Wires that wind swings aside are refitted where they hang, and say truly how far they swing."""

from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import pytest
from tests.support.drawn import FOCAL, HALF, pinhole_cameras, scene_of
from tests.support.lit_wires import draw_lit

from plnerf.line.base import Base
from plnerf.line.curve import LEAST_BEND_M, curve_at, curve_by_theta
from plnerf.line.ends import Evidence, Open
from plnerf.line.wire import Wire
from plnerf.scene.cameras import Cameras
from plnerf.survey.posed_photos import photos_of
from plnerf.survey.refine.adjust import Step, adjust
from plnerf.survey.refine.config import AdjustConfig, RefineConfig
from plnerf.survey.refine.pose_prior import PosePrior
from plnerf.survey.refine.profiles import ProfileMeasurements
from plnerf.survey.refine.projection import MOVES, places_along, project_wire
from plnerf.survey.refine.refine import refine_wires
from plnerf.survey.refine.twins import Twins
from plnerf.survey.refine.unknowns import SWING, Light, Prior, State

PIXEL = 0.45 / FOCAL
CONFIG = RefineConfig(diameter_m=2 * PIXEL)
OPEN = Open("drawn")
LEAST = np.array([*[-np.inf] * 4, LEAST_BEND_M, -np.inf])
"""No wire arches."""
NOISE_PX = 0.3
"""Standard deviation of one made-up measurement."""
SHIFT_PX = 0.15
"""What is seen from one direction over one stretch lies aside by so much, as one edge is the brighter."""


def turned(azimuth_deg: float) -> np.ndarray:
    """The rotation about z by an azimuth."""
    c, s = np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def passes(R: np.ndarray, count: int = 8, distance: float = 0.45) -> Cameras:
    """A pass to either side of a span along R's first column, weaving up and down."""
    x = np.linspace(-0.75, 0.75, count)
    weave = 0.1 * np.tile([-1.0, 1.0, 0.3], count)[:count]
    sides = [(-distance, 0.05 + weave), (distance, 0.2 - weave)]
    centres = np.concatenate([np.stack([x, 0 * x + y, z], 1) for y, z in sides])
    targets = np.stack([centres[:, 0], 0 * centres[:, 0], 0 * centres[:, 0]], 1)
    return pinhole_cameras(centres @ R.T, targets @ R.T)


def hung(base: Base, numbers: list[float], swing_deg: float, reach_px: float = 4.0) -> Wire:
    """y_A, y_B, z_A, z_B, b; known to within some pixels."""
    theta = np.array([*numbers, np.radians(swing_deg)])
    evidence = Evidence("a drawing", 1, reach_m=reach_px * PIXEL)
    return Wire(0, base, theta, np.diag([PIXEL**2] * 5 + [0.0]), (OPEN, OPEN), evidence)


@pytest.mark.parametrize("azimuth_deg", [0.0, 127.0])
def test_swung_wires_come_to_where_they_are_drawn(tmp_path: Path, azimuth_deg: float) -> None:
    """Detected upright, each on a base of its own, in any direction; shields swing further than phases."""
    R = turned(azimuth_deg)
    u, n = R[:2, 0], R[:2, 1]
    truth = []
    for y, z, sag, swing in ((-0.08, 0.05, 0.06, 12.0), (0.06, 0.02, 0.05, 11.0), (0.0, 0.12, 0.04, 20.0)):
        base = Base.along(y * n, u, -HALF, HALF)
        truth.append(hung(base, [0.0, 0.0, z, z + 0.01, sag], swing))
    cameras = passes(R)
    light = R @ [0.0, 0.6, 0.8]
    lines = [wire.points(np.linspace(0, 2 * HALF, 120)) for wire in truth]
    photos = photos_of(scene_of(tmp_path, cameras, draw_lit(cameras, lines, CONFIG.diameter_m, light)))
    started = []
    for wire in truth:
        bow = wire.theta[4] * np.sin(wire.theta[SWING])
        upright = wire.theta * [1, 1, 1, 1, np.cos(wire.theta[SWING]), 0]
        started.append(replace(wire, theta=upright + np.array([0.6, 0.6, 0, 0, 0, 0]) * bow))
    found = refine_wires(photos, started, CONFIG).wires
    for one, wire in zip(found, truth, strict=True):
        assert not any("not refitted" in text for text in one.notes)
        s = np.linspace(0.05, 0.95, 40) * one.base.length_m
        local = wire.base.local(one.points(s))
        off = (local[:, 1:] - wire.at(local[:, 0])) / PIXEL
        assert np.abs(off).max() < 0.5 and np.sqrt((off**2).mean()) < 0.25
        swing, true = one.swing_deg, np.degrees(wire.theta[SWING])
        assert swing is not None and swing.sigma < 6
        assert abs(swing.value - true) < 3 * swing.sigma and abs(swing.value - true) < 3


@pytest.mark.slow
def test_swings_and_places_hold_their_intervals_with_and_without_wind() -> None:
    """Profiles made up for wires of 40 m from 6 m to either side, with errors of poses, light and views."""
    random = np.random.default_rng(12)
    swings, places, calm = [], [], []
    for trial in range(6):
        wind = 0.0 if trial % 2 else float(random.uniform(-15, 15))
        for off, swing, at in _refitted(_trial(random, wind, (2.0, 2.0, 1.5))):
            swings.append(off / swing)
            places.append(at.ravel())
            calm.append(swing)
    z = np.concatenate(places)
    assert np.abs(swings).max() < 4 and np.mean(np.abs(swings) < 1.96) >= 0.85
    assert np.abs(z).max() < 4.5 and np.mean(np.abs(z) < 1.96) >= 0.9
    assert np.max(calm) < 2.5  # degrees: the images fix it


def test_a_taut_wire_keeps_to_calm_air_and_says_how_little_is_known() -> None:
    random = np.random.default_rng(13)
    for off, swing, at in _refitted(_trial(random, 0.0, (0.002, 0.004))):
        assert abs(off) < 5 and 5 < swing < 12.5
        assert np.abs(at).max() < 4.5


@dataclass(frozen=True)
class Trial:
    """Three wires or fewer, what films them, and what is wrong with that."""

    base: Base
    theta: np.ndarray
    cameras: Cameras
    pose: np.ndarray
    """Pose residuals of its images."""
    bias: np.ndarray
    """Displacements (px) of each wire seen from each direction over each stretch."""
    noise: np.ndarray
    """Of the measurements, by image, wire and place, in px."""

    def profile(self, state: State, k: int, w: int) -> ProfileMeasurements:
        """What the profiles of a wire in an image would say, where a state has it."""
        s = np.linspace(0, self.base.length_m, self.noise.shape[2])
        places = places_along(self.base, state.theta[w], s)
        seen = project_wire(self.cameras[[k]], places, state.pose[k], 6.0, 0.15)
        good, L, A = seen.good, self.base.length_m, 40.0
        by_yz, by_pose, config = seen.by_yz[good], seen.by_pose[good], AdjustConfig()
        off = curve_at(self.theta[w], L, s[good]) - curve_at(state.theta[w], L, s[good])
        turns = np.arctan2(by_yz[:, 1], by_yz[:, 0]) / (2 * np.pi) % 1.0
        direction = (turns * config.directions).astype(int)
        stretch = np.minimum((s[good] / L * config.stretches).astype(int), config.stretches - 1)
        e = (by_yz * off).sum(1) + by_pose @ (self.pose[k] - state.pose[k]) + self.noise[k, w, good]
        e += self.bias[w, np.minimum(direction, config.directions - 1), stretch]
        even = np.ones(good.sum())
        by_slope = -A * SHIFT_PX / config.uneven_grey * even
        return ProfileMeasurements(
            s[good], by_yz, by_pose, by_slope=by_slope, width_px=even, A=A * even, B=-A * e, wider=0 * even,
            wider_by_blur=0 * even, variance_A=4.0 * even, variance_B=(A * NOISE_PX) ** 2 * even,
            variance_wider=even,
        )  # fmt: skip


def _trial(random: np.random.Generator, wind_deg: float, sags: tuple[float, ...]) -> Trial:
    """Two passes of 12 images each; in a wind, wires swing by a degree more or less than it says."""
    L, N, W, config = 40.0, 24, len(sags), AdjustConfig()
    u, n = turned(200.0)[:2, 0], turned(200.0)[:2, 1]
    theta = np.zeros((W, 6))
    for w, (y, z, sag) in enumerate(zip((-1.5, 1.5, 0.0), (0.0, 0.2, 2.0), sags, strict=False)):
        swing = np.radians(wind_deg + random.normal()) if wind_deg else 0.0
        theta[w] = y, y + 0.1, 11.0 + z, 11.5 + z, sag, swing
    s = np.linspace(0, L, N // 2)
    weave = random.uniform(0.3, 1.2) * np.sin(s / 5 + random.uniform(0, 6))
    sides = [(s[:, None] * u + side * 6.0 * n, 12.0 + side + weave) for side in (-1, 1)]
    centres = np.concatenate([np.column_stack(one) for one in sides])
    targets = np.concatenate([np.column_stack([s[:, None] * u, np.full(N // 2, 11.0)])] * 2)
    views = vars(pinhole_cameras(centres, targets)).values()
    return Trial(
        Base(np.zeros(2), L * u),
        theta,
        Cameras(*(one.double() if one.is_floating_point() else one for one in views)),
        0.2 * random.normal(size=(N, MOVES)),
        SHIFT_PX * random.normal(size=(W, config.directions, config.stretches)),
        NOISE_PX * random.normal(size=(N, W, 40)),
    )


def _refitted(made: Trial) -> list[tuple[float, float, np.ndarray]]:
    """For each wire: error and deviation of its swing (degrees), and its places' errors in deviations."""
    L, (N, W), config = made.base.length_m, made.noise.shape[:2], AdjustConfig()
    started = made.theta.copy()
    started[:, SWING] = 0.0
    reach = 0.1 + np.abs(made.theta[:, 4] * np.sin(made.theta[:, SWING]))
    state = State(started, np.zeros((N, MOVES)), np.zeros((W, config.views)), np.zeros((W, 2)), np.zeros(2))
    prior = Prior(started, reach, PosePrior(np.full(MOVES, 0.2)))
    for _ in range(4):
        found = [[made.profile(state, k, w) for w in range(W)] for k in range(N)]
        step = adjust(made.base, state, prior, found, config)
        state = replace(step.state, theta=np.maximum(step.state.theta, LEAST))
    s, results = np.linspace(0, L, 9), []
    for w, true in enumerate(made.theta):
        own, theta = step.of_wire(w), state.theta[w]
        J = curve_by_theta(theta, L, s)
        off = (curve_at(theta, L, s) - curve_at(true, L, s)) / np.sqrt(np.einsum("mij,jl,mil->mi", J, own, J))
        swing = np.degrees([theta[SWING] - true[SWING], np.sqrt(own[SWING, SWING])])
        results.append((float(swing[0]), float(swing[1]), off))
    return results


def test_a_step_ends_where_its_sum_of_squares_is_least() -> None:
    """With all unknowns, also those that the equations eliminate: any change makes the sum larger."""
    random, config = np.random.default_rng(14), AdjustConfig(robust=1e6)
    made = _trial(random, 5.0, (2.0, 1.0))
    base, (N, W) = made.base, made.noise.shape[:2]
    state = State(
        made.theta + 0.02 * random.normal(size=(W, 6)), 0.1 * random.normal(size=(N, MOVES)),
        random.normal(size=(W, config.views)), random.normal(size=(W, 2)), random.normal(size=2), 0.03,
    )  # fmt: skip
    root = 0.1 * random.normal(size=(MOVES * N, MOVES * N))
    poses = PosePrior(np.full(MOVES, 0.2), root @ root.T)
    light = Light(np.array([5.0, 40.0]), np.array([7.0, 9.0]))
    prior = Prior(made.theta, np.full(W, 0.1), poses, (Twins(0, 1, 1.0, 9.0),), light)
    found = [[made.profile(state, k, w) for w in range(W)] for k in range(N)]
    after = adjust(base, state, prior, found, config).state
    least = _sum_of_squares(base, state, after, prior, found, config)
    for part in fields(State):
        value = getattr(after, part.name)
        for _ in range(5):
            change = 1e-3 * random.normal(size=np.shape(value))
            sides = [replace(after, **{part.name: moved}) for moved in (value + change, value - change)]
            more, less = (_sum_of_squares(base, state, one, prior, found, config) - least for one in sides)
            assert more > 0 and more == pytest.approx(less, rel=1e-3), part.name


def test_a_step_states_what_displaced_views_make_of_wires() -> None:
    """Each view of each stretch displaced by itself, one after the other."""
    config, by_px = AdjustConfig(), 1e-4
    made = _trial(np.random.default_rng(15), 5.0, (2.0, 1.0))
    # Nothing else is wrong, so that no weight changes.
    made = replace(made, pose=0 * made.pose, bias=0 * made.bias, noise=0 * made.noise)
    (N, W), V = made.noise.shape[:2], (config.directions, config.stretches)
    nothing = np.zeros((N, MOVES)), np.zeros((W, config.views)), np.zeros((W, 2)), np.zeros(2)
    state = State(made.theta, *nothing)
    prior = Prior(made.theta, np.full(W, 0.1), PosePrior(np.full(MOVES, 0.2)))

    def stepped(trial: Trial) -> Step:
        found = [[trial.profile(state, k, w) for w in range(W)] for k in range(N)]
        return adjust(made.base, state, prior, found, config)

    before, summed = stepped(made), np.zeros((W, 6, 6))
    for view in np.ndindex(W, *V):
        bias = made.bias.copy()
        bias[view] += by_px
        moved = (stepped(replace(made, bias=bias)).state.theta - before.state.theta) / by_px
        summed += moved[:, :, None] * moved[:, None]
    assert (np.abs(summed) > 0).all()
    np.testing.assert_allclose(before.displaced, summed, rtol=0.01)


def _sum_of_squares(
    base: Base, before: State, after: State, prior: Prior, found: list[list[ProfileMeasurements]],
    config: AdjustConfig,
) -> float:
    """What a step from one state minimises, at another: with measurements linear about the first."""
    W, L = len(before.theta), base.length_m
    moved, turned_by = after.theta - before.theta, after.pose - before.pose
    held = np.linspace(0, L, config.prior_places)
    pose = after.pose.ravel()
    total = pose @ prior.poses.precision(len(after.pose)) @ pose
    total += (after.bias**2).sum() / config.uneven_grey**2
    assert prior.light is not None
    total += (((after.common_shading - prior.light.shading) / prior.light.sigma) ** 2).sum()
    own = (after.shading - after.common_shading) / (config.own_shading * config.shading_grey)
    swings = np.degrees([*after.theta[:, SWING] - after.common_swing, after.common_swing])
    total += (own**2).sum() + ((swings / [*[config.own_swing_deg] * W, config.swing_deg]) ** 2).sum()
    for pair in prior.twins:
        beside = np.linspace(pair.from_m, pair.to_m, config.prior_places)
        between = np.zeros((config.prior_places, 2))
        for sign, k in ((1, pair.one), (-1, pair.other)):
            between += sign * curve_at(before.theta[k], L, beside)
            between += sign * curve_by_theta(before.theta[k], L, beside) @ moved[k]
        total += ((between - between.mean(0)) ** 2).sum() / config.prior_places / config.twins_m**2
    for w in range(W):
        pulled = curve_at(before.theta[w], L, held) - curve_at(prior.theta[w], L, held)
        pulled += curve_by_theta(before.theta[w], L, held) @ moved[w]
        total += (pulled**2).sum() / config.prior_places / prior.trust_m[w] ** 2
        lit, misfit = [], []
        for n, row in enumerate(found):
            one = row[w]
            turns = np.arctan2(one.by_yz[:, 1], one.by_yz[:, 0]) / (2 * np.pi) % 1.0
            stretch = np.minimum((one.s / L * config.stretches).astype(int), config.stretches - 1)
            views = (turns * config.directions).astype(int) * config.stretches + stretch
            towards = one.by_yz / np.linalg.norm(one.by_yz, axis=1, keepdims=True)
            by = np.einsum("ki,kij->kj", one.by_yz, curve_by_theta(before.theta[w], L, one.s))
            at = one.A * (by @ moved[w] + one.by_pose @ turned_by[n]) + one.B
            for state, which in ((before, lit), (after, misfit)):
                bright = one.by_slope * (state.bias[w, views] + towards @ state.shading[w])
                which.append((bright - (one.B if state is before else at)) / np.sqrt(one.variance_B))
        scale = max(1.4826 * float(np.median(np.abs(np.concatenate(lit)))), 0.3)
        total += (np.concatenate(misfit) ** 2).sum() / scale**2
    return float(total)
