"""All of space in a cube: the L-infinity contraction.  Mip-NeRF 360 eq. 10, other norm (paper, fig. 19).

Letters: m = max_k |x_k|, reached at axis k (the first one where several tie: a set of measure zero).
    f(x) = x                       where m <= 1
    f(x) = (2 - 1/m) x / m         beyond; f maps all of space into [-2, 2]^3
    J = (2m - 1)/m^2 I  +  (2 - 2m)/m^3 sign(x_k) x e_k^T      beyond, I inside
"""

import math
from functools import cache

import torch
from jaxtyping import Float
from torch import Tensor

from plnerf.rays.frustums import Frustums


def axis_factors(factors: tuple[float, float, float], like: Float[Tensor, "..."]) -> Float[Tensor, "3"]:
    """A factor for each axis, of the type and on the device of a tensor."""
    return _constant(factors, like.dtype, like.device)


@cache
def _constant(values: tuple[float, ...], dtype: torch.dtype, device: torch.device) -> Tensor:
    """Copied to a device once: a CUDA graph cannot hold the copy, and each would wait for the device."""
    with torch.inference_mode(False):  # it may be used in training later
        return torch.tensor(values, dtype=dtype, device=device)


def contract(x: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n 3"]:
    """f(x), the identity inside [-1, 1]^3 and bounded by [-2, 2]^3."""
    m = x.abs().amax(-1, keepdim=True).clamp_min(1)
    # x/m first, so that no finite x overflows.
    return (2 - 1 / m) * (x / m)


def uncontract(y: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n 3"]:
    """The inverse of `contract` on the open cube (-2, 2)^3: with m' = max|y_k| > 1, m = 1/(2 - m')."""
    m = y.abs().amax(-1, keepdim=True).clamp_min(1)
    return y / (m * (2 - m))


def jacobian_terms(
    x: Float[Tensor, "*n 3"],
) -> tuple[Float[Tensor, "*n"], Float[Tensor, "*n 3"], Float[Tensor, "*n 3"]]:
    """J = a I + b e_k^T: the number a, the vector b, and e_k as a one-hot vector; a = 1, b = 0 inside."""
    magnitude, k = x.abs().max(-1)
    one_hot = torch.nn.functional.one_hot(k, 3).to(x.dtype)
    m = magnitude.clamp_min(1)
    a = (2 - 1 / m) / m
    sign = (x * one_hot).sum(-1).sign()
    b = ((2 / m - 2) / m * sign)[..., None] * (x / m[..., None])
    return a, b, one_hot


def jacobian(x: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n 3 3"]:
    """J in full, for checks and for normals."""
    a, b, one_hot = jacobian_terms(x)
    eye = torch.eye(3, dtype=x.dtype, device=x.device)
    return a[..., None, None] * eye + b[..., :, None] * one_hot[..., None, :]


def pull_back(gradient: Float[Tensor, "*n 3"], x: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n 3"]:
    """J^T g: the gradient by x of a function whose gradient by f(x) is g."""
    a, b, one_hot = jacobian_terms(x)
    return a[..., None] * gradient + one_hot * (b * gradient).sum(-1, keepdim=True)


def contract_frustums(
    frustums: Frustums, factors: tuple[float, float, float] = (1.0, 1.0, 1.0)
) -> tuple[Float[Tensor, "*n 3"], Float[Tensor, "*n 3"]]:
    """Mean and variances, diag(J A Sigma A J^T), of frustums stretched by A = diag(factors) and contracted.

    A span is much longer than it is wide: stretching across the line spends the cube's cells where the wires
    are.  With Sigma' = A Sigma A = (var_t - var_r) d' d'^T + var_r A^2, d' = A d, and J = a I + b e_k^T:
        (J Sigma' J^T)_ii = a^2 Sigma'_ii + 2 a b_i Sigma'_ik + b_i^2 Sigma'_kk
    so that no 3x3 matrix is formed.  Mip-NeRF 360 eq. 9 (linearisation at the mean).
    """
    stretch = axis_factors(factors, frustums.mean)
    mean, direction = frustums.mean * stretch, frustums.direction * stretch
    a, b, one_hot = jacobian_terms(mean)
    excess = (frustums.var_t - frustums.var_r)[..., None]
    across = frustums.var_r[..., None] * stretch**2
    direction_k = (direction * one_hot).sum(-1, keepdim=True)
    diagonal = excess * direction**2 + across
    column_k = excess * direction * direction_k + across * one_hot
    corner = (diagonal * one_hot).sum(-1, keepdim=True)
    scale = a[..., None]
    variance = scale**2 * diagonal + 2 * scale * b * column_k + b**2 * corner
    return contract(mean), variance.clamp_min(0)  # rounding may leave -1e-12 where the true value is 0


def ball_sizes(
    var_t: Float[Tensor, "*n"],
    var_r: Float[Tensor, "*n"],
    bounded: Float[Tensor, "*n 3"],
    factors: tuple[float, float, float],
    contraction: bool,
) -> Float[Tensor, "*n"]:
    """Standard deviations of balls of the same volume as stretched and contracted frustums.

        sigma^6 = det(J A Sigma A J^T) = det(J)^2 det(A)^2 var_t var_r^2,     det J = m'^2 (2 - m')^4
    where m' = max |f_k| of the contracted mean `bounded`, 1 inside: det J = a^2 (a + b_k) with a = m'/m,
    a + b_k = 1/m^2 and 1/m = 2 - m'.  Zip-NeRF, section 2 (a Gaussian's size is that of its Jacobian's
    determinant).  Without contraction J = I.
    """
    size = math.prod(factors) ** (1 / 3) * var_t ** (1 / 6) * var_r ** (1 / 3)
    if not contraction:
        return size
    m = bounded.abs().amax(-1).clamp_min(1)
    return size * (m * (2 - m) ** 2) ** (2 / 3)


def clamp_frustums(
    frustums: Frustums, factors: tuple[float, float, float] = (1.0, 1.0, 1.0)
) -> tuple[Float[Tensor, "*n 3"], Float[Tensor, "*n 3"]]:
    """Mean and variances without contraction: what lies beyond [-2, 2]^3 is moved onto the cube's faces."""
    stretch = axis_factors(factors, frustums.mean)
    excess = (frustums.var_t - frustums.var_r)[..., None]
    variance = excess * (frustums.direction * stretch) ** 2 + frustums.var_r[..., None] * stretch**2
    return (frustums.mean * stretch).clamp(-2, 2), variance.clamp_min(0)
