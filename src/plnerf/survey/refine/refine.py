"""Wires detected in images, refitted to them: to a tenth of a pixel rather than one.

Each round projects the wires into every training image, reads what the grey values across them say
(`profiles.py`), and adjusts all wires, the images' pose residuals and the lighting together (`adjust.py`).
How large the residuals are is learnt: none of exact poses, tenths of a pixel of poses by structure from
motion.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from plnerf.line.base import Base
from plnerf.line.curve import LEAST_BEND_M, curve_at, curve_by_theta
from plnerf.line.wire import Wire
from plnerf.scene.cameras import Cameras
from plnerf.survey.posed_photos import Photos
from plnerf.survey.refine.adjust import SWING, Prior, State, Step, adjust
from plnerf.survey.refine.beside import stands_out
from plnerf.survey.refine.config import AdjustConfig, RefineConfig
from plnerf.survey.refine.diameter import likelier_widths
from plnerf.survey.refine.profiles import ProfileMeasurements, grey_picture, measure_profiles
from plnerf.survey.refine.projection import MOVES, Projection, project_wire

Stretches = tuple[tuple[float, float], ...]
"""From where to where along a wire, metres."""
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
    of it, a good piece where what is beside it stands out as often; true where nothing can be measured."""
    counts: tuple[int, ...] = ()
    """At how many places, of all images, each wire stands out near to its curve."""
    widths: Widths | None = None
    """As they were learnt on the way."""


