"""The trainable grid over the unit cube, whatever the batch's shape."""

import pytest
import torch

from plnerf.field.hashgrid import HashGrid
from plnerf.ops.backends import Backend
from plnerf.ops.dispatch import hash_encode
from plnerf.ops.grid import GridShape

SHAPE = GridShape(3, 4, 16, 2, 9, "cubic")


@pytest.mark.parametrize("backend", ["torch", "numba"])
@pytest.mark.parametrize("batch", [(), (5,), (2, 3), (2, 0)], ids=str)
def test_encoding_is_that_of_the_point(backend: Backend, batch: tuple[int, ...]) -> None:
    grid = HashGrid(SHAPE, backend, torch.Generator().manual_seed(0))
    x = torch.rand(*batch, 3, generator=torch.Generator().manual_seed(1))
    found = grid(x)
    assert found.shape == (*batch, SHAPE.width)
    truth = hash_encode(x.reshape(-1, 3), grid.table, SHAPE, "torch")
    torch.testing.assert_close(found.reshape(-1, SHAPE.width), truth, atol=1e-9, rtol=0)


def test_the_cube_s_corners_are_the_grid_s_corners() -> None:
    grid = HashGrid(SHAPE, "torch", torch.Generator().manual_seed(0))
    corners = grid(torch.tensor([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]))
    first, last = grid.table[0], grid.table[5**3 - 1]  # of the coarsest level, 4 cells wide and dense
    torch.testing.assert_close(corners[:, :2], torch.stack([first, last]))


def test_the_table_starts_small_and_is_a_function_of_its_generator() -> None:
    tables = [
        HashGrid(SHAPE, "torch", torch.Generator().manual_seed(seed)).table.detach() for seed in (0, 0, 1)
    ]
    assert torch.equal(tables[0], tables[1])
    assert not torch.equal(tables[0], tables[2])
    assert float(tables[0].abs().max()) <= 1e-4
    assert float(tables[0].std()) == pytest.approx(2e-4 / 12**0.5, rel=0.05)
    assert float(tables[0].mean().abs()) < 1e-5


def test_damping_is_the_share_of_a_gaussian_within_a_cell() -> None:
    """Of a cell's length, around its middle: so it falls with the level and with the size, from 1 to 0."""
    grid = HashGrid(SHAPE, "torch", torch.Generator().manual_seed(0)).double()
    size = torch.logspace(-4, 1, 60, dtype=torch.float64)
    found = grid.damping(size)
    half = 1 / (2 * torch.tensor(SHAPE.resolutions, dtype=torch.float64))
    normal = torch.distributions.Normal(0, size[:, None])
    torch.testing.assert_close(found, normal.cdf(half) - normal.cdf(-half), rtol=1e-6, atol=1e-12)
    assert bool((found.diff(dim=0) <= 0).all())
    assert bool((found.diff(dim=1) <= 0).all())
    assert bool((found[0] == 1).all())
    assert float(found[-1].max()) < 0.02
    assert torch.equal(grid.damping(torch.zeros(2).double()), torch.ones(2, 3).double())


@pytest.mark.parametrize("backend", ["torch", "numba"])
def test_damped_features_are_those_of_points_times_their_level_s_factor(backend: Backend) -> None:
    grid = HashGrid(SHAPE, backend, torch.Generator().manual_seed(0)).double()
    x, cotangent = (torch.rand(4, 5, n, generator=torch.Generator().manual_seed(n)).double() for n in (3, 6))
    size = 10 ** (torch.rand(4, 5, generator=torch.Generator().manual_seed(2)).double() * 3 - 3)
    factor = grid.damping(size)
    expected = grid(x).unflatten(-1, (3, 2)) * factor[..., None]
    torch.testing.assert_close(grid(x, size), expected.flatten(-2))
    (found,) = torch.autograd.grad((grid(x, size) * cotangent).sum(), grid.table)
    (truth,) = torch.autograd.grad((expected.flatten(-2) * cotangent).sum(), grid.table)
    torch.testing.assert_close(found, truth)
    assert torch.equal(grid(x, torch.zeros_like(size)), grid(x))


def test_the_table_is_trained() -> None:
    grid = HashGrid(SHAPE, "numba", torch.Generator().manual_seed(0))
    x = torch.rand(50, 3, generator=torch.Generator().manual_seed(1))
    target = x.sum(-1, keepdim=True)
    optimizer = torch.optim.Adam(grid.parameters(), lr=0.1)
    losses = []
    for _ in range(30):
        loss = (grid(x).sum(-1, keepdim=True) - target).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    assert losses[-1] < 0.05 * losses[0]
