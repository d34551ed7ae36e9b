"""The parts of an image that thin bodies can show in, so that all the rest need not be rendered.

Letters: x, y pixels (x right, y down) of the image's top left corner; z metres along the camera's axis.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from plnerf.synth.capture import View
from plnerf.synth.flight_config import CaptureConfig

TILE_PX = 8
SPARE_PX = 0.5  # the renderer works in float32
NEAREST_M = 0.05

Window = tuple[int, int, int, int]  # x, y, width, height


def tiles_of(
    faces: Float[np.ndarray, "f 3 3"], view: View, capture: CaptureConfig
) -> Bool[np.ndarray, "rows columns"]:
    """Which tiles of TILE_PX squared the boxes around the projected triangles reach into."""
    rows, columns = -(-capture.height_px // TILE_PX), -(-capture.width_px // TILE_PX)
    local = (faces - view.centre) @ view.R_world_camera
    local = local[(local[..., 2] > NEAREST_M).any(axis=1)]
    low, high = _bounds(local)
    middle = np.array([capture.width_px, capture.height_px]) / 2
    size = np.array([columns, rows])
    first = np.floor((low * capture.focal_px + middle - SPARE_PX) / TILE_PX)
    last = np.floor((high * capture.focal_px + middle + SPARE_PX) / TILE_PX)
    use = ((last >= 0) & (first < size)).all(axis=1)
    first = np.clip(first[use], 0, size - 1).astype(np.int64)
    last = np.clip(last[use], 0, size - 1).astype(np.int64)
    return _covered(first, last, rows, columns)


def _bounds(
    local: Float[np.ndarray, "f 3 3"],
) -> tuple[Float[np.ndarray, "f 2"], Float[np.ndarray, "f 2"]]:
    """Least and greatest x/z and y/z over each triangle in camera axes, less its part behind NEAREST_M."""
    z = np.maximum(local[..., 2:], NEAREST_M)
    slopes = local[..., :2] / z
    low, high = slopes.min(axis=1), slopes.max(axis=1)
    cut = (local[..., 2] < NEAREST_M).any(axis=1)  # the slopes of all combinations enclose what is left
    least, most = local[cut, :, :2].min(axis=1), local[cut, :, :2].max(axis=1)
    near, far = z[cut].min(axis=1), z[cut].max(axis=1)
    low[cut] = np.minimum(least / near, least / far)
    high[cut] = np.maximum(most / near, most / far)
    return low, high


def _covered(
    first: Int[np.ndarray, "f 2"], last: Int[np.ndarray, "f 2"], rows: int, columns: int
) -> Bool[np.ndarray, "rows columns"]:
    """The union of boxes of tiles (x, y; both ends in it), by counting their corners."""
    corners = np.zeros((rows + 1, columns + 1), dtype=np.int64)
    for x, y, sign in (
        (first[:, 0], first[:, 1], 1),
        (last[:, 0] + 1, first[:, 1], -1),
        (first[:, 0], last[:, 1] + 1, -1),
        (last[:, 0] + 1, last[:, 1] + 1, 1),
    ):
        np.add.at(corners, (y, x), sign)
    return corners.cumsum(axis=0).cumsum(axis=1)[:rows, :columns] > 0


def strips(tiles: Bool[np.ndarray, "rows columns"], capture: CaptureConfig) -> list[Window]:
    """The tiles as windows one tile high, neighbours in a row joined, cut at the image's border."""
    windows: list[Window] = []
    for row, marked in enumerate(tiles):
        edge = np.flatnonzero(np.diff(np.concatenate([[0], marked.astype(np.int8), [0]])))
        y = row * TILE_PX
        for first, last in zip(edge[::2] * TILE_PX, edge[1::2] * TILE_PX, strict=True):
            right = min(int(last), capture.width_px)
            windows.append((int(first), y, right - int(first), min(TILE_PX, capture.height_px - y)))
    return windows
