"""The cameras of a capture drawn as frustums, each with a small copy of its photo."""

import math
from functools import lru_cache

import numpy as np
import viser
from jaxtyping import Float, UInt8

from plnerf.view.display_frame import LINE_PER_UNIT, DisplayFrame
from plnerf.view.eye import Eye, eye_of
from plnerf.view.posed_views import PosedViews

SMALL_PX = 240
"""Longer side of a photo on a frustum."""
MOST_PHOTOS = 300
"""Frustums beyond so many, evenly chosen, are without their photos."""
SHARE = 0.6
"""Height of a frustum as a share of the median step between neighbouring cameras ..."""
SMALLEST_M, LARGEST_M = 0.15, 3.0
"""... within these bounds."""


class SmallPhotos:
    """Small copies of the photos, read once and kept for all clients."""

    def __init__(self, views: PosedViews) -> None:
        self._views = views
        count = len(views.names)
        self._chosen = set(np.linspace(0, count - 1, min(count, MOST_PHOTOS)).round().astype(int).tolist())
        self.of = lru_cache(None)(self._of)

    def _of(self, i: int) -> UInt8[np.ndarray, "h w 3"] | None:
        """That of photo i; None where it is not there or not shown."""
        return self._views.photo(i, SMALL_PX) if i in self._chosen else None


def draw_frustums(
    scene: viser.SceneApi, views: PosedViews, frame: DisplayFrame
) -> tuple[viser.SceneNodeHandle, list[viser.CameraFrustumHandle]]:
    """Draws all cameras, without photos; returns the node by which they can be hidden, and each one's."""
    root, drawn = scene.add_frame("/cameras", show_axes=False), []
    height = frustum_height(views.cameras.centre.numpy()) / LINE_PER_UNIT
    for i in range(len(views.names)):
        width_px, height_px = views.cameras.size_px[i].tolist()
        eye = eye_of(views.cameras, i, width_px / height_px)
        one = scene.add_camera_frustum(
            f"/cameras/{i}",
            eye.fov_rad,
            width_px / height_px,
            scale=scale_of(eye, height),
            thickness=1.2,
            thickness_units="screen",
            color=(60, 60, 70),
            wxyz=eye.wxyz,
            position=frame.to_viewer(eye.centre),
            cast_shadow=False,
            receive_shadow=False,
        )
        drawn.append(one)
    return root, drawn


def scale_of(eye: Eye, height: float) -> float:
    """viser's scale of a frustum of some height; at 1 it has the same volume whatever its shape."""
    tall = math.tan(eye.fov_rad / 2)
    return height / 2 / tall * float(np.cbrt(tall * tall * eye.aspect / 3))


def frustum_height(centres: Float[np.ndarray, "n 3"]) -> float:
    """In LineFrame units: small enough that neighbours do not cover each other."""
    if len(centres) < 2:
        return LARGEST_M / 3
    step = float(np.median(np.linalg.norm(np.diff(centres, axis=0), axis=1)))
    return min(max(SHARE * step, SMALLEST_M), LARGEST_M)
