"""The trainable grid over the unit cube, whatever the batch's shape."""

import pytest
import torch

from plnerf.field.hashgrid import HashGrid
from plnerf.ops.dispatch import Backend, hash_encode
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
