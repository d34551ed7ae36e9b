"""The cameras of a scene as one batch of tensors.

Letters: n cameras, p points.  Camera axes are OpenCV's: x right, y down, z forward.  Pixels: the image's
top-left corner is (0, 0) and the first pixel's centre is (0.5, 0.5).  Lengths are in scene units.  No frame
changes here: ``transforms.py`` does that.
"""

from dataclasses import dataclass, fields, replace
from functools import cached_property

import torch
from jaxtyping import Float, Int
from torch import Tensor


@dataclass(frozen=True, eq=False)
class Cameras:
    """N cameras, pinhole with OPENCV distortion, OpenCV axes, float32, in the scene frame."""

    R_scene_camera: Float[Tensor, "n 3 3"]
    """Proper rotation, camera axes to scene axes."""
    centre: Float[Tensor, "n 3"]
    """Camera centres in the scene frame."""
    focal_px: Float[Tensor, "n 2"]
    """fx, fy at the resolution of `size_px`: in a scene, that of training."""
    principal_px: Float[Tensor, "n 2"]
    """cx, cy at the same resolution."""
    distortion: Float[Tensor, "n 5"]
    """k1 k2 p1 p2 k3, of OpenCV's model; they act on z = 1 coordinates, so no resolution enters."""
    size_px: Int[Tensor, "n 2"]
    """Width and height, int64."""

    @cached_property
    def distorted(self) -> bool:
        """Whether any lens distorts.  Asked of the device once, so that no training step waits for it."""
        return bool(self.distortion.any())

    def __len__(self) -> int:
        return self.centre.shape[0]

    def __getitem__(self, index: slice | list[int] | Tensor) -> "Cameras":
        """The chosen cameras, in the order of ``index``."""
        return Cameras(*(getattr(self, field.name)[index] for field in fields(self)))

    def at_size(self, size_px: Int[Tensor, "n 2"]) -> "Cameras":
        """The same cameras for images of other sizes (width, height)."""
        if torch.equal(size_px, self.size_px):
            return self
        ratio = size_px / self.size_px
        return replace(
            self, focal_px=self.focal_px * ratio, principal_px=self.principal_px * ratio, size_px=size_px
        )

    def to(self, device: torch.device | str) -> "Cameras":
        """The same cameras on another device."""
        return Cameras(*(getattr(self, field.name).to(device) for field in fields(self)))


def project(
    cameras: Cameras, x_scene: Float[Tensor, "p 3"]
) -> tuple[Float[Tensor, "n p 2"], Float[Tensor, "n p"]]:
    """Where each camera sees each point: pixel (x, y), and depth along the camera's z axis in scene units.

    OpenCV's distortion model ("Camera Calibration and 3D Reconstruction").  A pixel means something only
    where the depth is positive; far outside the image the distortion polynomial may fold back and a pixel can
    be wrong.
    """
    away, R = x_scene[None] - cameras.centre[:, None], cameras.R_scene_camera[:, None]
    # Not einsum: of a wire's few hundred points its threads cost ten times what its arithmetic does.
    x_camera = away[..., :1] * R[..., 0, :] + away[..., 1:2] * R[..., 1, :] + away[..., 2:] * R[..., 2, :]
    depth = x_camera[..., 2]
    plane = x_camera[..., :2] / depth[..., None]
    distorted = distort(plane, cameras.distortion[:, None])
    return distorted * cameras.focal_px[:, None] + cameras.principal_px[:, None], depth


def distort(plane: Float[Tensor, "*b 2"], distortion: Float[Tensor, "*#b 5"]) -> Float[Tensor, "*b 2"]:
    """OpenCV's five-parameter distortion of z = 1 coordinates.

    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), and y' likewise with p1 and p2
    exchanged.
    """
    k1, k2, p1, p2, k3 = distortion.unbind(-1)
    x, y = plane.unbind(-1)
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return torch.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y),
        ],
        dim=-1,
    )
