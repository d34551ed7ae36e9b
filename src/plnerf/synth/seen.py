"""Which stretches of a wire the images show, by their wire masks.

Letters: s horizontal distance from the wire's end A towards B (metres); x, y pixels, the first pixel's
centre at 0.5.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from plnerf.line.wire import Wire
from plnerf.synth.capture import View
from plnerf.synth.flight_config import CaptureConfig
from plnerf.synth.site import radius_m

STEP_M = 0.05
WITHIN_PX = 1.5
MIN_IMAGES = 3
SEEN_RULE = (
    f"seen_m: stretches (s from a along direction) whose axis projects within {WITHIN_PX} px of a wire "
    f"mask's pixel in at least {MIN_IMAGES} images, looked at every {STEP_M} m, within the filmed stretch"
)
COARSE_STEP_M = 0.25
OBSERVABLE_PX, OBSERVABLE_IMAGES, OBSERVABLE_DEG = 1.5, 6, 10.0
OBSERVABLE_RULE = (
    f"observable_m: stretches that at least {OBSERVABLE_IMAGES} images show, as seen_m counts them, at least "
    f"{OBSERVABLE_PX} px wide, from places whose planes with the wire span {OBSERVABLE_DEG:g} degrees or "
    f"more; looked at every {COARSE_STEP_M} m"
)

Stations = Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, " n"]]


def _eastwards(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Stations of a line that runs along x."""
    return points[:, 0]


def seen_stretches(
    wires: Sequence[Wire],
    views: Sequence[View],
    masks: Sequence[Bool[np.ndarray, "h w"]],
    capture: CaptureConfig,
    stations_of: Stations = _eastwards,
) -> list[list[tuple[float, float]]]:
    """For each wire its stretches (s from, s to) that show in at least MIN_IMAGES of the masks.

    Where only a stretch of the line is filmed (capture.filmed_m, by stations) what shows in the distance is
    left out, and so are images in which a wire is thinner than capture.seen_px.
    A projected point shows where a mask pixel's centre lies within WITHIN_PX of it.  Whose wire the pixel is,
    a mask does not say: where wires cross in an image the one behind counts as seen.
    """
    grids = [_evenly(wire.base.length_m, STEP_M) for wire in wires]
    ends = np.cumsum([len(s) for s in grids])
    points = np.concatenate([wire.points(s) for wire, s in zip(wires, grids, strict=True)])
    thick = np.repeat([2 * radius_m(wire) for wire in wires], [len(s) for s in grids])
    count = np.zeros(len(points), dtype=np.int64)
    for view, mask in zip(views, masks, strict=True):
        wide = width_px(points, thick, view, capture) >= capture.seen_px
        count += shown(points, view, mask, capture) * wide
    if capture.filmed_m is not None:
        place = stations_of(points)
        count[(place < capture.filmed_m[0]) | (place > capture.filmed_m[1])] = 0
    return [
        stretches(s, part >= MIN_IMAGES) for s, part in zip(grids, np.split(count, ends[:-1]), strict=True)
    ]