def refine_wires(
    photos: Photos,
    wires: Sequence[Wire],
    config: RefineConfig,
    progress: Callable[[int, int], None] | None = None,
    widths: Widths | None = None,
) -> Refinement:
    """Refits wires that run side by side to the training images.

    widths: those to begin with, where they are known better than by assumption.

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
    state = State(before, np.zeros((N, MOVES)), np.zeros((W, v)), np.zeros((W, 2)), np.zeros(2))
    trust = np.array([wire.evidence.reach_m for wire in wires], np.float64)
    prior = Prior(before, trust, np.full(MOVES, config.pose_sd_px))
    usual_m = _usual_distance(photos, started, s)
    diameters, blur_px = widths or (_first_diameters(cameras, base, before, s, config), config.blur_px)
    first_blur_px = blur_px if widths else config.first_blur_px
    found: list[list[ProfileMeasurements]] = []
    report = progress or (lambda done, of: None)

    def project(n: int, state: State, s: Float[np.ndarray, " k"]) -> list[Projection]:
        end_on = config.profile.end_on
        return [project_wire(cameras[n], base, one, s, state.pose[n], usual_m, end_on) for one in state.theta]

    for k in range(config.most_rounds):
        blur = blur_px if k else first_blur_px

        def measure(
            n: int, state: State = state, blur: float = blur, across: tuple[float, ...] = diameters
        ) -> list[ProfileMeasurements]:
            return _of_image(photos, views[n], project(n, state, s), blur, across, config)

        with ThreadPoolExecutor() as pool:
            found = list(pool.map(measure, range(N)))
        step = adjust(base, state, prior, found, config.adjust)
        if k:
            diameters, blur_px = likelier_widths(diameters, blur_px, found, config)
        last, state = state, _hanging(step.state, config.adjust)
        prior = replace(prior, pose_sd_px=np.maximum(step.pose_sd_px(), config.least_pose_sd_px))
        report(k + 1, config.most_rounds)
        moved = max(_between(base, *both, s) for both in zip(last.theta, state.theta, strict=True))
        if k + 1 >= config.least_rounds and moved * step.pixels_per_m < config.settled_px:
            break
    report(config.most_rounds, config.most_rounds)
    step = replace(step, state=state)
    seen = [_seen(step, w, base.length_m, config) for w in range(W)]
    sure = adjust(base, state, prior, _on(seen, found), config.adjust)
    few = s[:: config.beside_every]
    more = stands_out(photos, lambda n: project(n, state, few), diameters, blur_px, config)
    judged = [
        _judged(wire, prior, (step, sure), w, found, seen[w], float(more[w]), config)
        for w, wire in enumerate(started)
    ]
    shown = []
    for w in range(W):
        count = sum(len(row[w]) for row in found)
        often = len(step.off_px[w]) >= config.least_visible * count
        told = more[w] >= config.least_beside
        long = sum(high - low for low, high in seen[w]) >= config.least_seen * base.length_m
        shown.append((often or bool(seen[w])) and bool(told or long))
    counts = tuple(int((np.abs(off) <= config.near_px).sum()) for off in step.off_px)
    return Refinement(tuple(judged), _pose_residual_px(step), tuple(shown), counts, (diameters, blur_px))


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


def _pose_residual_px(step: Step) -> float:
    """Of a wire at the usual distance."""
    turned, *_, moved = step.pose_sd_px()
    return float(np.hypot(turned, moved))


def _first_diameters(
    cameras: Sequence[Cameras], base: Base, theta: Float[np.ndarray, "w 6"], s: Float[np.ndarray, " k"],
    config: RefineConfig,
) -> tuple[float, ...]:  # fmt: skip
    """The assumed diameter of wires that are wide by it in most images, and a share of it of others."""
    still, first = np.zeros(MOVES), []
    for one in theta:
        seen = [project_wire(camera, base, one, s, still, 1.0, config.profile.end_on) for camera in cameras]
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


def _between(
    base: Base, one: Float[np.ndarray, "6"], other: Float[np.ndarray, "6"], s: Float[np.ndarray, " k"]
) -> float:
    """Greatest distance between two curves."""
    apart = curve_at(one, base.length_m, s) - curve_at(other, base.length_m, s)
    return float(np.linalg.norm(apart, axis=1).max())


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


def _judged(
    wire: Wire,
    prior: Prior,
    steps: tuple[Step, Step],
    w: int,
    found: Sequence[Sequence[ProfileMeasurements]],
    seen: Stretches,
    more: float,
    config: RefineConfig,
) -> Wire:
    """The refitted wire if it is to be believed, else the wire as it was and why.

    steps: by all measurements, and by those on what enough images show; what lies beside a wire that is
    hardly seen pulls at the others, which help to find it and do not make it certain.  more: how many times
    as often the wire stands out as what is beside it.
    """
    step, sure = steps
    rows = [row[w] for row in found]
    views, count = sum(len(row) > 0 for row in rows), sum(len(row) for row in rows)
    off, theta = step.off_px[w], step.state.theta[w]
    trust, base = prior.trust_m[w], wire.base
    s = np.linspace(0, base.length_m, config.samples)
    moved, own = _between(base, prior.theta[w], theta, s), step.of_wire(w)
    J = curve_by_theta(theta, base.length_m, s)
    sigma = float(np.sqrt(np.linalg.eigvalsh(J @ own @ J.transpose(0, 2, 1))[:, -1].min()))
    near = float((np.abs(off) <= config.near_px).mean()) if len(off) else 0.0
    refused = None
    if views < config.least_views or not len(off):
        refused = f"{views} images show it"
    elif sigma > config.no_news * trust:
        refused = "the views do not fix it better than its detection did"
    elif len(off) < config.least_visible * count:
        refused = f"it stands out at {len(off) / count:.1%} of the places where it was measured"
    elif near < config.least_near:
        refused = f"{near:.0%} of its measurements lie within a pixel of it"
    elif more < config.least_beside:
        refused = f"it stands out {more:.1f} times as often as what is beside it"
    elif moved > config.most_moved * trust:
        refused = f"it moved {moved / trust:.1f} times as far as its detection may be off"
    evidence = replace(wire.evidence, source=f"{views} images", count=views, seen_m=seen)
    if refused is not None:
        # A detection states its least certain point: that stands for all of them, and for the bow.  Of one
        # that full-size images do not show, it is all that it may be off by.
        sigma = max(wire.worst_sigma(), trust if more < config.least_beside else 0.0)
        swing = min(np.radians(config.adjust.swing_deg), sigma / max(float(wire.theta[4]), LEAST_BEND_M))
        held = np.diag([sigma**2] * 5 + [max(swing**2, float(wire.covariance[SWING, SWING]))])
        notes = (*wire.notes, f"It is not refitted to the images: {refused}.")
        return replace(wire, covariance=held, evidence=evidence, notes=notes)
    off_px = float(np.hypot(config.systematic_px, config.undescribed * _pose_residual_px(step)))
    common = off_px / step.pixels_per_m
    by_yz = np.concatenate([row.by_yz for row in rows])
    systematic = _systematic(theta, common, config.systematic_bow * off_px, by_yz, config.adjust)
    covariance = sure.of_wire(w) + systematic
    return replace(wire, theta=theta, covariance=covariance, evidence=evidence)


def _systematic(
    theta: Float[np.ndarray, "6"], common_m: float, bow_px: float, by_yz: Float[np.ndarray, "k 2"],
    config: AdjustConfig,
) -> Float[np.ndarray, "6 6"]:  # fmt: skip
    """Covariance of what displaces all of a wire alike, and of what displaces its middle against its ends.

    The latter is so many pixels in every view: in metres it is most in the direction that views show least.
    """
    alike = np.kron(np.eye(2), np.ones((2, 2)))  # y_A with y_B, z_A with z_B
    views = by_yz.T @ by_yz / len(by_yz)
    of_bow = bow_px**2 / 2 * np.linalg.pinv(views, hermitian=True)
    bend, swing = float(theta[4]), float(theta[SWING])
    # A wire too taut to show its swing swings no further for it than wind does.
    arm = max(bend, float(np.sqrt(of_bow[0, 0])) / np.radians(config.swing_deg))
    s, c = np.sin(swing), np.cos(swing)
    by_bow = np.array([[s, c], [c / arm, -s / arm]])  # b and swing, by y and z of the middle
    systematic = np.zeros((6, 6))
    systematic[:4, :4], systematic[4:, 4:] = alike * common_m**2, by_bow @ of_bow @ by_bow.T
    return systematic


def _on(
    seen: Sequence[Stretches], found: Sequence[Sequence[ProfileMeasurements]]
) -> list[list[ProfileMeasurements]]:
    """Of every image, the measurements of each wire on the stretches that are seen of it."""

    def within(s: Float[np.ndarray, " k"], some: Stretches) -> Bool[np.ndarray, " k"]:
        inside = np.zeros(len(s), np.bool_)
        for low, high in some:
            inside |= (s >= low) & (s <= high)
        return inside

    return [
        [one.only(within(one.s, some)) for one, some in zip(row, seen, strict=True)] for row in found
    ]


def _seen(step: Step, w: int, length_m: float, config: RefineConfig) -> Stretches:
    """Stretches of a wire on which enough images show it near to its curve."""
    count = max(1, round(length_m / config.piece_m))
    near = np.abs(step.off_px[w]) <= config.near_px
    piece = np.clip((step.s[w][near] / length_m * count).astype(int), 0, count - 1)
    shown = np.zeros((count, len(step.state.pose)), np.bool_)
    shown[piece, step.image[w][near]] = True
    enough = shown.sum(1) >= config.least_views
    edges = np.flatnonzero(np.diff(np.concatenate([[0], enough.astype(np.int8), [0]]))) * length_m / count
    return tuple((float(low), float(high)) for low, high in zip(edges[::2], edges[1::2], strict=True))
