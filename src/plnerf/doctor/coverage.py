"""Whether camera poses fix where a wire is, before anything is trained.

Only poses are used, no pixels.  The line is cut into stretches along its axis; where in a stretch the wires
are is not known yet, so a grid of points across it stands for them, each with a wire through it that runs
along the line.  Lengths are in metres where the scene is metric, else in its own unit.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from plnerf.doctor.config import SCENES, SceneDoctorConfig
from plnerf.doctor.observability import Observability, observe_wire
from plnerf.scene.cameras import Cameras
from plnerf.scene.listing import Listing
from plnerf.scene.orientation import frames_for
from plnerf.scene.scene import scene_cameras
from plnerf.scene.transforms import Frames

Verdict = Literal["good", "poor", "unobservable", "unseen"]
_SECOND = (
    "fly a second pass that sees the wires from another angle: higher or lower, or on the other side at "
    "another height (at the same height, level views from both sides share one plane)"
)


def advice(config: SceneDoctorConfig) -> dict[Verdict, str]:
    """What to do about a stretch of each verdict; empty for a good one."""
    return {
        "good": "",
        "poor": f"the views differ too little to place a wire within {config.good_px:g} px, and where the "
        f"rest of its span does not either, training loses it: {_SECOND}",
        "unobservable": "all views (or the only one) lie in one plane with the wire, as those of a camera "
        f"that moves along it: {_SECOND}",
        "unseen": f"no camera sees a wire there at {config.least_px:g} px or more: fly there, or closer",
    }


@dataclass(frozen=True)
class Stretch:
    """The viewing geometry of one stretch; medians over the points that are seen, None without any."""

    from_m: float
    """Along the line, from where it begins."""
    to_m: float
    verdict: Verdict
    sigma_m: float | None
    """Of a wire's position across its direction, in the worse direction."""
    sigma_px: float | None
    """The same in pixels of the view that magnifies it most."""
    sigma_best_m: float | None
    """At the point of the grid that is known best; likewise worst."""
    sigma_worst_m: float | None
    spread_deg: float
    """Greatest angle between two viewing planes."""
    baseline_deg: float | None
    """Between the cameras' track and the line: 0 for moving along it."""
    views: int
    distance_m: float | None
    wire_px: float | None
    """Width of a wire in the view that magnifies it most; None where the scene is unscaled."""
    seen_share: float
    """Of the grid's points, by one view or more."""


@dataclass(frozen=True)
class Diagnosis:
    """All stretches of a scene, and whether wires can be had of it."""

    stretches: tuple[Stretch, ...]
    usable: bool
    """Whether half of the stretches or more are good."""
    unit: str
    box: str
    """Where the wires are assumed, in words; reads on after "Wires are assumed"."""
    cameras: int
    config: SceneDoctorConfig


def diagnose(
    listing: Listing,
    distance: float | None = None,
    config: SceneDoctorConfig = SCENES,
) -> Diagnosis:
    """The viewing geometry of a listing's poses, stretch by stretch.

    distance: from the cameras to the wires in the scene's unit, where no span box is known.
    """
    poses = np.stack([shot.T_world_camera for shot in listing.shots])
    frames = frames_for(
        poses,
        up=listing.up,
        line_axis=listing.line_axis,
        span=listing.span,
        unit=listing.unit,
        crs=listing.crs,
        origin=listing.origin,
    )
    cameras = scene_cameras(listing, frames, 1)
    if distance is None:
        steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
        distance = config.distance_m if listing.unit == "m" else config.spacings * float(np.median(steps))
    metric = listing.unit == "m"
    limit = distance / config.distance_m if not metric else 1.0  # of the thresholds, in the scene's unit
    if listing.span is not None:
        points, box = _grid(listing.span, frames, config), "in the span box of the file"
    else:
        points = _on_axes(cameras, frames.length_to_scene(distance), config)
        box = f"on the cameras' optical axes, about {distance:.3g} {'m' if metric else '(unscaled)'} away"
    u = np.tile([1.0, 0.0, 0.0], (len(points), 1))
    known = observe_wire(
        cameras,
        points,
        u,
        sigma_px=config.sigma_px,
        pose_sigma=frames.length_to_scene(config.pose_sigma_m),
        least_px_per_length=config.least_px / frames.length_to_scene(config.wire_diameter_m)
        if metric
        else 0.0,
    )
    x = frames.depth_to_world(points[:, 0])
    begin, end = float(x.min()), float(x.max())
    count = max(1, min(config.stretches, int((end - begin) / (config.least_stretch_m * limit))))
    slot = np.minimum(((x - begin) / max(end - begin, 1e-12) * count).astype(np.int64), count - 1)
    width = (end - begin) / count
    stretches = []
    for i in np.unique(slot):
        inside = slot == i
        track = _track_deg(cameras, points[inside], frames.length_to_scene(2 * distance))
        ends = (i * width, (i + 1) * width)
        stretches.append(_stretch(ends, known[inside], frames, limit, track, config))
    fine = sum(stretch.verdict == "good" for stretch in stretches)
    return Diagnosis(
        stretches=tuple(stretches),
        usable=2 * fine >= len(stretches),
        unit=listing.unit,
        box=box,
        cameras=len(cameras),
        config=config,
    )


