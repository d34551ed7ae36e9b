"""Spherical harmonics: those of the glTF extension, orthonormal, and rotated with what they colour."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from plnerf.export.splat_sh import sh_basis, sh_colour, sh_rotation


def directions(count: int = 500) -> torch.Tensor:
    found = torch.randn(count, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    return found / found.norm(dim=1, keepdim=True)


def test_they_are_those_of_the_extension() -> None:
    """KHR_gaussian_splatting, "Calculating color from Spherical Harmonics"."""
    x, y, z = (d := directions()).T.numpy()
    expected = np.stack([
        0.2820947917738781 + 0 * x,
        y * -0.4886025119029199, z * 0.4886025119029199, x * -0.4886025119029199,
        x * y * 1.092548430592079, y * z * -1.092548430592079,
        (2 * z**2 - x**2 - y**2) * 0.3153915652525200,
        x * z * -1.092548430592079, (x**2 - y**2) * 0.5462742152960395,
    ], 1)  # fmt: skip
    np.testing.assert_allclose(sh_basis(d, 2).numpy(), expected, atol=1e-12)


def test_they_are_orthonormal() -> None:
    z, w = np.polynomial.legendre.leggauss(6)
    phi = np.arange(12) * np.pi / 6
    r = np.sqrt(1 - z**2)
    d = np.stack([np.outer(r, np.cos(phi)), np.outer(r, np.sin(phi)), np.outer(z, np.ones(12))], -1).reshape(
        -1, 3
    )
    basis, area = sh_basis(torch.from_numpy(d), 2).numpy(), np.repeat(w, 12) * np.pi / 6
    np.testing.assert_allclose(basis.T @ (area[:, None] * basis), np.eye(9), atol=1e-12)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_rotated_coefficients_give_the_same_colours(degree: int) -> None:
    random = np.random.default_rng(0)
    R = Rotation.random(random_state=1).as_matrix()
    c, d = random.normal(size=((degree + 1) ** 2, 3)) * 0.1, directions()
    turned = torch.from_numpy(sh_rotation(R, degree) @ c)
    before = sh_colour(torch.from_numpy(c).expand(len(d), -1, -1), d, degree)
    after = sh_colour(turned.expand(len(d), -1, -1), d @ torch.from_numpy(R.T.copy()), degree)
    torch.testing.assert_close(after, before, atol=1e-10, rtol=1e-10)
