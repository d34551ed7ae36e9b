"""Chooses the scene frame: which way is up, along which direction the line runs, what fills [-1, 1]^3.

Letters: n cameras.  World frame, float64, camera axes OpenCV's (x right, y down, z forward).
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from plnerf.errors import SceneError
from plnerf.scene.transforms import Frames

ELONGATED = 3.0
"""Camera tracks this many times longer than wide give the line's direction."""

PARALLEL = 0.1
"""Camera x axes whose second singular value is below this share of the first are called parallel (about 6
degrees)."""

LOOKS_DOWN = 0.2
"""Cameras whose mean up has less than this component along the vertical are taken to look down (78
degrees)."""

AROUND = 0.025
"""Room to the sides of wires and above them for what holds them, as a share of the longest wire's length: 1 m
of a span of 40 m."""

BELOW = 0.25
"""How far below the lowest wire the ground is taken to lie at most, as a share of the longest wire's length.
Conductors hang lower than that: 8 to 10 m above the ground in spans of 40 m, 10 to 20 m in those of 300 m."""

FROM_FILE = "file"
FROM_X_AXES = "estimated from the cameras' x axes"
FROM_MEAN_UP = "mean camera up (the cameras' x axes do not determine it)"
FROM_FORWARD = "opposite to the mean view direction (the cameras' x axes do not determine it)"


def frames_for(
    T_world_camera: Float[np.ndarray, "n 4 4"],
    *,
    up: Float[np.ndarray, "3"] | None,
    unit: Literal["m", "unscaled"],
    crs: str | None,
    origin: Float[np.ndarray, "3"] | None = None,
) -> Frames:
    """The scene frame for these cameras (OpenCV axes).

    up: the file's, else ``estimate_up``.  x: ``estimate_line``, which is where a line may run and no more.
    Shift and scale as in nerfacto: mean camera centre to 0, largest absolute camera coordinate to 1.  Raises
    SceneError where all cameras stand at one point.
    """
    rotations, centres = T_world_camera[:, :3, :3], T_world_camera[:, :3, 3]
    z, up_source = (up, FROM_FILE) if up is not None else estimate_up(rotations, centres)
    z = _unit(z)
    along = estimate_line(rotations, centres, z)
    x = _unit(along - z * (along @ z))
    R_scene_world = np.stack([x, np.cross(z, x), z])
    shift = centres.mean(0)
    reach = float(np.abs((centres - shift) @ R_scene_world.T).max())
    if reach <= 1e-9 * max(1.0, float(np.abs(shift).max())):
        raise SceneError(
            f"All {len(centres)} cameras stand at the same point {shift.tolist()}, so nothing can be "
            "triangulated. Photograph from several places, or correct the positions in the file."
        )
    return Frames(R_scene_world, 1.0 / reach, shift, unit, crs, up_source, origin)


def cameras_box(centres: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "2 3"]:
    """Lowest and highest x, y, z of what a capture is about, from its cameras' centres (scene frame).

    As far as they flew along x, and a quarter of that further than they flew to all other sides.
    """
    low, high = centres.min(0), centres.max(0)
    around = 0.25 * (high[0] - low[0]) * np.array([0.0, 1.0, 1.0])
    return np.stack([low - around, high + around])


def fitted_frames(
    frames: Frames, wires: Sequence[Float[np.ndarray, "_ 3"]]
) -> tuple[Frames, Float[np.ndarray, "2 3"]]:
    """The scene frame fitted to wires, and in it the box of what stands and lies around them.

    wires: points along each, one wire or more, in the scene frame `frames`.  x runs along the mean direction
    of their chords, each with the weight of its length; what they span, with the ground below, is centred,
    and its longest side, which is that along x for any usual line, is [-1, 1].  The box is that with room at
    all sides.
    """
    chords = np.stack([wire[-1, :2] - wire[0, :2] for wire in wires])
    lengths = np.linalg.norm(chords, axis=1)
    along = np.linalg.eigh((chords / lengths[:, None]).T @ chords)[1][:, -1]
    along = along if (along[0] or along[1]) > 0 else -along
    level = turned(frames, np.array([*along, 0.0]))
    points = np.concatenate(wires) @ level.from_frames(frames)[1].T
    low, high = points.min(0), points.max(0)
    low[2] -= BELOW * lengths.max()
    middle, half = (low + high) / 2, float((high - low).max()) / 2
    fitted = replace(level, scale=frames.scale / half, shift_world=level.to_world(middle))
    room = AROUND * lengths.max()
    box = np.stack([low - room - middle, high + room - middle]) / half
    return fitted, box


