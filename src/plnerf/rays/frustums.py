"""Conical frustums as Gaussians.  Mip-NeRF, section 3.1 and appendix A.

Letters: a cone of radius r' per unit distance, cut at t0 < t1; t_m = (t0 + t1)/2, t_h = (t1 - t0)/2.
The Gaussian has a mean on the axis, variance var_t along it and var_r across it:
    Sigma = var_t d d^T + var_r (I - d d^T)      with |d| = 1.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from plnerf.rays.rays import Rays


@dataclass(frozen=True)
class Frustums:
    """Gaussians of the intervals of rays, in the scene frame."""

    mean: Float[Tensor, "*n 3"]
    direction: Float[Tensor, "*n 3"]
    var_t: Float[Tensor, "*n"]
    var_r: Float[Tensor, "*n"]

    def __getitem__(self, index: slice) -> "Frustums":
        return Frustums(self.mean[index], self.direction[index], self.var_t[index], self.var_r[index])

    def covariance(self) -> Float[Tensor, "*n 3 3"]:
        """Sigma in full."""
        along = self.direction[..., :, None] * self.direction[..., None, :]
        across = torch.eye(3, dtype=along.dtype, device=along.device) - along
        return self.var_t[..., None, None] * along + self.var_r[..., None, None] * across


def frustum_moments(
    t0: Float[Tensor, "*n"], t1: Float[Tensor, "*n"], radius: Float[Tensor, "*n"]
) -> tuple[Float[Tensor, "*n"], Float[Tensor, "*n"], Float[Tensor, "*n"]]:
    """Mean distance and variances (t_mean, var_t, var_r) of a uniform conical frustum.  Mip-NeRF eq. 7.

    t_mean = t_m + 2 t_m t_h^2 / (3 t_m^2 + t_h^2)
    var_t  = t_h^2/3 - (4/15) t_h^4 (12 t_m^2 - t_h^2) / (3 t_m^2 + t_h^2)^2
    var_r  = r'^2 (t_m^2/4 + (5/12) t_h^2 - (4/15) t_h^4 / (3 t_m^2 + t_h^2))
    """
    middle, half = (t0 + t1) / 2, (t1 - t0) / 2
    # Powers of the ratio h = t_h/t_m stay in range where t_h^4 would underflow or overflow in float32.
    ratio2 = (half / middle.clamp_min(torch.finfo(middle.dtype).tiny)) ** 2
    below = 3 + ratio2
    t_mean = middle * (1 + 2 * ratio2 / below)
    var_t = half**2 * (1 / 3 - (4 / 15) * ratio2 * (12 - ratio2) / below**2)
    var_r = (radius * middle) ** 2 * (1 / 4 + (5 / 12) * ratio2 - (4 / 15) * ratio2**2 / below)
    return t_mean, var_t, var_r


def ray_frustums(rays: Rays, t: Float[Tensor, "r E"]) -> Frustums:
    """Gaussians of the E - 1 intervals between the E edges t along every ray; shapes (r, E-1)."""
    t_mean, var_t, var_r = frustum_moments(
        t[:, :-1], t[:, 1:], rays.radius[:, None].expand(-1, t.shape[1] - 1)
    )
    mean = rays.origins[:, None] + t_mean[..., None] * rays.directions[:, None]
    return Frustums(mean, rays.directions[:, None].expand_as(mean), var_t, var_r)
