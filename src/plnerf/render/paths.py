"""A steady flight along the cameras of a capture.

Letters: n cameras in time order, k of them kept, u their distance along the track; scene frame.

A capture of a line has several passes; between two of them the camera leaps or turns round, and a path
through the leap would cut through wires and towers.  So the path follows the longest pass alone: the most
cameras in a row of which each is at most `JUMP` median steps from the next and turned by at most `TURN_DEG`.
"""

import re
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import torch
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation, RotationSpline

from plnerf.errors import ConfigError
from plnerf.scene.cameras import Cameras
from plnerf.scene.memory import require_memory

JUMP = 4.0
TURN_DEG = 90.0
_CLOSE = (
    0.1  # cameras nearer to the last kept one than this many median steps are left out: they only add shake
)
_DENSE = 64  # points a segment for the length along the curve


FRAME_BYTES = 400
"""Memory of a camera of a path at least: its pose in double and single precision, its lens."""


def in_time_order(names: Sequence[str], images: Sequence[int]) -> list[int]:
    """Images sorted by name with numbers as numbers: frame_9 comes before frame_10."""
    return sorted(
        images, key=lambda i: [(int(p), "") if p.isdigit() else (-1, p) for p in re.split(r"(\d+)", names[i])]
    )


def longest_pass(cameras: Cameras) -> range:
    """Positions of the longest pass without a jump among cameras in time order; the first of equals.

    Raises ConfigError where no camera moves.
    """
    centre = cameras.centre.double().numpy()
    step = np.linalg.norm(np.diff(centre, axis=0), axis=1)
    moving = step[step > 0]
    if not moving.size:
        raise ConfigError(
            f"A path needs at least two cameras at different places, but the {len(cameras)} cameras do not "
            "move. Render the views of the images instead: --views test."
        )
    rotation = Rotation.from_matrix(cameras.R_scene_camera.double().numpy())
    turn_deg = np.rad2deg((rotation[:-1].inv() * rotation[1:]).magnitude())
    jumps = np.flatnonzero((step > JUMP * np.median(moving)) | (turn_deg > TURN_DEG))
    edges = [0, *(jumps + 1).tolist(), len(cameras)]
    passes = [range(a, b) for a, b in pairwise(edges)]
    return max(passes, key=len)


def fly_along(cameras: Cameras, frames: int, *, smooth: float = 1.0) -> Cameras:
    """`frames` cameras at even steps along the longest pass: splines of positions and of rotations.

    cameras: in time order.  smooth: standard deviation, in cameras, of the Gaussian that steadies positions
    and views first; a straight, even track keeps its place exactly.  Intrinsics are those of the pass's first
    camera, without its lens distortion.  Raises ConfigError with fewer than 2 frames, or where no two cameras
    make a pass.
    """
    if frames < 2:
        raise ConfigError(
            f"A path has at least 2 frames, but {frames} were asked for. Give --frames 2 or more."
        )
    require_memory(FRAME_BYTES * float(frames), f"A path of {frames:,} frames", "Render fewer frames.")
    flown = list(longest_pass(cameras)) if len(cameras) > 1 else []
    centre = cameras.centre.double().numpy()[flown]
    kept = _apart(centre)
    if len(kept) < 2:
        raise ConfigError(
            f"A path needs at least two cameras in a row less than {JUMP:g} median steps and {TURN_DEG:g} "
            f"degrees apart, but none of the {len(cameras)} training cameras are. Render the views of the "
            "images instead: --views test."
        )
    R = cameras.R_scene_camera.double().numpy()[flown][kept]
    position, view = _steadied(centre[kept], smooth), _steadied_views(R, smooth)
    u = np.concatenate([[0.0], np.linalg.norm(np.diff(position, axis=0), axis=1).cumsum()])
    track, views = CubicSpline(u, position, bc_type="natural"), RotationSpline(u, view)
    at = _even_along(track, u, frames)
    first = cameras[[flown[0]]]
    return Cameras(
        R_scene_camera=torch.from_numpy(views(at).as_matrix()).float(),
        centre=torch.from_numpy(track(at)).float(),
        focal_px=first.focal_px.expand(frames, -1),
        principal_px=first.principal_px.expand(frames, -1),
        distortion=torch.zeros(frames, 5),
        size_px=first.size_px.expand(frames, -1),
    )


def _apart(centre: Float[np.ndarray, "n 3"]) -> list[int]:
    """Cameras to keep so that neighbours are apart: hovering adds nothing but shake."""
    if len(centre) < 2:
        return []
    least = _CLOSE * np.median(np.linalg.norm(np.diff(centre, axis=0), axis=1))
    kept = [0]
    for i in range(1, len(centre)):
        if np.linalg.norm(centre[i] - centre[kept[-1]]) > least:
            kept.append(i)
    return kept


def _steadied(position: Float[np.ndarray, "k 3"], smooth: float) -> Float[np.ndarray, "k 3"]:
    """Positions under a Gaussian along the track; reflected through its ends, which stay in place."""
    if smooth <= 0:
        return position
    pad = int(np.ceil(4 * smooth)) + 1  # beyond the filter's reach, whatever it does at its own ends
    longer = np.pad(position, ((pad, pad), (0, 0)), mode="reflect", reflect_type="odd")
    steady: Float[np.ndarray, "k 3"] = gaussian_filter1d(longer, smooth, axis=0, mode="nearest")[pad:-pad]
    return steady


def _steadied_views(R: Float[np.ndarray, "k 3 3"], smooth: float) -> Rotation:
    """Rotations under the same Gaussian: weighted chordal means of each camera's neighbours."""
    rotation, place = Rotation.from_matrix(R), np.arange(len(R))
    if smooth <= 0:
        return rotation
    weights = np.exp(-0.5 * ((place[:, None] - place) / smooth) ** 2)
    return Rotation.concatenate([rotation.mean(weights=row) for row in weights])


def _even_along(track: CubicSpline, u: Float[np.ndarray, " k"], frames: int) -> Float[np.ndarray, " frames"]:
    """Parameters of `frames` points at even arc length along the curve."""
    dense = np.interp(np.linspace(0, len(u) - 1, _DENSE * (len(u) - 1) + 1), np.arange(len(u)), u)
    length = np.concatenate([[0.0], np.linalg.norm(np.diff(track(dense), axis=0), axis=1).cumsum()])
    even: Float[np.ndarray, " frames"] = np.interp(np.linspace(0, length[-1], frames), length, dense)
    return even
