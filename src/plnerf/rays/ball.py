"""All of space in a ball: the contraction of Mip-NeRF 360, eq. 10, and what it makes of frustums.

Letters: r = |x|, e = x / r; d the direction of a frustum of variances var_t along and var_r across it.
    f(x) = x                       where r <= 1
    f(x) = (2 - 1/r) e             beyond; f maps all of space into the ball of radius 2
    J = a (I - e e^T) + r^-2 e e^T      with a = (2 - 1/r)/r beyond, I inside
"""

import torch
from jaxtyping import Float
from torch import Tensor

from plnerf.rays.frustums import Frustums


def contract_ball(x: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n 3"]:
    """f(x), the identity inside the unit ball and bounded by the ball of radius 2."""
    r = x.norm(dim=-1, keepdim=True).clamp_min(1)
    return (2 - 1 / r) * (x / r)


def contract_frustums_ball(frustums: Frustums) -> tuple[Float[Tensor, "*n 3"], Float[Tensor, "*n 3"]]:
    """Mean and variances, diag(J Sigma J^T), of contracted frustums.  Mip-NeRF 360 eq. 9.

    With Sigma = (var_t - var_r) d d^T + var_r I:
        (J Sigma J^T)_ii = (var_t - var_r) (J d)_i^2 + var_r (a^2 (1 - e_i^2) + r^-4 e_i^2)
    """
    r = frustums.mean.norm(dim=-1, keepdim=True).clamp_min(1)
    e = torch.where(r > 1, frustums.mean / r, 0)  # inside a = r = 1, and J = I for any e
    a, radial = (2 - 1 / r) / r, 1 / r**2
    d = frustums.direction
    Jd = a * d + (radial - a) * (e * d).sum(-1, keepdim=True) * e
    across = frustums.var_r[..., None]
    variance = (frustums.var_t[..., None] - across) * Jd**2 + across * (a**2 * (1 - e**2) + radial**2 * e**2)
    return contract_ball(frustums.mean), variance.clamp_min(0)