def observable_stretches(
    wires: Sequence[Wire],
    views: Sequence[View],
    masks: Sequence[Bool[np.ndarray, "h w"]],
    capture: CaptureConfig,
) -> list[list[tuple[float, float]]]:
    """For each wire its stretches (s from, s to) that images show well enough to measure: OBSERVABLE_RULE."""
    grids = [_evenly(wire.base.length_m, COARSE_STEP_M) for wire in wires]
    parts = [wire.points(s) for wire, s in zip(wires, grids, strict=True)]
    points, along = np.concatenate(parts), np.concatenate([np.gradient(part, axis=0) for part in parts])
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross(along, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    above = np.cross(side, along)
    thick = np.repeat([2 * radius_m(wire) for wire in wires], [len(s) for s in grids])
    angles = np.full((len(views), len(points)), np.nan)
    for i, (view, mask) in enumerate(zip(views, masks, strict=True)):
        wide = np.flatnonzero(width_px(points, thick, view, capture) >= OBSERVABLE_PX)
        use = wide[shown(points[wide], view, mask, capture) > 0]
        sight = points[use] - view.centre
        turned = np.arctan2((sight * above[use]).sum(1), (sight * side[use]).sum(1))
        angles[i, use] = np.degrees(turned) % 180.0
    enough = np.isfinite(angles).sum(0) >= OBSERVABLE_IMAGES
    enough[enough] = _spread_deg(angles[:, enough]) >= OBSERVABLE_DEG
    cuts = np.cumsum([len(s) for s in grids])[:-1]
    return [stretches(s, part) for s, part in zip(grids, np.split(enough, cuts), strict=True)]


def _spread_deg(angles: Float[np.ndarray, "v k"]) -> Float[np.ndarray, " k"]:
    """The smallest fan that holds a column's directions, as undirected lines: 180 less the widest gap."""
    ordered = np.sort(angles, axis=0)  # NaN last
    first = ordered[0]
    gaps = np.concatenate([np.diff(ordered, axis=0), (first + 180.0 - np.nanmax(ordered, axis=0))[None]])
    return 180.0 - np.nanmax(gaps, axis=0)


def width_px(
    points: Float[np.ndarray, "k 3"], thick_m: Float[np.ndarray, " k"], view: View, capture: CaptureConfig
) -> Float[np.ndarray, " k"]:
    """How wide bodies of a thickness are in a view; 0 behind it."""
    z = (points - view.centre) @ view.R_world_camera[:, 2]
    return np.where(z > 0.05, capture.focal_px * thick_m / np.maximum(z, 0.05), 0.0)


def in_frame(
    points: Float[np.ndarray, "k 3"], view: View, capture: CaptureConfig, around_px: float = 0.0
) -> tuple[Int[np.ndarray, " f"], Float[np.ndarray, "f 2"]]:
    """Indices of the world points that a view has in its frame, or so far around it, and their pixels."""
    local = (points - view.centre) @ view.R_world_camera
    ahead = np.flatnonzero(local[:, 2] > 0.05)
    size = np.array([capture.width_px, capture.height_px])
    pixel = local[ahead, :2] / local[ahead, 2:] * capture.focal_px + size / 2
    inside = ((pixel > -around_px) & (pixel < size + around_px)).all(axis=1)
    return ahead[inside], pixel[inside]


def _evenly(length_m: float, step_m: float) -> Float[np.ndarray, " n"]:
    return np.linspace(0.0, length_m, max(2, round(length_m / step_m) + 1))


def shown(
    points: Float[np.ndarray, "k 3"], view: View, mask: Bool[np.ndarray, "h w"], capture: CaptureConfig
) -> Int[np.ndarray, "k"]:
    """1 for the world points that project within WITHIN_PX of a pixel of this view's mask, else 0."""
    found = np.zeros(len(points), dtype=np.int64)
    index, pixel = in_frame(points, view, capture, WITHIN_PX)
    rows, columns = np.nonzero(mask)
    if len(rows) and len(index):
        tree = cKDTree(np.stack([columns, rows], axis=1) + 0.5)
        distance, _ = tree.query(pixel, distance_upper_bound=WITHIN_PX + 1e-9)
        found[index] = np.isfinite(distance)
    return found


def stretches(s: Float[np.ndarray, "k"], seen: Bool[np.ndarray, "k"]) -> list[tuple[float, float]]:
    """The runs of seen points as (first s, last s), in millimetres' precision; a single point is none."""
    edge = np.flatnonzero(np.diff(np.concatenate([[0], seen.astype(np.int8), [0]])))
    runs = zip(edge[::2], edge[1::2] - 1, strict=True)
    return [(round(float(s[first]), 3), round(float(s[last]), 3)) for first, last in runs if last > first]
