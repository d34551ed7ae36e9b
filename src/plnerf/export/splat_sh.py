"""Real spherical harmonics as 3D Gaussian Splatting and KHR_gaussian_splatting have them, up to degree 2.

    colour(d) = 1/2 + sum_k Y_k(d) c_k        with the Condon-Shortley phase, orders m from -l to l

Letters: n directions (unit vectors from the camera to the Gaussian), K = (degree + 1)^2 functions.
"""

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

Y_0 = 0.28209479177387814
"""The harmonic of degree 0, a constant."""
_Y_1, _Y_2, _Y_20, _Y_22 = 0.4886025119029199, 1.092548430592079, 0.31539156525252, 0.5462742152960395
MAX_DEGREE = 2


def sh_basis(direction: Float[Tensor, "n 3"], degree: int) -> Float[Tensor, "n K"]:
    """The K functions at unit directions."""
    x, y, z = direction.unbind(-1)
    columns = [torch.full_like(x, Y_0)]
    if degree >= 1:
        columns += [-_Y_1 * y, _Y_1 * z, -_Y_1 * x]
    if degree >= 2:
        columns += [
            _Y_2 * x * y, -_Y_2 * y * z, _Y_20 * (2 * z * z - x * x - y * y), -_Y_2 * x * z,
            _Y_22 * (x * x - y * y),
        ]  # fmt: skip
    return torch.stack(columns, -1)


def sh_colour(
    sh: Float[Tensor, "n K 3"], direction: Float[Tensor, "n 3"], degree: int
) -> Float[Tensor, "n 3"]:
    """Colours seen along unit directions, not below 0."""
    basis = sh_basis(direction, degree)
    return (0.5 + (basis[:, :, None] * sh[:, : basis.shape[1]]).sum(1)).clamp_min(0)


def degree_of(count: int) -> int:
    """The degree of K functions."""
    return int(count**0.5) - 1


def sh_rotation(R: Float[np.ndarray, "3 3"], degree: int) -> Float[np.ndarray, "K K"]:
    """The matrix M with colour_new(R d) = colour(d) where c_new = M c.

    Rotated harmonics are sums of harmonics of the same degree, so that a fit to more directions than
    functions is exact.
    """
    direction = torch.from_numpy(np.random.default_rng(0).normal(size=(64, 3)))
    direction = direction / direction.norm(dim=1, keepdim=True)
    turned = sh_basis(direction @ torch.from_numpy(R.T.copy()), degree).numpy()
    found: Float[np.ndarray, "K K"] = np.linalg.lstsq(turned, sh_basis(direction, degree).numpy())[0]
    return found