def _grid(
    span: Float[np.ndarray, "2 3"], frames: Frames, config: SceneDoctorConfig
) -> Float[np.ndarray, "p 3"]:
    """Points across the line through the middle of the world box, as far along as the box reaches (scene)."""
    middle, half = span.mean(0), (span[1] - span[0]) / 2
    axes = frames.axes_in_world  # rows: along the line, across it, up
    reach = [
        1 / max(np.abs(axes[k] / half).max(), 1e-12) for k in range(3)
    ]  # from the middle to the box's side
    steps = np.linspace(-1, 1, 2 * config.stretches + 1)
    local = np.array([
        (along * reach[0], across * reach[1], (2 * height - 1) * reach[2])
        for along in steps
        for across in config.across
        for height in config.heights
    ])
    return frames.to_scene(middle + local @ axes)


def _on_axes(cameras: Cameras, distance: float, config: SceneDoctorConfig) -> Float[np.ndarray, "p 3"]:
    centre = cameras.centre.double().numpy()
    forward = cameras.R_scene_camera.double().numpy()[:, :, 2]
    points: Float[np.ndarray, "p 3"] = np.concatenate([
        centre + share * distance * forward for share in config.depths
    ])
    return points


def _track_deg(cameras: Cameras, points: Float[np.ndarray, "p 3"], near: float) -> float | None:
    """The angle between the line and the main direction of the cameras nearest to a stretch."""
    centre = cameras.centre.double().numpy()
    mine = centre[np.abs(centre[:, 0] - points[:, 0].mean()) < near]
    if len(mine) < 2:
        return None
    direction = np.linalg.svd(mine - mine.mean(0), full_matrices=False)[2][0]
    return float(np.degrees(np.arccos(min(1.0, abs(float(direction[0]))))))


def _stretch(
    ends: tuple[float, float],
    known: Observability,
    frames: Frames,
    limit: float,
    track_deg: float | None,
    config: SceneDoctorConfig,
) -> Stretch:
    """limit: the scene's units per metre of the thresholds."""
    seen = known[known.views > 0]
    sigma = frames.depth_to_world(seen.worst)
    typical = float(np.median(sigma)) if len(sigma) else math.inf
    in_pixels = float(np.median(seen.worst * seen.px_per_length)) if len(sigma) else math.inf
    verdict: Verdict = "good" if in_pixels <= config.good_px else "poor"
    if typical > config.unobservable_m * limit:
        verdict = "unobservable"
    if not len(sigma):
        verdict = "unseen"
    return Stretch(
        from_m=ends[0],
        to_m=ends[1],
        verdict=verdict,
        sigma_m=typical if len(sigma) else None,
        sigma_px=in_pixels if len(sigma) else None,
        sigma_best_m=float(sigma.min()) if len(sigma) else None,
        sigma_worst_m=float(sigma.max()) if len(sigma) else None,
        spread_deg=float(np.median(seen.spread_deg)) if len(sigma) else 0.0,
        baseline_deg=track_deg,
        views=int(np.median(seen.views)) if len(sigma) else 0,
        distance_m=frames.length_to_world(float(np.median(seen.distance))) if len(sigma) else None,
        wire_px=(
            float(np.median(seen.px_per_length)) * frames.length_to_scene(config.wire_diameter_m)
            if len(sigma) and frames.unit == "m"
            else None
        ),
        seen_share=len(sigma) / max(1, len(known.views)),
    )
