"""Numba kernel of the hash encoding for a CPU: forward, and backward by the table.  By position: see
`cpu_hash_normals.py`.

Numba brings its own LLVM, so nothing is compiled at install time; a kernel is compiled on its first call and
kept in Numba's cache on disk.

One level after the other, so that its part of the table stays in cache; within a level by blocks of points:
first the rows and weights of all corners, vectorised over the points, then a row of F features at a time.
Gradients of the table are summed by one thread per level, in the order of the points, so that results do not
depend on the number of threads.

Letters as in `reference.py`.  What Numba compiles is marked no_type_check: a wrapper that checks annotations
cannot be compiled.
"""

from functools import cache
from typing import Any, NamedTuple, no_type_check

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from plnerf.ops import cpu_arrays
from plnerf.ops.cpu_arrays import FAST, adds_in_place, flat
from plnerf.ops.cpu_cells import BLOCK, fill_corners
from plnerf.ops.cpu_hash_normals import PositionGradient
from plnerf.ops.cpu_vectors import add_scaled, load_row, scaled, store_row
from plnerf.ops.grid import GridShape
from plnerf.ops.kernel_cache import njit
from plnerf.ops.layout import grid_layout
from plnerf.ops.threads import share


class _Kernels(NamedTuple):
    forward: Any
    table_gradient: Any


@cache
@no_type_check
def _kernels(features: int) -> _Kernels:
    """Kernels for a fixed number of features: the length of their vectors."""
    F = features

    @njit(cache=True, fastmath=FAST)
    def forward(x, table, layout, cubic, out, start, stop):
        rows, shares = np.empty(8 * BLOCK, np.uint32), np.empty(8 * BLOCK, x.dtype)
        for level in range(layout.shape[0]):
            n, row_first, dense, mask = layout[level]
            of_level = table[row_first * F :]
            for first in range(start, stop, BLOCK):
                count = min(BLOCK, stop - first)
                fill_corners(x, first, count, n, dense, mask, cubic, rows, shares)
                for p in range(count):
                    row = np.uint64(rows[np.uint64(p)]) * np.uint64(F)
                    total = scaled(shares[np.uint64(p)], load_row(of_level, row, F))
                    for c in range(1, 8):
                        corner = np.uint64(c * BLOCK + p)
                        row = np.uint64(rows[corner]) * np.uint64(F)
                        total = add_scaled(total, shares[corner], load_row(of_level, row, F))
                    store_row(out, np.uint64(((first + p) * layout.shape[0] + level) * F), total)

    @njit(cache=True, fastmath=FAST)
    def table_gradient(x, g_out, layout, cubic, g_table, parts, start, stop):
        points, levels = x.size // 3, layout.shape[0]
        for part in range(start, stop):
            rows, shares = np.empty(8 * BLOCK, np.uint32), np.empty(8 * BLOCK, x.dtype)
            for level in range(part, levels, parts):
                n, row_first, dense, mask = layout[level]
                of_level = g_table[row_first * F :]
                for first in range(0, points, BLOCK):
                    count = min(BLOCK, points - first)
                    fill_corners(x, first, count, n, dense, mask, cubic, rows, shares)
                    for p in range(count):
                        g = load_row(g_out, np.uint64(((first + p) * levels + level) * F), F)
                        for c in range(8):
                            corner = np.uint64(c * BLOCK + p)
                            row = np.uint64(rows[corner]) * np.uint64(F)
                            store_row(
                                of_level, row, add_scaled(load_row(of_level, row, F), shares[corner], g)
                            )

    return _Kernels(forward, table_gradient)


def add_table_gradient(
    x: Float[Tensor, "n 3"], g_out: Float[Tensor, "n LF"], g_table: Float[Tensor, "rows F"], grid: GridShape
) -> None:
    """Adds the gradient of <g_out, hash_encode(x)> by the table to `g_table`, which must be contiguous."""
    cubic = grid.interpolation == "cubic"
    parts = cpu_arrays.num_threads()
    share(
        _kernels(grid.features).table_gradient, flat(x), flat(g_out), grid_layout(grid), cubic, flat(g_table),
        parts, of=parts,
    )  # fmt: skip


class _HashEncode(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, table: Tensor, grid: GridShape) -> Tensor:
        out = x.new_empty(x.shape[0], grid.width)
        cubic = grid.interpolation == "cubic"
        share(
            _kernels(grid.features).forward, flat(x), flat(table), grid_layout(grid), cubic, flat(out),
            of=len(x),
        )  # fmt: skip
        ctx.save_for_backward(x, table)
        ctx.grid = grid
        return out

    @staticmethod
    def backward(ctx: Any, *g_outputs: Tensor) -> tuple[Tensor | None, Tensor | None, None]:
        (g_out,) = g_outputs
        x, table = ctx.saved_tensors
        g_x = PositionGradient.apply(x, g_out, table, ctx.grid) if ctx.needs_input_grad[0] else None
        g_table = None
        if ctx.needs_input_grad[1] and adds_in_place(table):
            add_table_gradient(x, g_out, table.grad, ctx.grid)
        elif ctx.needs_input_grad[1]:
            g_table = _TableGradient.apply(x, g_out, table, ctx.grid)
        return g_x, g_table, None


class _TableGradient(torch.autograd.Function):
    """Not differentiable again: no loss here asks for the derivative of a table's gradient."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, g_out: Tensor, table: Tensor, grid: GridShape) -> Tensor:
        g_table = torch.zeros_like(table, memory_format=torch.contiguous_format)
        add_table_gradient(x, g_out, g_table, grid)
        return g_table

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *g_outputs: Tensor) -> tuple[None, None, None, None]:
        raise NotImplementedError(
            "The gradient of a hash table's gradient is not implemented; use the reference."
        )


def hash_encode(
    x: Float[Tensor, "n 3"], table: Float[Tensor, "rows F"], grid: GridShape
) -> Float[Tensor, "n LF"]:
    """Kernel of `reference.hash_encode`: same values and gradients, including those of the gradient of x.

    Where `table.grad` is there already, a backward pass adds to it in place and hands autograd nothing.
    """
    out: Tensor = _HashEncode.apply(x, table, grid)
    return out


def hash_position_gradient(
    x: Float[Tensor, "n 3"], g_out: Float[Tensor, "n LF"], table: Float[Tensor, "rows F"], grid: GridShape
) -> Float[Tensor, "n 3"]:
    """Kernel of `reference.hash_position_gradient`."""
    g_x: Tensor = PositionGradient.apply(x, g_out, table, grid)
    return g_x
