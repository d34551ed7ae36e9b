"""The contraction into a ball: continuous, bounded, its Jacobian that of autograd."""

import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.autograd.functional import jacobian

from plnerf.rays.ball import contract_ball, contract_frustums_ball
from plnerf.rays.frustums import Frustums


def some_points(seed: int) -> Tensor:
    """From well inside to far outside of the unit ball."""
    generator = torch.Generator().manual_seed(seed)
    points = torch.randn(20, 3, generator=generator, dtype=torch.float64)
    return points * torch.logspace(-2, 4, 20, dtype=torch.float64)[:, None]


@given(st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_all_of_space_goes_into_the_ball_in_its_direction(seed: int) -> None:
    x = some_points(seed)
    y = contract_ball(x)
    inside = x.norm(dim=-1) <= 1
    assert torch.equal(y[inside], x[inside]) and (y.norm(dim=-1) < 2).all()
    torch.testing.assert_close(
        torch.nn.functional.normalize(y, dim=-1), torch.nn.functional.normalize(x, dim=-1)
    )


def test_by_hand() -> None:
    x = torch.tensor([[2.0, 0.0, 0.0], [0.0, 0.0, -4.0], [0.6, 0.8, 0.0]])
    torch.testing.assert_close(
        contract_ball(x), torch.tensor([[1.5, 0.0, 0.0], [0.0, 0.0, -1.75], [0.6, 0.8, 0.0]])
    )


@given(st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_variances_are_those_of_the_jacobian(seed: int) -> None:
    x = some_points(seed)
    generator = torch.Generator().manual_seed(seed + 1)
    d = torch.nn.functional.normalize(torch.randn(20, 3, generator=generator, dtype=torch.float64), dim=-1)
    var_t, var_r = torch.rand(2, 20, generator=generator, dtype=torch.float64)
    frustums = Frustums(x, d, var_t, var_r)
    mean, variance = contract_frustums_ball(frustums)
    torch.testing.assert_close(mean, contract_ball(x))
    for k in range(20):
        J = jacobian(contract_ball, x[k])
        assert isinstance(J, Tensor)
        wanted = (J @ frustums.covariance()[k] @ J.T).diagonal()
        torch.testing.assert_close(variance[k], wanted, rtol=1e-9, atol=1e-14)
