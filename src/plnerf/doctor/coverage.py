"""Whether camera poses fix where a wire is, before anything is trained.

Only poses are used, no pixels.  The line is cut into stretches along its direction; where in a stretch the
wires are is not known yet, so points on the cameras' optical axes stand for them, each with a wire through
it that runs along the line.  Lengths are in metres where the scene is metric, else in its own unit.
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
from plnerf.scene.orientation import frames_for, heading, turned
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
    """At the point that is known best; likewise worst."""
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
    """Share of the places along the stretch that one view or more sees."""


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
    azimuth_deg: float | None = None,
) -> Diagnosis:
    """The viewing geometry of a listing's poses, stretch by stretch.

    distance: from the cameras to the wires in the scene's unit.  azimuth_deg: of the line, clockwise from
    north; None: the direction in which the cameras flew.
    """
    poses = np.stack([shot.T_world_camera for shot in listing.shots])
    frames = frames_for(
        poses,
        up=listing.up,
        unit=listing.unit,
        crs=listing.crs,
        origin=listing.origin,
    )
    if azimuth_deg is not None:
        frames = turned(frames, heading(frames, azimuth_deg))
    cameras = scene_cameras(listing, frames, 1)
    if distance is None:
        steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
        distance = config.distance_m if listing.unit == "m" else config.spacings * float(np.median(steps))
    metric = listing.unit == "m"
    limit = distance / config.distance_m if not metric else 1.0  # of the thresholds, in the scene's unit
    points = _on_axes(cameras, frames.length_to_scene(distance), config)
    box = f"on the cameras' optical axes, about {distance:.3g} {'m' if metric else '(unscaled)'} away, and "
    box += "along the cameras' track" if azimuth_deg is None else f"at an azimuth of {azimuth_deg:g}°"
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
