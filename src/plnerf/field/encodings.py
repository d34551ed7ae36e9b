"""Encodings of positions and directions.  NeRF 2020 eq. 4, Mip-NeRF eq. 13 and 14.

Letters: k the octave, 0 <= k < K; x a coordinate, mu and v the mean and variance of a Gaussian coordinate.
Octaves are 2^k, without pi, as in Mip-NeRF.
"""

import torch
from jaxtyping import Float
from torch import Tensor


def _octaves(x: Tensor, count: int) -> Tensor:
    return torch.exp2(torch.arange(count, dtype=x.dtype, device=x.device))


def positional_encoding(x: Float[Tensor, "*n d"], octaves: int) -> Float[Tensor, "*n e"]:
    """(sin 2^k x, cos 2^k x) for every coordinate and octave; e = 2 d K.  NeRF 2020 eq. 4, without pi."""
    scaled = (x[..., None, :] * _octaves(x, octaves)[:, None]).flatten(-2)
    return torch.cat([scaled.sin(), scaled.cos()], -1)


def integrated_positional_encoding(
    mean: Float[Tensor, "*n d"], variance: Float[Tensor, "*n d"], octaves: int
) -> Float[Tensor, "*n e"]:
    """The expected positional encoding of a Gaussian; e = 2 d K.  Mip-NeRF eq. 14.

    E[sin(2^k x)] = sin(2^k mu) exp(-4^k v / 2), likewise cos: octaves finer than the Gaussian fade out.
    """
    scale = _octaves(mean, octaves)[:, None]
    scaled = (mean[..., None, :] * scale).flatten(-2)
    fade = torch.exp(-0.5 * (variance[..., None, :] * scale**2).flatten(-2))
    return torch.cat([scaled.sin() * fade, scaled.cos() * fade], -1)


def spherical_harmonics(d: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n 16"]:
    """Real spherical harmonics of degree 0 to 3 of unit vectors, orthonormal on the sphere (nerfacto)."""
    x, y, z = d.unbind(-1)
    xx, yy, zz = x * x, y * y, z * z
    return torch.stack(
        [
            torch.full_like(x, 0.28209479177387814),
            0.4886025119029199 * y,
            0.4886025119029199 * z,
            0.4886025119029199 * x,
            1.0925484305920792 * x * y,
            1.0925484305920792 * y * z,
            0.31539156525252005 * (3 * zz - 1),
            1.0925484305920792 * x * z,
            0.5462742152960396 * (xx - yy),
            0.5900435899266435 * y * (3 * xx - yy),
            2.890611442640554 * x * y * z,
            0.4570457994644658 * y * (5 * zz - 1),
            0.3731763325901154 * z * (5 * zz - 3),
            0.4570457994644658 * x * (5 * zz - 1),
            1.445305721320277 * z * (xx - yy),
            0.5900435899266435 * x * (xx - 3 * yy),
        ],
        -1,
    )
