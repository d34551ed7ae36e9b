"""Cameras of a scene as stereo needs them: float64, at the size at which images are compared.

Letters: n views, p points.  Scene frame; pixels as in `scene/cameras.py`: the first one's centre is
(0.5, 0.5).
"""

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8

from plnerf.rays.lens import undistort_plane
from plnerf.scene.cameras import distort
from plnerf.scene.scene import Scene

LONGEST_PX = 1024
"""Larger images are reduced by a whole number: what matching costs grows with the third power of the size."""


@dataclass(frozen=True, eq=False)
class View:
    """One posed image."""

    R_scene_camera: Float[np.ndarray, "3 3"]
    centre: Float[np.ndarray, "3"]
    focal_px: Float[np.ndarray, "2"]
    principal_px: Float[np.ndarray, "2"]
    distortion: Float[np.ndarray, "5"]
    width: int
    height: int

    @property
    def axis(self) -> Float[np.ndarray, "3"]:
        """Direction of view."""
        return self.R_scene_camera[:, 2]

    def rays(self) -> Float[np.ndarray, "h w 3"]:
        """Directions of all pixels' centres, unit length."""
        x, y = np.meshgrid(np.arange(self.width) + 0.5, np.arange(self.height) + 0.5)
        return self.directions(np.stack([x, y], -1))

    def directions(self, pixels: Float[np.ndarray, "*p 2"]) -> Float[np.ndarray, "*p 3"]:
        """Unit vectors from the centre through pixels."""
        plane = torch.from_numpy((pixels - self.principal_px) / self.focal_px)
        if self.distortion.any():
            plane = undistort_plane(plane, torch.from_numpy(self.distortion).expand(*plane.shape[:-1], 5))
        rays = np.concatenate([plane.numpy(), np.ones((*pixels.shape[:-1], 1))], -1)
        turned: Float[np.ndarray, "*p 3"] = (
            rays / np.linalg.norm(rays, axis=-1, keepdims=True) @ self.R_scene_camera.T
        )
        return turned

    def project(
        self, points: Float[np.ndarray, "p 3"]
    ) -> tuple[Float[np.ndarray, "p 2"], Bool[np.ndarray, " p"]]:
        """Where points are seen, and which of them lie before the camera and inside of the image."""
        local = (points - self.centre) @ self.R_scene_camera
        before = local[:, 2] > 0
        plane = torch.from_numpy(local[:, :2] / np.where(before, local[:, 2], 1.0)[:, None])
        bent = distort(plane, torch.from_numpy(self.distortion)).numpy()
        pixels: Float[np.ndarray, "p 2"] = bent * self.focal_px + self.principal_px
        inside = before & (pixels >= 0).all(1) & (pixels < (self.width, self.height)).all(1)
        return pixels, inside


def view_of(scene: Scene, i: int) -> View:
    """Camera i of a scene, reduced as `picture` is."""
    cameras = scene.cameras
    full = cameras.size_px[i].numpy()
    size = full // _reduction(full)
    shrink = size / full
    return View(
        cameras.R_scene_camera[i].double().numpy(), cameras.centre[i].double().numpy(),
        cameras.focal_px[i].double().numpy() * shrink, cameras.principal_px[i].double().numpy() * shrink,
        cameras.distortion[i].double().numpy(), int(size[0]), int(size[1]),
    )  # fmt: skip


def picture(scene: Scene, i: int) -> tuple[UInt8[np.ndarray, "h w 3"], Bool[np.ndarray, "h w"]]:
    """Colours of image i, at most `LONGEST_PX` long, and which of its pixels no mask hides."""
    rgb, valid = scene.images.image(i), scene.images.valid(i)
    height, width = valid.shape
    reduced = _reduction(np.array([width, height]))
    if reduced == 1:
        return rgb, valid
    size = width // reduced, height // reduced
    small: UInt8[np.ndarray, "h w 3"] = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
    share = cv2.resize(valid.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return small, share > 1 - 1e-4


def _reduction(size_px: np.ndarray) -> int:
    return -(-int(size_px.max()) // LONGEST_PX)
