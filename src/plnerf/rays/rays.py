"""Rays through pixels, as cones.  Mip-NeRF, section 3.1.

Letters: r rays; origins o, unit directions d, so that the distance t along a ray is a length in the scene
frame.  Pixel coordinates have their origin at the image's top-left corner; the first pixel's centre is
(0.5, 0.5).
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from plnerf.ops.backends import Backend
from plnerf.ops.dispatch import kernels
from plnerf.rays.lens import undistort_plane
from plnerf.scene.cameras import Cameras


@dataclass(frozen=True)
class Rays:
    """r cones in the scene frame."""

    origins: Float[Tensor, "r 3"]
    directions: Float[Tensor, "r 3"]  # of unit length
    radius: Float[Tensor, " r"]  # of the cone, per unit of distance: the pixel's width times 2/sqrt(12)
    camera: Int[Tensor, " r"]  # index of the camera that each ray belongs to

    def __len__(self) -> int:
        return self.origins.shape[0]

    def __getitem__(self, index: slice) -> "Rays":
        return Rays(self.origins[index], self.directions[index], self.radius[index], self.camera[index])

    def to(self, device: torch.device) -> "Rays":
        """The same rays on a device."""
        return Rays(
            *(value.to(device) for value in (self.origins, self.directions, self.radius, self.camera))
        )


def pixel_rays(
    cameras: Cameras, camera: Int[Tensor, " r"], pixel_px: Float[Tensor, "r 2"], backend: Backend = "torch"
) -> Rays:
    """Rays through pixel positions of cameras, lens distortion taken out (no image is resampled)."""
    fused = kernels(backend).on_rays
    if fused is not None and fused.cast_rays is not None:
        cast = fused.cast_rays(
            cameras.R_scene_camera, cameras.centre, cameras.focal_px, cameras.principal_px,
            cameras.distortion, camera, pixel_px,
        )  # fmt: skip
        return Rays(*cast, camera)
    focal = cameras.focal_px[camera]
    plane = undistort(cameras, camera, pixel_px)
    direction = torch.cat([plane, torch.ones_like(plane[:, :1])], -1)
    length = direction.norm(dim=-1, keepdim=True)
    directions = torch.einsum("rij,rj->ri", cameras.R_scene_camera[camera], direction / length)
    # A pixel is 1/f wide on the plane z = 1, which lies `length` away.
    radius = 2 / math.sqrt(12) / (focal.mean(-1) * length[:, 0])
    return Rays(cameras.centre[camera], directions, radius, camera)


def undistort(
    cameras: Cameras, camera: Int[Tensor, " r"], pixel_px: Float[Tensor, "r 2"]
) -> Float[Tensor, "r 2"]:
    """Points on the camera's plane z = 1 that the lens (OPENCV: k1 k2 p1 p2 k3) maps to the given pixels.

    To 1e-6 px where the lens is invertible; see `lens.undistort_plane` for where it is not.
    """
    plane = (pixel_px - cameras.principal_px[camera]) / cameras.focal_px[camera]
    return undistort_plane(plane, cameras.distortion[camera]) if cameras.distorted else plane
