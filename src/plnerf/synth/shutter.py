"""Motion while the shutter is open: a view becomes several, and the picture is the mean of theirs.

Letters: R_world_camera maps OpenCV camera axes (x right, y down, z forward) to the world (metres).  Time runs
from -1/2 to 1/2 while the shutter is open; the view as planned is that of time 0.  The camera flies on along
its way and turns a little at random, as one that hangs below a drone does: a camera that only flies along a
wire smears the wire along itself.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from plnerf.synth.capture import View, turn
from plnerf.synth.flight_config import CaptureConfig

SHAKE = 0.35  # image motion by turning, about each axis, relative to that by flying on
PROBE_M = 5.0  # what stands for the wires in a view that shows none lies so far ahead


def image_motion(
    points: Float[np.ndarray, "k 3"],
    velocity: Float[np.ndarray, "3"],
    spin: Float[np.ndarray, "3"],
    focal_px: float,
) -> Float[np.ndarray, "k 2"]:
    """Motion in the image, pixels per unit of time, of points that rest in the world; all in camera axes.

    The camera moves with `velocity` and turns with `spin` (axis times rad), so that a point moves by
    -velocity - spin x point in its axes (Longuet-Higgins and Prazdny 1980).
    """
    moved = -velocity - np.cross(spin, points)
    z = points[:, 2:]
    return focal_px * (moved[:, :2] - points[:, :2] / z * moved[:, 2:]) / z


def flight_directions(views: Sequence[View]) -> Float[np.ndarray, "n 3"]:
    """Unit vector of each camera's motion, from its neighbours in the same pass (world axes)."""
    directions = np.zeros((len(views), 3))
    for i, view in enumerate(views):
        before, after = views[i - 1], views[(i + 1) % len(views)]
        start = before if before.flight_pass == view.flight_pass else view
        end = after if after.flight_pass == view.flight_pass else view
        step = end.centre - start.centre
        directions[i] = step / max(float(np.linalg.norm(step)), 1e-9)
    return directions


def open_shutter(
    view: View,
    direction: Float[np.ndarray, "3"],
    wires: Float[np.ndarray, "k 3"],
    capture: CaptureConfig,
    blur_px: float,
    rng: np.random.Generator,
    frames: int,
) -> tuple[View, ...]:
    """The cameras of `frames` instants, evenly spaced while the shutter is open.

    It is open for as long as the point of `wires` (world points) that moves fastest in the image takes to
    move by `blur_px`.  Without blur it is the view alone.
    """
    if blur_px == 0:
        return (view,)
    local = (wires - view.centre) @ view.R_world_camera
    half = np.array([capture.width_px, capture.height_px]) / 2
    ahead = local[local[:, 2] > 0.3]
    seen = ahead[(np.abs(ahead[:, :2] / ahead[:, 2:] * capture.focal_px) < half).all(axis=1)]
    if not len(seen):
        seen = np.array([[0.0, 0.0, PROBE_M]])
    velocity = direction @ view.R_world_camera
    flying = np.linalg.norm(image_motion(seen, velocity, np.zeros(3), capture.focal_px), axis=1).max()
    spin = rng.normal(0.0, SHAKE, 3) * flying / capture.focal_px
    fastest = np.linalg.norm(image_motion(seen, velocity, spin, capture.focal_px), axis=1).max()
    times = ((np.arange(frames) + 0.5) / frames - 0.5) * blur_px / fastest
    return tuple(
        replace(view, R_world_camera=view.R_world_camera @ turn(spin * t), centre=view.centre + direction * t)
        for t in times
    )
