"""The contraction: invertible, bounded, monotone; its Jacobian is that of finite differences and of sampling.

Points *between the ball and the cube* (L2 norm above 1, L-infinity norm below) are tested apart: a mask by
the wrong norm goes wrong there alone.
"""

import numpy as np
import pytest
import torch
from tests.support import numpy_reference
from torch import Tensor

from plnerf.rays.contraction import (
    ball_sizes,
    clamp_frustums,
    contract,
    contract_frustums,
    jacobian,
    pull_back,
    uncontract,
)
from plnerf.rays.frustums import Frustums

FACTORS = pytest.mark.parametrize("factors", [(1.0, 1.0, 1.0), (0.4, 2.0, 1.5)], ids=str)


def random_directions(n: int, seed: int) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.nn.functional.normalize(torch.randn(n, 3, generator=generator, dtype=torch.float64), dim=-1)


def points(where: str) -> Tensor:
    """(n, 3) float64 points of a region, away from the cube's faces and, unless said so, from ties."""
    generator = torch.Generator().manual_seed(0)
    if where == "ties":  # both sides of |x_0| = |x_1|, of either sign
        base = torch.tensor([[2.0, 2.0, 0.3], [-5.0, 5.0, 1.0], [3.0, -1.0, -3.0]], dtype=torch.float64)
        step = torch.tensor([1e-3, 0.0, 0.0], dtype=torch.float64)
        return torch.cat([base + step, base - step])
    x = torch.rand(20000, 3, generator=generator, dtype=torch.float64) * 2 - 1
    if where == "outside":
        x = x * torch.exp(torch.rand(len(x), 1, generator=generator, dtype=torch.float64) * 5)
    inf, two = x.abs().amax(-1), x.norm(dim=-1)
    top = x.abs().topk(2, -1).values
    keep = {
        "inside the ball": two < 0.99,
        "between ball and cube": (two > 1.01) & (inf < 0.99),
        "outside": (inf > 1.01) & ((top[:, 0] - top[:, 1]) > 1e-2),
    }[where]
    return x[keep][:200]


REGIONS = pytest.mark.parametrize("where", ["inside the ball", "between ball and cube", "outside", "ties"])


def gaussians(mean: Tensor, deviation: float, seed: int = 1) -> Frustums:
    """Frustums with the given means, of random directions and of two different deviations."""
    generator = torch.Generator().manual_seed(seed)
    scale = mean.abs().amax(-1).clamp_min(1) * deviation
    var_t, var_r = ((0.3 + torch.rand(2, len(mean), generator=generator, dtype=torch.float64)) * scale) ** 2
    return Frustums(mean, random_directions(len(mean), seed), var_t, var_r)


@REGIONS
def test_contraction_is_the_equation(where: str) -> None:
    x = points(where)
    truth = np.stack([numpy_reference.contract(point) for point in x.numpy()])
    np.testing.assert_allclose(contract(x).numpy(), truth, rtol=1e-14)


@REGIONS
def test_uncontract_is_the_inverse(where: str) -> None:
    x = points(where)
    torch.testing.assert_close(uncontract(contract(x)), x)
    y = x / x.abs().amax() * 1.9
    torch.testing.assert_close(contract(uncontract(y)), y)


@pytest.mark.parametrize("where", ["inside the ball", "between ball and cube"])
def test_nothing_moves_inside_the_cube(where: str) -> None:
    x = points(where)
    assert torch.equal(contract(x), x)
    assert torch.equal(jacobian(x), torch.eye(3, dtype=x.dtype).expand(len(x), 3, 3))


def test_contraction_is_bounded_and_monotone_over_30_decades() -> None:
    distance = torch.logspace(-15, 15, 301, dtype=torch.float64)
    for direction in random_directions(20, seed=2):
        m = contract(distance[:, None] * direction).abs().amax(-1)
        assert bool((m.diff() >= 0).all())
        assert bool((m[distance < 1e6].diff() > 0).all())
        assert float(m[-1]) <= 2
        assert float(m[-1]) == pytest.approx(2, abs=1e-12)


@REGIONS
def test_jacobian_is_that_of_autograd_and_of_finite_differences(where: str) -> None:
    x = points(where)
    by_autograd = torch.func.vmap(torch.func.jacrev(contract))(x)
    torch.testing.assert_close(jacobian(x), by_autograd)
    step = 1e-6
    columns = []
    for axis in torch.eye(3, dtype=x.dtype) * step:
        columns.append((contract(x + axis) - contract(x - axis)) / (2 * step))
    torch.testing.assert_close(jacobian(x), torch.stack(columns, -1), atol=1e-7, rtol=0)