def heading(frames: Frames, azimuth_deg: float) -> Float[np.ndarray, "3"]:
    """The horizontal unit vector (scene frame) of an azimuth: clockwise from north, as surveyors count it.

    North is the world's +y, which it is where the world is east-north-up or a projected CRS.  Raises
    SceneError where that axis is vertical.
    """
    up = frames.R_scene_world[2]
    north = np.array([0.0, 1.0, 0.0]) - up * up[1]
    if np.linalg.norm(north) < LOOKS_DOWN:
        raise SceneError(
            f"An azimuth of {azimuth_deg:g} degrees was given, but the y axis of the scene's world, which "
            "stands for north, is vertical. Leave the azimuth out, or georeference the scene."
        )
    north = _unit(north)
    angle = np.deg2rad(azimuth_deg)
    return frames.direction_to_scene(np.cos(angle) * north + np.sin(angle) * np.cross(north, up))


def turned(frames: Frames, along: Float[np.ndarray, "3"]) -> Frames:
    """The frames with their x axis along a horizontal direction (scene frame); origin and scale stay."""
    x = _unit(np.array([along[0], along[1], 0.0]))
    z = np.array([0.0, 0.0, 1.0])
    return replace(frames, R_scene_world=np.stack([x, np.cross(z, x), z]) @ frames.R_scene_world)


def estimate_up(
    R_world_camera: Float[np.ndarray, "n 3 3"], centres: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "3"], str]:
    """Gravity's opposite, and how it was found.

    People and gimbals hold cameras level, so the cameras' x axes are horizontal: up is the unit vector most
    orthogonal to all of them.  Its sign is the mean camera up's, or for cameras that look straight down
    (their up directions are horizontal) the opposite of the mean view direction's.  Where the x axes do not
    span a plane (parallel, or in all directions), up is the mean camera up, except for cameras that must be
    looking down, for which it is minus the mean view direction: when their own up directions cancel (strips
    flown to and fro), or when the track runs along camera up much further than along the view (one strip:
    aircraft climb less than they travel).
    """
    x_axes, ups, views = R_world_camera[:, :, 0], -R_world_camera[:, :, 1], R_world_camera[:, :, 2]
    mean_up, mean_view = ups.mean(0), views.mean(0)
    singular, directions = _principal(x_axes)
    normal = directions[2]
    if singular[1] > PARALLEL * singular[0] and singular[2] < 0.5 * singular[1]:
        by_up, by_view = float(mean_up @ normal), -float(mean_view @ normal)
        return normal * np.copysign(1.0, by_up if abs(by_up) > LOOKS_DOWN else by_view), FROM_X_AXES
    along_up, along_view = np.ptp(centres @ mean_up), np.ptp(centres @ mean_view)
    if np.linalg.norm(mean_view) > 0.5 and (
        np.linalg.norm(mean_up) < 0.5 or along_up > ELONGATED * max(float(along_view), 1e-12)
    ):
        return -_unit(mean_view), FROM_FORWARD
    if np.linalg.norm(mean_up) > 1e-3:
        return _unit(mean_up), FROM_MEAN_UP
    return ups[0].copy(), FROM_MEAN_UP


def estimate_line(
    R_world_camera: Float[np.ndarray, "n 3 3"], centres: Float[np.ndarray, "n 3"], up: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3"]:
    """A horizontal direction for the scene's x axis, in world coordinates.

    The track's principal horizontal direction, from the first camera to the last, when the track is
    ``ELONGATED``; else the mean of the cameras' x axes; else (they cancel, as on an orbit) the world axis
    that is most horizontal.
    """
    level: Float[np.ndarray, "3 3"] = np.eye(3) - np.outer(up, up)
    track = (centres - centres.mean(0)) @ level
    singular, directions = _principal(track)
    if singular[0] > 1e-12 and singular[0] >= ELONGATED * singular[1]:
        direction: Float[np.ndarray, " 3"] = directions[0]
        travel = float((centres[-1] - centres[0]) @ direction)
        if (travel or direction[np.abs(direction).argmax()]) < 0:
            return -direction
        return direction
    right: Float[np.ndarray, " 3"] = level @ R_world_camera[:, :, 0].mean(0)
    level_axis: Float[np.ndarray, " 3"] = level[np.abs(up).argmin()]
    return right if np.linalg.norm(right) > 0.1 else level_axis


def _principal(
    vectors: Float[np.ndarray, "n 3"],
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
    """Singular values, largest first, and right singular vectors (rows) of n rows, without an n x n
    matrix."""
    squares, columns = np.linalg.eigh(vectors.T @ vectors)
    return np.sqrt(np.maximum(squares[::-1], 0.0)), columns.T[::-1]


def _unit(vector: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    unit: Float[np.ndarray, " 3"] = vector / np.linalg.norm(vector)
    return unit
