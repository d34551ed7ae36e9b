"""Networks, the density's activation, the proposal field: made of the generator alone, finite, not stuck."""

import math

import pytest
import torch
from torch import nn

from plnerf.field.config import DensityConfig
from plnerf.field.density import DensityField
from plnerf.field.networks import density_activation, mlp
from plnerf.ops.grid import GridShape


def test_an_mlp_has_its_widths_and_no_last_activation() -> None:
    network = mlp([5, 7, 6, 2], torch.Generator().manual_seed(0))
    linears = [layer for layer in network if isinstance(layer, nn.Linear)]
    assert [(layer.in_features, layer.out_features) for layer in linears] == [(5, 7), (7, 6), (6, 2)]
    assert [type(layer) for layer in network] == [nn.Linear, nn.ReLU, nn.Linear, nn.ReLU, nn.Linear]


def test_an_mlp_keeps_the_size_of_its_input() -> None:
    """He's point: through layers with ReLU the mean square stays; biases start at zero."""
    network = mlp([256] * 7, torch.Generator().manual_seed(0))
    x = torch.randn(200, 256, generator=torch.Generator().manual_seed(1))
    out = network(x).square().mean().item()
    assert 1.0 < out < 4.0  # 2 after the last layer, whose output is not halved by a ReLU
    assert all(not layer.bias.any() for layer in network if isinstance(layer, nn.Linear))


def test_an_mlp_is_a_function_of_its_generator() -> None:
    """The global random state neither matters nor moves."""
    networks = []
    for global_seed, seed in [(0, 5), (1, 5), (0, 6)]:
        torch.manual_seed(global_seed)
        before = torch.get_rng_state()
        networks.append(mlp([3, 4, 2], torch.Generator().manual_seed(seed)).state_dict())
        assert torch.equal(before, torch.get_rng_state())
    a, b, c = networks
    assert all(torch.equal(a[name], b[name]) for name in a)
    assert not torch.equal(a["0.weight"], c["0.weight"])


def test_density_is_the_exponential() -> None:
    x = torch.linspace(-20, 14.9, 50, dtype=torch.float64, requires_grad=True)
    torch.testing.assert_close(density_activation(x), x.exp())
    assert torch.autograd.gradcheck(density_activation, x.detach()[10:].requires_grad_(), rtol=1e-4)


def test_density_and_gradient_are_finite_over_the_float_range() -> None:
    size = torch.logspace(-30, 38, 69)
    x = torch.cat([-size, torch.zeros(1), size]).requires_grad_()
    density = density_activation(x)
    density.sum().backward()
    assert x.grad is not None
    assert bool(density.isfinite().all())
    assert bool((density >= 0).all())
    assert bool(x.grad.isfinite().all())
    assert float(density.detach().max()) == pytest.approx(math.exp(15))
    assert bool((x.grad[x > 15] > 0).all())  # what became too dense finds its way back


@pytest.mark.parametrize("batch", [(), (4,), (2, 3)], ids=str)
def test_a_proposal_field_is_a_function_of_the_point(batch: tuple[int, ...]) -> None:
    """Whatever the batch's shape; positive, and about 1 in a new field."""
    config = DensityConfig(GridShape(3, 4, 16, 2, 10))
    field = DensityField(config, "torch", torch.Generator().manual_seed(0))
    x = torch.rand(*batch, 3, generator=torch.Generator().manual_seed(1))
    density = field(x)
    assert density.shape == batch
    torch.testing.assert_close(density.reshape(-1), torch.stack([field(p) for p in x.reshape(-1, 3)]))
    torch.testing.assert_close(density, torch.ones(batch), atol=0.01, rtol=0)