@REGIONS
def test_pulling_a_gradient_back_is_the_transposed_jacobian(where: str) -> None:
    x = points(where)
    gradient = torch.randn(x.shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    torch.testing.assert_close(pull_back(gradient, x), (jacobian(x).mT @ gradient[..., None])[..., 0])


@FACTORS
@REGIONS
def test_variance_is_the_diagonal_of_the_full_product(
    where: str, factors: tuple[float, float, float]
) -> None:
    """diag(J A Sigma A J^T), formed with matrices."""
    frustums = gaussians(points(where), 0.05)
    A = torch.diag(torch.tensor(factors, dtype=torch.float64))
    J = jacobian(frustums.mean @ A)
    full = J @ A @ frustums.covariance() @ A @ J.mT
    mean, variance = contract_frustums(frustums, factors)
    torch.testing.assert_close(mean, contract(frustums.mean @ A))
    torch.testing.assert_close(variance, full.diagonal(dim1=-2, dim2=-1), rtol=1e-9, atol=1e-15)


@FACTORS
@REGIONS
def test_balls_have_the_volume_of_the_full_product(where: str, factors: tuple[float, float, float]) -> None:
    """sigma^6 = det(J A Sigma A J^T), formed with matrices."""
    frustums = gaussians(points(where), 0.05)
    A = torch.diag(torch.tensor(factors, dtype=torch.float64))
    for contraction in (True, False):
        J = jacobian(frustums.mean @ A) if contraction else torch.eye(3, dtype=torch.float64)
        truth = torch.linalg.det(J @ A @ frustums.covariance() @ A @ J.mT)
        bounded = (contract_frustums if contraction else clamp_frustums)(frustums, factors)[0]
        found = ball_sizes(frustums.var_t, frustums.var_r, bounded, factors, contraction)
        torch.testing.assert_close(found**6, truth, rtol=1e-8, atol=0)


@FACTORS
def test_variance_is_that_of_samples(factors: tuple[float, float, float]) -> None:
    """Push a small frustum's Gaussian through stretch and contraction, sample by sample."""
    x = torch.cat([points(where)[:3] for where in ("inside the ball", "between ball and cube", "outside")])
    # Stretching must not carry a point over the kinks at the cube's face or at a tie.
    frustums = gaussians(x / torch.tensor(factors), 1e-3)
    noise = torch.randn(100_000, 1, 3, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    root = torch.linalg.cholesky(frustums.covariance())
    samples = frustums.mean + (root @ noise[..., None])[..., 0]
    moved = contract(samples * torch.tensor(factors))
    mean, variance = contract_frustums(frustums, factors)
    torch.testing.assert_close(variance, moved.var(0), rtol=0.03, atol=0)
    torch.testing.assert_close(mean, moved.mean(0), rtol=0, atol=5e-5)


@FACTORS
def test_clamped_frustums_keep_their_stretched_variance(factors: tuple[float, float, float]) -> None:
    frustums = gaussians(points("outside"), 0.05)
    A = torch.diag(torch.tensor(factors, dtype=torch.float64))
    mean, variance = clamp_frustums(frustums, factors)
    torch.testing.assert_close(variance, (A @ frustums.covariance() @ A).diagonal(dim1=-2, dim2=-1))
    torch.testing.assert_close(mean, (frustums.mean @ A).clip(-2, 2))
    assert float(mean.abs().max()) == 2


def test_outputs_and_gradients_are_finite_over_the_float_range() -> None:
    size = torch.cat([torch.zeros(1), torch.logspace(-38, 38, 153)])
    x = (size[:, None, None] * torch.tensor([[1.0, 0.5, -0.2], [-1.0, 1.0, 1.0], [0.0, 0.0, 1.0]])).flatten(
        0, 1
    )
    x.requires_grad_()
    direction = torch.tensor([0.6, 0.0, -0.8]).expand_as(x)
    variance = torch.full((len(x),), 1e30)
    mean, spread = contract_frustums(Frustums(x, direction, variance, variance / 7), (0.5, 2.0, 2.0))
    outputs = [contract(x), jacobian(x), mean, spread]
    assert all(bool(out.isfinite().all()) for out in outputs)
    assert float(contract(x).detach().abs().max()) <= 2
    for out in outputs:
        (gradient,) = torch.autograd.grad(out.sum(), x, retain_graph=True)
        assert bool(gradient.isfinite().all())
