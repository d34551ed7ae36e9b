"""The flight: where each image is taken from, as an inspection robot or a drone films a line.

Letters: R_world_camera maps OpenCV camera axes (x right, y down, z forward) to the world frame (metres).
A flight is made of passes along the first line, orbits of one of its structures, and grids above it.  By
default three passes: right of the line flying forth, left of it flying back, and above the outer phase,
beside the shield wire, flying forth again.  A camera that moves along a wire sees nothing of the wire's
depth, so it is the passes' different sides and heights that fix the wires.

The passes form a closed loop that begins a few images into the first pass.  Held-out images are every 8th by
name; so cut, each of them has its neighbours in time on both sides among the training images.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from plnerf.synth.flight_config import CaptureConfig, Grid, Leg, Orbit, Pass
from plnerf.synth.site import Site

Pose = tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]
"""R_world_camera and the camera's place."""


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


def plan_flight(site: Site, capture: CaptureConfig) -> tuple[View, ...]:
    """Camera poses of all passes, named in time order."""
    rng = np.random.default_rng([site.config.seed, 2])
    poses: list[tuple[str, np.ndarray, np.ndarray]] = []
    count = capture.views_per_pass
    for leg in capture.passes:
        phases = rng.uniform(0, 2 * math.pi, 5)
        for i in range(count):
            progress = i / (count - 1)
            slow = np.sin(2 * math.pi * np.array([1.0, 1.6, 1.3, 2.2, 1.9]) * progress + phases)
            shake = rng.normal(0.0, 1.0, 3)
            poses.append((leg.name, *_pose(site, capture, leg, progress, slow, shake)))
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
    site: Site,
    capture: CaptureConfig,
    leg: Leg,
    progress: float,
    slow: Float[np.ndarray, "5"],
    shake: Float[np.ndarray, "3"],
) -> Pose:
    """Camera at `progress` (0..1) of a pass.

    slow: five slow waves, which swing its place and its view; shake: deviations of its view.
    """
    match leg:
        case Pass():
            return _along(site, capture, leg, progress, slow, shake)
        case Orbit():
            return _around(site, leg, progress, slow, shake)
        case Grid():
            return _above(site, leg, progress, slow, shake)


def _along(
    site: Site,
    capture: CaptureConfig,
    leg: Pass,
    progress: float,
    slow: Float[np.ndarray, "5"],
    shake: Float[np.ndarray, "3"],
) -> Pose:
    half, route = site.config.span_length_m / 2, site.route
    low, high = capture.filmed_m or (-half, half)
    along = (low + high) / 2 + (high - low) / 2 * (leg.start + (leg.end - leg.start) * progress)
    across = site.config.wire(leg.follows).across_m + leg.across_m + leg.weave_m * slow[0]
    across += leg.zigzag_m * math.sin(2 * math.pi * along / leg.zigzag_period_m)
    x, y = site.at(along, across)
    centre = np.array([x, y, _follow(site, leg.follows, along) + leg.above_m + leg.heave_m * slow[1]])

    forth = math.copysign(1.0, leg.end - leg.start)
    azimuth = math.radians(route.azimuth_deg(along) + leg.toward_deg + 11.0 * slow[2] + 0.8 * shake[0])
    azimuth += 0.0 if forth > 0 else math.pi
    pitch = math.radians(leg.pitch_deg + 9.0 * slow[3] + 0.6 * shake[1])
    roll = math.radians(3.0 * slow[4] + 0.5 * shake[2])
    return look(azimuth, pitch, roll), centre


def _follow(site: Site, name: str, along_m: float) -> float:
    """Height of a wire of the first line at this place along it, held constant beyond the line's ends."""
    route = site.route
    k = route.span_at(along_m)
    wire = next(wires[0] for config, wires in site.lines[0].spans[k].grouped if config.name == name)
    return float(wire.at(np.array([route.share(k, along_m) * wire.base.length_m]))[0, 1])


def _around(
    site: Site, leg: Orbit, progress: float, slow: Float[np.ndarray, "5"], shake: Float[np.ndarray, "3"]
) -> Pose:
    tower = site.lines[0].towers[leg.about]
    bearing = math.radians(leg.from_deg + leg.sweep_deg * progress)
    out = np.array([math.cos(bearing), math.sin(bearing), 0.0])
    height = leg.low_m + (leg.high_m - leg.low_m) * progress
    foot = np.array(tower.foot)
    centre = foot + leg.radius_m * out + np.array([0.0, 0.0, height]) + leg.wobble_m * slow[:3]
    towards = foot + np.array([0.0, 0.0, leg.aim_m]) - centre
    azimuth = math.atan2(towards[1], towards[0]) + math.radians(8.0 * slow[3] + 0.8 * shake[0])
    pitch = math.atan2(towards[2], math.hypot(towards[0], towards[1]))
    pitch += math.radians(5.0 * slow[4] + 0.6 * shake[1])
    return look(azimuth, pitch, math.radians(0.5 * shake[2])), centre


def _above(
    site: Site, leg: Grid, progress: float, slow: Float[np.ndarray, "5"], shake: Float[np.ndarray, "3"]
) -> Pose:
    """The rows are flown at an even speed, the way from row to row included."""
    (low, high), wide = leg.along_m, leg.across_m
    rows = np.linspace(-1.0, 1.0, leg.rows) if leg.rows > 1 else np.zeros(1)
    corners = []
    for i, row in enumerate(rows):
        for end in (-1.0, 1.0) if i % 2 == 0 else (1.0, -1.0):
            s, t = (row, end) if leg.crosses else (end, row)
            corners.append((low + (high - low) * (s + 1) / 2, wide * t))
    path = np.array(corners)
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = progress * lengths[-1]
    along, across = (float(np.interp(at, lengths, values)) for values in path.T)
    ahead, aside = (float(np.interp(min(at + 0.1, lengths[-1]), lengths, values)) for values in path.T)
    # At the very end of the last row it looks as it did just before.
    if at + 0.1 > lengths[-1]:
        ahead, aside = along + path[-1, 0] - path[-2, 0], across + path[-1, 1] - path[-2, 1]
    x, y = site.at(along, across)
    height = site.ground.height(0.0, 0.0) + leg.height_m
    centre = np.array([x, y, height]) + leg.wobble_m * slow[:3]
    azimuth = math.radians(site.route.azimuth_deg(along)) + math.atan2(aside - across, ahead - along)
    azimuth += math.radians(5.0 * slow[3] + 0.8 * shake[0])
    pitch = math.radians(-90.0 + leg.tilt_deg + 3.0 * slow[4] + 0.6 * shake[1])
    return look(azimuth, pitch, math.radians(0.5 * shake[2])), centre


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
