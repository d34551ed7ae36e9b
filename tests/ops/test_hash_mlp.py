"""The fused proposal network: its kernel is the reference, whatever the number of points and threads."""

from typing import Literal

import numba
import pytest
import torch
from torch import Tensor

from plnerf.ops import cpu_hash_mlp, reference
from plnerf.ops.cpu_hash_mlp import BLOCK
from plnerf.ops.grid import GridShape


def inputs(grid: GridShape, points: int, hidden: int, dtype: torch.dtype) -> tuple[Tensor, list[Tensor]]:
    """Points in and around the cube, and the table and weights."""
    generator = torch.Generator().manual_seed(points)

    def normal(*shape: int) -> Tensor:
        return torch.randn(shape, generator=generator, dtype=torch.float64).to(dtype)

    x = torch.rand(points, 3, generator=generator, dtype=torch.float64).to(dtype) * 1.4 - 0.2
    table = normal(grid.rows, grid.features)
    return x, [table, normal(hidden, grid.width), normal(hidden), normal(1, hidden), normal(1)]


@pytest.mark.slow
@pytest.mark.parametrize("points", [0, 1, BLOCK - 1, BLOCK, 5 * BLOCK + 3])
@pytest.mark.parametrize(
    ("features", "interpolation", "dtype", "tolerance"),
    [(2, "linear", torch.float32, 2e-5), (2, "cubic", torch.float64, 1e-12)],
    ids=str,
)
def test_kernel_is_the_reference(
    points: int,
    features: int,
    interpolation: Literal["linear", "cubic"],
    dtype: torch.dtype,
    tolerance: float,
) -> None:
    grid = GridShape(4, 3, 40, features, 9, interpolation)  # two dense levels, two hashed ones
    assert len(set(grid.dense)) == 2
    x, params = inputs(grid, points, 16, dtype)
    cotangent = torch.randn(points, generator=torch.Generator().manual_seed(1)).to(dtype)
    cotangent[: points // 2] = 0  # whole blocks without gradient are skipped
    found, truth = [], []
    for op, results in ((cpu_hash_mlp.hash_mlp, found), (reference.hash_mlp, truth)):
        table, *weights = [value.clone().requires_grad_() for value in params]
        out = op(x, table, grid, tuple(weights))
        results += [out.detach(), *torch.autograd.grad(out, [table, *weights], cotangent)]
    for a, b in zip(found, truth, strict=True):
        assert a.dtype == dtype
        scale = float(b.abs().max()) if b.numel() else 0.0
        torch.testing.assert_close(a, b, atol=tolerance * scale, rtol=0)


def test_results_do_not_depend_on_threads() -> None:
    grid = GridShape(3, 4, 32, 2, 8)
    x, params = inputs(grid, 7000, 16, torch.float32)
    found = []
    before = numba.get_num_threads()
    for threads in {1, before}:
        numba.set_num_threads(threads)
        table, *weights = [value.clone().requires_grad_() for value in params]
        out = cpu_hash_mlp.hash_mlp(x, table, grid, tuple(weights))
        found.append([out, *torch.autograd.grad(out.square().sum(), [table, *weights])])
    numba.set_num_threads(before)
    for a, b in zip(found[0], found[-1], strict=True):
        assert torch.equal(a, b)


def test_table_gradient_is_added_in_place() -> None:
    grid = GridShape(2, 4, 8, 2, 8)
    x, (table, *weights) = inputs(grid, 100, 8, torch.float64)
    table.requires_grad_()
    table.grad = before = torch.ones_like(table)
    cpu_hash_mlp.hash_mlp(x, table, grid, tuple(weights)).sum().backward()
    assert table.grad is before
    (expected,) = torch.autograd.grad(reference.hash_mlp(x, table, grid, tuple(weights)).sum(), table)
    torch.testing.assert_close(before, expected + 1)


def test_points_are_constants() -> None:
    grid = GridShape(2, 4, 8, 2, 8)
    x, (table, *weights) = inputs(grid, 10, 8, torch.float64)
    x.requires_grad_()
    out = cpu_hash_mlp.hash_mlp(x, table.requires_grad_(), grid, tuple(weights))
    with pytest.raises(NotImplementedError, match="no gradient by its points"):
        out.sum().backward()
