"""Which stretches of a wire the images show, by their wire masks.

Letters: s horizontal distance from the wire's end A towards B (metres); x, y pixels, the first pixel's
centre at 0.5.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from plnerf.line.wire import Wire
from plnerf.synth.capture import View
from plnerf.synth.config import CaptureConfig

STEP_M = 0.05
WITHIN_PX = 1.5
MIN_IMAGES = 3
SEEN_RULE = (
    f"seen_m: stretches (s from a along direction) whose axis projects within {WITHIN_PX} px of a wire "
    f"mask's pixel in at least {MIN_IMAGES} images, looked at every {STEP_M} m, within the filmed stretch"
)


def seen_stretches(
    wires: Sequence[Wire],
    views: Sequence[View],
    masks: Sequence[Bool[np.ndarray, "h w"]],
    capture: CaptureConfig,
    along: tuple[float, float] = (1.0, 0.0),
) -> list[list[tuple[float, float]]]:
    """For each wire its stretches (s from, s to) that show in at least MIN_IMAGES of the masks.

    Where only a stretch of the line is filmed (capture.filmed_m, along the unit vector `along`) what shows in
    the distance is left out.
    A projected point shows where a mask pixel's centre lies within WITHIN_PX of it.  Whose wire the pixel is,
    a mask does not say: where wires cross in an image the one behind counts as seen.
    """
    grids = [_evenly(wire.base.length_m) for wire in wires]
    ends = np.cumsum([len(s) for s in grids])
    points = np.concatenate([wire.points(s) for wire, s in zip(wires, grids, strict=True)])
    count = np.zeros(len(points), dtype=np.int64)
    for view, mask in zip(views, masks, strict=True):
        count += shown(points, view, mask, capture)
    if capture.filmed_m is not None:
        place = points[:, :2] @ np.array(along)
        count[(place < capture.filmed_m[0]) | (place > capture.filmed_m[1])] = 0
    return [
        stretches(s, part >= MIN_IMAGES) for s, part in zip(grids, np.split(count, ends[:-1]), strict=True)
    ]


def _evenly(length_m: float) -> Float[np.ndarray, " n"]:
    return np.linspace(0.0, length_m, max(2, round(length_m / STEP_M) + 1))


def shown(
    points: Float[np.ndarray, "k 3"], view: View, mask: Bool[np.ndarray, "h w"], capture: CaptureConfig
) -> Int[np.ndarray, "k"]:
    """1 for the world points that project within WITHIN_PX of a pixel of this view's mask, else 0."""
    found = np.zeros(len(points), dtype=np.int64)
    local = (points - view.centre) @ view.R_world_camera
    ahead = np.flatnonzero(local[:, 2] > 0.05)
    size = np.array([capture.width_px, capture.height_px])
    pixel = local[ahead, :2] / local[ahead, 2:] * capture.focal_px + size / 2
    inside = ((pixel > -WITHIN_PX) & (pixel < size + WITHIN_PX)).all(axis=1)
    rows, columns = np.nonzero(mask)
    if len(rows) and inside.any():
        tree = cKDTree(np.stack([columns, rows], axis=1) + 0.5)
        distance, _ = tree.query(pixel[inside], distance_upper_bound=WITHIN_PX + 1e-9)
        found[ahead[inside]] = np.isfinite(distance)
    return found


def stretches(s: Float[np.ndarray, "k"], seen: Bool[np.ndarray, "k"]) -> list[tuple[float, float]]:
    """The runs of seen points as (first s, last s), in millimetres' precision; a single point is none."""
    edge = np.flatnonzero(np.diff(np.concatenate([[0], seen.astype(np.int8), [0]])))
    runs = zip(edge[::2], edge[1::2] - 1, strict=True)
    return [(round(float(s[first]), 3), round(float(s[last]), 3)) for first, last in runs if last > first]
