"""The flight: where each image is taken from, as an inspection robot films a span at close range.

Letters: R_world_camera maps OpenCV camera axes (x right, y down, z forward) to the world frame (metres).
Three passes: right of the line flying forth, left of it flying back, and above the outer phase, beside the
shield wire, flying forth again.  A camera that moves along a wire sees nothing of the wire's depth, so it is
the passes' different sides and heights that fix the wires.

The passes form a closed loop that begins a few images into the first pass.  Held-out images are every 8th by
name; so cut, each of them has its neighbours in time on both sides among the training images.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from plnerf.line.wire import Wire
from plnerf.synth.config import CaptureConfig, Pass
from plnerf.synth.span import Span


@dataclass(frozen=True)
class View:
    """One image's camera: pinhole, principal point in the middle of the image."""

    name: str  # without folder and suffix, "0012"
    flight_pass: str
    R_world_camera: Float[np.ndarray, "3 3"]
    centre: Float[np.ndarray, "3"]  # world, metres

    def T_world_camera_opengl(self) -> Float[np.ndarray, "4 4"]:
        """Camera to world with OpenGL camera axes (x right, y up, z backward), for transforms.json."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.R_world_camera * np.array([1.0, -1.0, -1.0])
        matrix[:3, 3] = self.centre
        return matrix


def plan_flight(span: Span, capture: CaptureConfig) -> tuple[View, ...]:
    """Camera poses of all passes, named in time order."""
    rng = np.random.default_rng([span.config.seed, 2])
    poses: list[tuple[str, np.ndarray, np.ndarray]] = []
    count = capture.views_per_pass
    for leg in capture.passes:
        phases = rng.uniform(0, 2 * math.pi, 5)
        for i in range(count):
            poses.append((leg.name, *_pose(span, capture, leg, i / (count - 1), phases, rng)))
    cut = 4 if count > 8 else 1
    loop = poses[cut:] + poses[:cut]
    return tuple(View(f"{i:04d}", name, R, centre) for i, (name, R, centre) in enumerate(loop))


def written_views(views: Sequence[View], capture: CaptureConfig, seed: int) -> tuple[View, ...]:
    """The views as transforms.json gives them: off the true ones by the capture's noise of poses.

    Centres by a normal deviation along each world axis, directions by one about each camera axis.  Without
    noise they are the views themselves.
    """
    if capture.pose_noise_m == 0 and capture.pose_noise_deg == 0:
        return tuple(views)
    rng = np.random.default_rng([seed, 8])
    off_m = capture.pose_noise_m * rng.standard_normal((len(views), 3))
    off_rad = math.radians(capture.pose_noise_deg) * rng.standard_normal((len(views), 3))
    return tuple(
        replace(view, R_world_camera=view.R_world_camera @ turn(angle), centre=view.centre + shift)
        for view, shift, angle in zip(views, off_m, off_rad, strict=True)
    )


def _pose(
    span: Span,
    capture: CaptureConfig,
    leg: Pass,
    progress: float,
    phases: Float[np.ndarray, "5"],
    rng: np.random.Generator,
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Camera at `progress` (0..1) of a pass: a slow wobble of position and view, and a little shake."""
    half = span.config.span_length_m / 2
    low, high = capture.filmed_m or (-half, half)
    slow = np.sin(2 * math.pi * np.array([1.0, 1.6, 1.3, 2.2, 1.9]) * progress + phases)
    shake = rng.normal(0.0, 1.0, 3)
    along = (low + high) / 2 + (high - low) / 2 * (leg.start + (leg.end - leg.start) * progress)
    wire = next(wires[0] for config, wires in span.grouped if config.name == leg.follows)
    across = span.config.wire(leg.follows).across_m + leg.across_m + leg.weave_m * slow[0]
    across += leg.zigzag_m * math.sin(2 * math.pi * along / leg.zigzag_period_m)
    x, y = span.at(along, across)
    centre = np.array([x, y, _follow(wire, along, half) + leg.above_m + leg.heave_m * slow[1]])

    forth = math.copysign(1.0, leg.end - leg.start)
    azimuth = math.radians(span.config.line_azimuth_deg + leg.toward_deg + 11.0 * slow[2] + 0.8 * shake[0])
    azimuth += 0.0 if forth > 0 else math.pi
    pitch = math.radians(leg.pitch_deg + 9.0 * slow[3] + 0.6 * shake[1])
    roll = math.radians(3.0 * slow[4] + 0.5 * shake[2])
    return look(azimuth, pitch, roll), centre


def _follow(wire: Wire, along_m: float, half_m: float) -> float:
    """Height of the wire at this place along the line, held constant beyond the towers."""
    s = np.clip((along_m + half_m) / (2 * half_m), 0.0, 1.0) * wire.base.length_m
    return float(wire.at(np.array([s]))[0, 1])


def look(azimuth_rad: float, pitch_rad: float, roll_rad: float) -> Float[np.ndarray, "3 3"]:
    """R_world_camera of a camera looking along azimuth (+x to +y) and pitch (up), rolled clockwise."""
    ca, sa = math.cos(azimuth_rad), math.sin(azimuth_rad)
    cp, sp = math.cos(pitch_rad), math.sin(pitch_rad)
    forward = np.array([ca * cp, sa * cp, sp])
    right = np.array([sa, -ca, 0.0])
    down = np.cross(forward, right)
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    return np.stack([cr * right + sr * down, -sr * right + cr * down, forward], axis=1)


def turn(axis_rad: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """The rotation about the vector `axis_rad` by its length (Rodrigues)."""
    angle = float(np.linalg.norm(axis_rad))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = axis_rad / angle
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * K + (1 - math.cos(angle)) * (K @ K)
