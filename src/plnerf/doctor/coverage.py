"""Before training: will these camera poses show where a wire is?

Looks at poses alone, at no pixel.  The line is cut into stretches along its axis; where in a stretch the
wires are is not known yet, so a grid of points across it stands for them, each with a wire through it that
runs along the line.  Lengths are in metres where the scene is metric, else in its own unit.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from plnerf.detect.curves import CERTAIN_PX
from plnerf.doctor.observability import SIGMA_PX, Observability, observe_wire
from plnerf.scene.cameras import Cameras
from plnerf.scene.listing import Listing
from plnerf.scene.orientation import frames_for
from plnerf.scene.scene import scene_cameras
from plnerf.scene.transforms import Frames

UNOBSERVABLE_M = 1.0
DISTANCE_M = 10.0
"""Between cameras and wires, where the scene names no span box.  In an unscaled scene it stands for the
distance that is assumed there, so that what is unobservable is a share of it: 10 %."""
SPACINGS = 10.0
"""That assumption: as many times the typical way between two photos."""
LEAST_PX = 0.5
"""Thinner, a wire is not found in an image, and the view does not count."""
STRETCHES = 20
"""Most stretches that a line is cut into, but none is shorter than 2 m."""
ACROSS, HEIGHTS = (-0.7, 0.0, 0.7), (0.5, 0.7, 0.9)
"""Grid of points: shares of the span box's half width, and of its height (conductors hang high)."""
DEPTHS = (0.7, 1.0, 1.4)
"""Without a span box: points on every camera's optical axis, in shares of the distance."""
Verdict = Literal["good", "poor", "unobservable", "unseen"]
_SECOND = (
    "fly a second pass that sees the wires from another angle: higher or lower, or on the other side at "
    "another height (at the same height, level views from both sides share one plane)"
)
ADVICE: dict[Verdict, str] = {
    "good": "",
    "poor": (
        f"the views differ too little to place a wire within {CERTAIN_PX:g} px, and where the rest of its "
        f"span does not either, training loses it: {_SECOND}"
    ),
    "unobservable": (
        "all views (or the only one) lie in one plane with the wire, as those of a camera that moves along "
        f"it: {_SECOND}"
    ),
    "unseen": f"no camera sees a wire there at {LEAST_PX:g} px or more: fly there, or closer",
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
    """The same in pixels of the view that magnifies it most: what the search for curves trusts, or not."""
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
    """Where the wires are looked for, in words."""
    cameras: int
    sigma_px: float
    pose_sigma_m: float
    wire_diameter_m: float


def diagnose(
    listing: Listing,
    distance: float | None = None,
    wire_diameter_m: float = 0.03,
    sigma_px: float = SIGMA_PX,
    pose_sigma_m: float = 0.0,
) -> Diagnosis:
    """The viewing geometry of a listing's poses, stretch by stretch."""
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
        distance = DISTANCE_M if listing.unit == "m" else SPACINGS * float(np.median(steps))
    metric = listing.unit == "m"
    limit = distance / DISTANCE_M if not metric else 1.0  # of the thresholds, in the scene's unit
    if listing.span is not None:
        points, box = _grid(listing.span, frames), "in the span box of the file"
    else:
        points = _on_axes(cameras, distance * frames.scale)
        box = f"on the cameras' optical axes, about {distance:.3g} {'m' if metric else '(unscaled)'} away"
    u = np.tile([1.0, 0.0, 0.0], (len(points), 1))
    known = observe_wire(
        cameras,
        points,
        u,
        sigma_px=sigma_px,
        pose_sigma=pose_sigma_m * frames.scale,
        least_px_per_length=LEAST_PX / (wire_diameter_m * frames.scale) if metric else 0.0,
    )
    x = points[:, 0] / frames.scale
    begin, end = float(x.min()), float(x.max())
    count = max(1, min(STRETCHES, int((end - begin) / (2 * limit))))
    slot = np.minimum(((x - begin) / max(end - begin, 1e-12) * count).astype(np.int64), count - 1)
    width = (end - begin) / count
    stretches = []
    for i in np.unique(slot):
        inside = slot == i
        track = _track_deg(cameras, points[inside], 2 * distance * frames.scale)
        mm = wire_diameter_m if metric else None
        stretches.append(_stretch(i * width, (i + 1) * width, known[inside], frames, limit, mm, track))
    fine = sum(stretch.verdict == "good" for stretch in stretches)
    return Diagnosis(
        stretches=tuple(stretches),
        usable=2 * fine >= len(stretches),
        unit=listing.unit,
        box=box,
        cameras=len(cameras),
        sigma_px=sigma_px,
        pose_sigma_m=pose_sigma_m,
        wire_diameter_m=wire_diameter_m,
    )


def _grid(span: Float[np.ndarray, "2 3"], frames: Frames) -> Float[np.ndarray, "p 3"]:
    """Points across the line through the middle of the world box, as far along as the box reaches (scene)."""
    middle, half = span.mean(0), (span[1] - span[0]) / 2
    axes = frames.R_scene_world  # rows: along the line, across it, up
    reach = [
        1 / max(np.abs(axes[k] / half).max(), 1e-12) for k in range(3)
    ]  # from the middle to the box's side
    steps = np.linspace(-1, 1, 2 * STRETCHES + 1)
    local = np.array([
        (along * reach[0], across * reach[1], (2 * height - 1) * reach[2])
        for along in steps
        for across in ACROSS
        for height in HEIGHTS
    ])
    return frames.to_scene(middle + local @ axes)


def _on_axes(cameras: Cameras, distance: float) -> Float[np.ndarray, "p 3"]:
    centre = cameras.centre.double().numpy()
    forward = cameras.R_scene_camera.double().numpy()[:, :, 2]
    points: Float[np.ndarray, "p 3"] = np.concatenate([
        centre + share * distance * forward for share in DEPTHS
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
    begin: float, end: float, known: Observability, frames: Frames, limit: float, diameter_m: float | None,
    track_deg: float | None,
) -> Stretch:  # fmt: skip
    seen = known[known.views > 0]
    sigma = seen.worst / frames.scale
    typical = float(np.median(sigma)) if len(sigma) else math.inf
    in_pixels = float(np.median(seen.worst * seen.px_per_length)) if len(sigma) else math.inf
    verdict: Verdict = "good" if in_pixels <= CERTAIN_PX else "poor"
    if typical > UNOBSERVABLE_M * limit:
        verdict = "unobservable"
    if not len(sigma):
        verdict = "unseen"
    return Stretch(
        from_m=begin,
        to_m=end,
        verdict=verdict,
        sigma_m=typical if len(sigma) else None,
        sigma_px=in_pixels if len(sigma) else None,
        sigma_best_m=float(sigma.min()) if len(sigma) else None,
        sigma_worst_m=float(sigma.max()) if len(sigma) else None,
        spread_deg=float(np.median(seen.spread_deg)) if len(sigma) else 0.0,
        baseline_deg=track_deg,
        views=int(np.median(seen.views)) if len(sigma) else 0,
        distance_m=float(np.median(seen.distance)) / frames.scale if len(sigma) else None,
        wire_px=(
            float(np.median(seen.px_per_length)) * frames.scale * diameter_m
            if len(sigma) and diameter_m is not None
            else None
        ),
        seen_share=len(sigma) / max(1, len(known.views)),
    )
