"""Gaussians in space to Gaussians in an image: EWA splatting (Zwicker et al. 2001; Kerbl et al. 2023, eq. 5).

    m = projection of the mean,   Sigma' = J W Sigma W^T J^T + LOW_PASS I,   W = R_camera_local

J is the Jacobian of the pinhole projection at the mean.  Letters: n Gaussians, v of them visible.
"""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor

from plnerf.export.splat_raster import rasterise
from plnerf.export.splat_sh import degree_of, sh_colour

LOW_PASS = 0.3
"""Added to the covariance in square pixels, as viewers do: no Gaussian is narrower than about a pixel."""
BEYOND = 1.3
"""J is that of a mean no farther outside of the image than so many times its half width or height: far
outside, the linear projection has no meaning."""
REACH = 3.0
"""Standard deviations to which a Gaussian is drawn."""


@dataclass(frozen=True, eq=False)
class Pinhole:
    """A camera without distortion, OpenCV axes, in the frame of the Gaussians, float32."""

    R_local_camera: Float[Tensor, "3 3"]
    centre: Float[Tensor, "3"]
    focal_px: Float[Tensor, "2"]
    principal_px: Float[Tensor, "2"]
    size_px: tuple[int, int]
    """Width and height."""
    near: float
    """Nothing nearer along z is drawn."""


@dataclass(frozen=True, eq=False)
class Gaussians:
    """n Gaussians as tensors that are fitted."""

    xyz: Float[Tensor, "n 3"]
    log_scale: Float[Tensor, "n 3"]
    quaternion: Float[Tensor, "n 4"]
    """w, x, y, z, of any length."""
    logit: Float[Tensor, " n"]
    """Of the opacity."""
    sh: Float[Tensor, "n K 3"]


def render(gaussians: Gaussians, camera: Pinhole) -> tuple[Float[Tensor, "h w 3"], Float[Tensor, "h w"]]:
    """Colour over black and transmittance of what a camera sees; differentiable by the Gaussians."""
    with torch.no_grad():
        index = _in_sight(gaussians, camera)
    xyz = gaussians.xyz[index]
    seen = (xyz - camera.centre) @ camera.R_local_camera
    mean = seen[:, :2] / seen[:, 2:] * camera.focal_px + camera.principal_px
    covariance = image_covariance(seen, gaussians.log_scale[index], gaussians.quaternion[index], camera)
    a, b, c = covariance.unbind(-1)
    determinant = a * c - b * b
    direction = F.normalize(xyz - camera.centre, dim=-1)
    sh = gaussians.sh[index]
    colour = sh_colour(sh, direction, degree_of(sh.shape[1]))
    opacity = gaussians.logit[index].sigmoid()
    conic = torch.stack([c, -b, a], -1) / determinant[:, None]
    splats = torch.cat([mean, conic, opacity[:, None], colour], -1)
    return rasterise(splats, _boxes(mean.detach(), a.detach(), c.detach(), camera), camera.size_px)


def _in_sight(gaussians: Gaussians, camera: Pinhole) -> Int[Tensor, " v"]:
    """The Gaussians that may touch the image, from front to back: by their distance from the camera."""
    away = gaussians.xyz - camera.centre
    seen = away @ camera.R_local_camera
    size, z = torch.tensor(camera.size_px), seen[:, 2].clamp_min(camera.near)
    mean = seen[:, :2] / z[:, None] * camera.focal_px + camera.principal_px
    reach = REACH * (gaussians.log_scale.amax(1).exp() / z)[:, None] * camera.focal_px + REACH
    inside = ((mean > -reach) & (mean < size + reach)).all(1) & (seen[:, 2] > camera.near)
    index = inside.nonzero()[:, 0]
    return index[away[index].square().sum(1).argsort()]


def image_covariance(
    seen: Float[Tensor, "v 3"],
    log_scale: Float[Tensor, "v 3"],
    quaternion: Float[Tensor, "v 4"],
    camera: Pinhole,
) -> Float[Tensor, "v 3"]:
    """Sigma' as its entries xx, xy, yy, in square pixels.  seen: means in camera axes."""
    x, y, z = seen.unbind(-1)
    size = torch.tensor(camera.size_px)
    far = BEYOND * torch.maximum(size - camera.principal_px, camera.principal_px) / camera.focal_px
    u, v = (x / z).clamp(-far[0], far[0]), (y / z).clamp(-far[1], far[1])
    fx, fy = camera.focal_px
    zero = torch.zeros_like(z)
    J = torch.stack([fx / z, zero, -fx * u / z, zero, fy / z, -fy * v / z], -1).view(-1, 2, 3)
    C = rotation_of(quaternion) * log_scale.exp()[:, None, :]
    M = J @ (camera.R_local_camera.T @ C)
    xx, xy, yy = (M[:, 0] * M[:, 0]).sum(-1), (M[:, 0] * M[:, 1]).sum(-1), (M[:, 1] * M[:, 1]).sum(-1)
    return torch.stack([xx + LOW_PASS, xy, yy + LOW_PASS], -1)


def rotation_of(quaternion: Float[Tensor, "n 4"]) -> Float[Tensor, "n 3 3"]:
    """Rotation matrices of quaternions w, x, y, z of any length."""
    w, x, y, z = F.normalize(quaternion, dim=-1).unbind(-1)
    rows = [
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ]  # fmt: skip
    return torch.stack(rows, -1).view(-1, 3, 3)


def _boxes(
    mean: Float[Tensor, "v 2"], xx: Float[Tensor, " v"], yy: Float[Tensor, " v"], camera: Pinhole
) -> Int[Tensor, "v 4"]:
    """Columns and rows whose pixel centres lie within `REACH` standard deviations of the means."""
    boxes = []
    for k, variance in enumerate((xx, yy)):
        reach = REACH * variance.sqrt()
        first = (mean[:, k] - reach - 0.5).ceil().clamp(0, camera.size_px[k])
        end = (mean[:, k] + reach - 0.5).floor().add(1).clamp(0, camera.size_px[k])
        boxes += [first, end]
    return torch.stack(boxes, -1).int()
