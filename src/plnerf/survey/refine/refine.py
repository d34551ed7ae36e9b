"""Wires detected in images, refitted to them: to a tenth of a pixel rather than one.

Each round projects the wires into every training image, reads what the grey values across them say
(`profiles.py`), and adjusts all wires, the images' pose residuals and the lighting together (`adjust.py`).
How large the residuals are is learnt: none of exact poses, tenths of a pixel of poses by structure from
motion.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float

from plnerf.line.base import Base
from plnerf.line.curve import LEAST_BEND_M
from plnerf.line.wire import Wire
from plnerf.scene.cameras import Cameras
from plnerf.survey.posed_photos import Photos
from plnerf.survey.refine.adjust import adjust
from plnerf.survey.refine.beside import stands_out
from plnerf.survey.refine.config import AdjustConfig, RefineConfig
from plnerf.survey.refine.diameter import likelier_widths
from plnerf.survey.refine.judge import believed, between, on_stretches, stretches_seen
from plnerf.survey.refine.pose_prior import prior_of
from plnerf.survey.refine.profiles import ProfileMeasurements, grey_picture, measure_profiles
from plnerf.survey.refine.projection import MOVES, Places, Projection, places_along, project_wire
from plnerf.survey.refine.twins import twins_of
from plnerf.survey.refine.unknowns import SWING, Light, Prior, State

Widths = tuple[tuple[float, ...], float]
"""The diameters of wires, metres, and the blur of the images, pixels."""


@dataclass(frozen=True, eq=False)
class Refinement:
    """Of all wires."""

    wires: tuple[Wire, ...]
    """Refitted, on one common base, in the order they came; one that was refused is as it came, with the
    reason in its notes."""
    pose_residual_px: float
    """Standard deviation of what the images' poses are off by, as their wires show it."""
    shown: tuple[bool, ...]
    """Of each wire whether it stands out in the images more often than noise, or enough of them show a piece
    of it, a good piece where what is beside it stands out as often, and then only if it was detected sharply;
    true where nothing can be measured."""
    counts: tuple[int, ...] = ()
    """At how many places, of all images, each wire stands out near to its curve."""
    widths: Widths | None = None
    """As they were learnt on the way."""
    distinct: tuple[bool, ...] = ()
    """Of each wire whether it stands out more often than what is beside it."""
    light: Light | None = None
    """In which they are found to stand."""
    given_light: Light | None = None
    """What was known of it before."""


def refine_wires(
    photos: Photos,
    wires: Sequence[Wire],
    config: RefineConfig,
    progress: Callable[[int, int], None] | None = None,
    widths: Widths | None = None,
    light: Light | None = None,
) -> Refinement:
    """Refits wires that run side by side to the training images.

    widths: those to begin with, where they are known better than by assumption.  light: what is known of it
    from other wires.

    What a wire may be off by before is its `evidence.reach_m`; one that moves more than `most_moved` times as
    far is refused.
    """
    if not wires:
        return Refinement((), 0.0, ())
    base = common_base(wires)
    started = [wire.on(base) for wire in wires]
    before, s = np.array([wire.theta for wire in started]), np.linspace(0, base.length_m, config.samples)
    views, N, W = list(photos.train), len(photos.train), len(wires)
    cameras = [photos.cameras[[i]] for i in views]
    v = config.adjust.views
    lit = np.zeros(2) if light is None else light.shading
    state = State(before, np.zeros((N, MOVES)), np.zeros((W, v)), np.tile(lit, (W, 1)), lit)
    trust = np.array([wire.evidence.reach_m for wire in wires], np.float64)
    metres = photos.frame.unit == "m"
    at = np.array([wire.at(s) for wire in started])
    twins = twins_of(wires, base, at, config.twin_m) if metres else ()
    usual_m = _usual_distance(photos, started, s)
    prior = Prior(before, trust, prior_of(photos, usual_m, config.pose_sd_px), twins, light)
    diameters, blur_px = widths or (_first_diameters(cameras, base, before, s, config), config.blur_px)
    first_blur_px = blur_px if widths else config.first_blur_px
    found: list[list[ProfileMeasurements]] = []
    report = progress or (lambda done, of: None)

    def project(n: int, state: State, places: list[Places]) -> list[Projection]:
        end_on = config.profile.end_on
        return [project_wire(cameras[n], one, state.pose[n], usual_m, end_on) for one in places]

    def measure(
        state: State, places: list[Places], blur: float, across: tuple[float, ...], n: int
    ) -> list[ProfileMeasurements]:
        return _of_image(photos, views[n], project(n, state, places), blur, across, config)

    for k in range(config.most_rounds):
        blur = blur_px if k else first_blur_px
        places = [places_along(base, one, s) for one in state.theta]
        with ThreadPoolExecutor() as pool:
            found = list(pool.map(partial(measure, state, places, blur, diameters), range(N)))
        step = adjust(base, state, prior, found, config.adjust)
        if k:
            diameters, blur_px = likelier_widths(diameters, blur_px, found, config)
        last, state = state, _hanging(step.state, config.adjust)
        poses = prior.poses.learnt(step.state.pose, step.of_poses(), config.least_pose_sd_px)
        prior = replace(prior, poses=poses)
        report(k + 1, config.most_rounds)
        moved = max(between(base, *both, s) for both in zip(last.theta, state.theta, strict=True))
        if k + 1 >= config.least_rounds and moved * step.pixels_per_m < config.settled_px:
            break
    report(config.most_rounds, config.most_rounds)
    step = replace(step, state=state)
    seen = [stretches_seen(step, w, base.length_m, config) for w in range(W)]
    measured = [np.concatenate([row[w].s for row in found]) for w in range(W)]
    certain = [stretches_seen(step, w, base.length_m, config, measured[w]) for w in range(W)]
    sure = adjust(base, state, prior, on_stretches(certain, found), config.adjust)
    few = [places_along(base, one, s[:: config.beside_every]) for one in state.theta]
    more = stands_out(photos, lambda n: project(n, state, few), diameters, blur_px, config)
    judged = [
        believed(wire, prior, (step, sure), w, found, seen[w], float(more[w]), config)
        for w, wire in enumerate(started)
    ]
    shown, distinct = [], []
    for w in range(W):
        count = sum(len(row[w]) for row in found)
        often = len(step.off_px[w]) >= config.least_visible * count
        # How thick a curve is that does not stand out is nothing that was measured.
        thick = metres and diameters[w] > config.thick_m and more[w] >= config.least_beside
        distinct.append(bool(more[w] >= (config.least_beside_thick if thick else config.least_beside)))
        sharp = not thick and trust[w] <= config.doubtful_diameters * config.diameter_m
        long = sum(high - low for low, high in seen[w]) >= config.least_seen * base.length_m
        shown.append(bool((often or seen[w]) and (distinct[w] or (sharp and long))))
    counts = tuple(int((np.abs(off) <= config.near_px).sum()) for off in step.off_px)
    widths = diameters, blur_px
    return Refinement(
        tuple(judged), step.pose_residual_px(), tuple(shown), counts, widths, tuple(distinct), step.light(),
        light,
    )  # fmt: skip


