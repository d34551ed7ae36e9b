"""Encodings: the IPE is the expectation of the positional encoding, the harmonics are orthonormal."""

import numpy as np
import torch

from plnerf.field.encodings import (
    integrated_positional_encoding,
    positional_encoding,
    spherical_harmonics,
)


def test_positional_encoding_is_sines_then_cosines_octave_by_octave() -> None:
    x = torch.tensor([[0.3, -1.2]], dtype=torch.float64)
    found = positional_encoding(x, 3)[0].numpy()
    angles = np.array([0.3, -1.2, 0.6, -2.4, 1.2, -4.8])
    np.testing.assert_allclose(found, [*np.sin(angles), *np.cos(angles)], atol=1e-12)


def test_ipe_is_the_expected_positional_encoding() -> None:
    """The expectation by Gauss-Hermite quadrature over each coordinate, and by drawing samples."""
    generator = torch.Generator().manual_seed(0)
    mean = torch.randn(6, 3, generator=generator, dtype=torch.float64)
    variance = torch.rand(6, 3, generator=generator, dtype=torch.float64) * 0.3
    found = integrated_positional_encoding(mean, variance, 4)
    nodes, weights = np.polynomial.hermite_e.hermegauss(100)
    weights = torch.from_numpy(weights / weights.sum())
    samples = mean + variance.sqrt() * torch.from_numpy(nodes)[:, None, None]
    expected = (weights[:, None, None] * positional_encoding(samples, 4)).sum(0)
    torch.testing.assert_close(found, expected, atol=1e-10, rtol=0)
    noise = torch.randn(100_000, 6, 3, generator=generator, dtype=torch.float64)
    drawn = positional_encoding(mean + variance.sqrt() * noise, 4).mean(0)
    torch.testing.assert_close(found, drawn, atol=0.015, rtol=0)


def test_ipe_of_a_point_is_its_positional_encoding() -> None:
    x = torch.randn(2, 5, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    torch.testing.assert_close(
        integrated_positional_encoding(x, torch.zeros_like(x), 6), positional_encoding(x, 6)
    )


def test_ipe_forgets_octaves_finer_than_the_frustum() -> None:
    """Octave k of a Gaussian of variance v keeps exp(-4^k v / 2); a huge one keeps nothing, finitely."""
    mean = torch.full((1, 3), 0.7)
    fade = integrated_positional_encoding(mean, torch.full((1, 3), 0.25), 8).unflatten(-1, (2, 8, 3))
    size = fade.square().sum(1).sqrt()[0, :, 0]  # of sine and cosine: exp(-4^k v / 2)
    torch.testing.assert_close(size, torch.exp(-0.125 * 4.0 ** torch.arange(8)))
    assert not integrated_positional_encoding(mean, torch.full((1, 3), 1e30), 8).any()


def sphere() -> tuple[torch.Tensor, torch.Tensor]:
    """Points and weights that integrate polynomials up to degree 15 over the unit sphere exactly."""
    z, wz = np.polynomial.legendre.leggauss(8)
    angle = np.arange(16) * 2 * np.pi / 16
    r = np.sqrt(1 - z**2)
    points = [(a * np.cos(p), a * np.sin(p), b) for a, b in zip(r, z, strict=True) for p in angle]
    return torch.tensor(points), torch.from_numpy(np.repeat(wz, 16) * 2 * np.pi / 16)


def test_spherical_harmonics_are_orthonormal() -> None:
    points, weights = sphere()
    values = spherical_harmonics(points)
    gram = values.T @ (weights[:, None] * values)
    torch.testing.assert_close(gram, torch.eye(16, dtype=torch.float64), atol=1e-7, rtol=0)


def test_spherical_harmonics_of_a_degree_depend_on_the_angle_alone() -> None:
    """Addition theorem: sum_m Y_lm(a) Y_lm(b) = (2l + 1)/(4 pi) P_l(a.b); degrees lie in order."""
    points, _ = sphere()
    values = spherical_harmonics(points)
    cosine = (points @ points.T).numpy()
    for degree in range(4):
        mine = values[:, degree**2 : (degree + 1) ** 2]
        legendre = np.polynomial.legendre.Legendre.basis(degree)(cosine)
        np.testing.assert_allclose(mine @ mine.T, (2 * degree + 1) / (4 * np.pi) * legendre, atol=1e-7)