def common_base(wires: Sequence[Wire]) -> Base:
    """Along the first wire's base, over the extents of all."""
    first = wires[0].base
    ends = np.array([end for wire in wires for end in (wire.base.a, wire.base.b)])
    s = (ends - first.a) @ first.u
    return first.cut(float(s.min()), float(s.max()))


def _usual_distance(photos: Photos, wires: Sequence[Wire], s: Float[np.ndarray, " k"]) -> float:
    """Of the wires from the photos in which they are."""
    apart = np.concatenate([photos.distances(wire.points(s)).ravel() for wire in wires])
    seen = apart[np.isfinite(apart)]
    return float(np.median(seen)) if len(seen) else 1.0


def _first_diameters(
    cameras: Sequence[Cameras], base: Base, theta: Float[np.ndarray, "w 6"], s: Float[np.ndarray, " k"],
    config: RefineConfig,
) -> tuple[float, ...]:  # fmt: skip
    """The assumed diameter of wires that are wide by it in most images, and a share of it of others."""
    still, first = np.zeros(MOVES), []
    for one in theta:
        places = places_along(base, one, s)
        seen = [project_wire(camera, places, still, 1.0, config.profile.end_on) for camera in cameras]
        px_per_m = np.concatenate([np.linalg.norm(view.by_yz, axis=1)[view.good] for view in seen])
        wide = len(px_per_m) > 0 and config.diameter_m * float(np.median(px_per_m)) >= config.thin_px
        first.append(config.diameter_m * (1.0 if wide else config.thin_share))
    return tuple(first)


def _hanging(state: State, config: AdjustConfig) -> State:
    """With wires that sag, however little, and swing no further than wires do."""
    theta, most = state.theta.copy(), np.radians(config.max_swing_deg)
    theta[:, 4] = np.maximum(theta[:, 4], LEAST_BEND_M)
    theta[:, SWING] = np.clip(theta[:, SWING], -most, most)
    return replace(state, theta=theta)


def _of_image(
    photos: Photos, i: int, seen: list[Projection], blur_px: float, across: Sequence[float],
    config: RefineConfig,
) -> list[ProfileMeasurements]:  # fmt: skip
    """The measurements of each wire in one image."""
    grey, valid = grey_picture(photos, i)
    return [
        measure_profiles(grey, valid, mine, seen[:w] + seen[w + 1 :], blur_px, across[w], config.profile)
        for w, mine in enumerate(seen)
    ]
