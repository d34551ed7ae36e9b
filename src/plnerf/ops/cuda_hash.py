"""Triton kernels of the hash encoding for a GPU: forward, backward, and the backward of the backward.

Triton comes with PyTorch's Linux builds for GPUs and compiles a kernel on its first call.  With
TRITON_INTERPRET=1 in the environment, before Triton is imported, the same kernels are interpreted on a CPU.

Tables are of float32, or of float16 or bfloat16 and widened as they are read.  Gradients of tables are summed
up in float32 by atomic additions, whose order, and so the last bits, differ from run to run.  (To keep that
gradient for a table of float16, set its `grad_dtype`.)  The gradient by position is the same in every run: a
part for each level is stored, then the parts are added up.

Nothing here waits for the GPU or copies to it once a grid's layout is there: after one step outside of it, a
step can be captured in a CUDA graph.
"""

from functools import cache
from typing import Any

import torch
import triton
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from plnerf.ops import cuda_kernels
from plnerf.ops.grid import GridShape
from plnerf.ops.layout import grid_layout

BLOCK = 128  # points of a program
WARPS = 4  # that share them
_SUMS = (torch.float32, torch.float64)  # what gradients are summed up in


@cache
def _layout(grid: GridShape, device: torch.device) -> Tensor:
    """The grid's layout on a device, copied there once."""
    return torch.from_numpy(grid_layout(grid)).to(device)


def _launch(kernel: Any, grid: GridShape, inputs: tuple[Tensor, ...], outputs: tuple[Tensor, ...]) -> None:
    """Runs a kernel over blocks of points and levels; the first input is the points."""
    points, device = inputs[0].shape[0], inputs[0].device
    if points == 0:
        return
    kernel[triton.cdiv(points, BLOCK), grid.levels](
        _layout(grid, device), *(value.detach().contiguous() for value in inputs), *outputs, points,
        L=grid.levels, F=grid.features, F_UP=triton.next_power_of_2(grid.features),
        CUBIC=grid.interpolation == "cubic", BLOCK=BLOCK, num_warps=WARPS,
    )  # fmt: skip


def _zero_sums(table: Tensor) -> Tensor:
    wide = table.dtype if table.dtype in _SUMS else torch.float32
    return torch.zeros_like(table, dtype=wide, memory_format=torch.contiguous_format)


def _adds_in_place(table: Tensor) -> bool:
    """Whether a backward pass may add to `table.grad` itself, as autograd would do with what it is handed.

    Only for a leaf whose gradient is there already, contiguous, of a type that sums can be taken in, and not
    while a graph of the gradient is made.
    """
    if not table.is_leaf or table.grad is None or torch.is_grad_enabled():
        return False
    return table.grad.is_contiguous() and table.grad.dtype in _SUMS


class _HashEncode(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, table: Tensor, grid: GridShape) -> Tensor:
        out = x.new_empty(x.shape[0], grid.width)
        _launch(cuda_kernels.encode, grid, (x, table), (out,))
        ctx.save_for_backward(x, table)
        ctx.grid = grid
        return out

    @staticmethod
    def backward(ctx: Any, *g_outputs: Tensor) -> tuple[Tensor | None, Tensor | None, None]:
        (g_out,) = g_outputs
        x, table = ctx.saved_tensors
        g_x = _PositionGradient.apply(x, g_out, table, ctx.grid) if ctx.needs_input_grad[0] else None
        g_table = None
        if ctx.needs_input_grad[1] and _adds_in_place(table):
            _launch(cuda_kernels.table_gradient, ctx.grid, (x, g_out), (table.grad,))
        elif ctx.needs_input_grad[1]:
            g_table = _TableGradient.apply(x, g_out, table, ctx.grid)
        return g_x, g_table, None


class _TableGradient(torch.autograd.Function):
    """Not differentiable again: no loss here asks for the derivative of a table's gradient."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, g_out: Tensor, table: Tensor, grid: GridShape) -> Tensor:
        g_table = _zero_sums(table)
        _launch(cuda_kernels.table_gradient, grid, (x, g_out), (g_table,))
        return g_table

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *g_outputs: Tensor) -> tuple[None, None, None, None]:
        raise NotImplementedError(
            "The gradient of a hash table's gradient is not implemented; use the reference."
        )


class _PositionGradient(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, g_out: Tensor, table: Tensor, grid: GridShape) -> Tensor:
        parts_x = x.new_zeros(grid.levels, *x.shape)
        _launch(cuda_kernels.position_gradient, grid, (x, g_out, table), (parts_x,))
        ctx.save_for_backward(x, g_out, table)
        ctx.grid = grid
        return parts_x.sum(0)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *g_outputs: Tensor) -> tuple[Tensor, Tensor, Tensor | None, None]:
        (q,) = g_outputs
        x, g_out, table = ctx.saved_tensors
        parts_x = x.new_zeros(ctx.grid.levels, *x.shape)
        g_g_out = torch.zeros_like(g_out, memory_format=torch.contiguous_format)
        in_place = _adds_in_place(table)
        g_table = table.grad if in_place else _zero_sums(table)
        kernel = cuda_kernels.position_gradient_backward
        _launch(kernel, ctx.grid, (x, g_out, table, q), (parts_x, g_g_out, g_table))
        return parts_x.sum(0), g_g_out, None if in_place else g_table, None


def hash_encode(
    x: Float[Tensor, "n 3"], table: Float[Tensor, "rows F"], grid: GridShape
) -> Float[Tensor, "n LF"]:
    """Kernel of `reference.hash_encode`: same values and gradients, including those of the gradient of x.

    Of the type of x.  Where `table.grad` is there already, a backward pass adds to it in place and hands
    autograd nothing.
    """
    out: Tensor = _HashEncode.apply(x, table, grid)
    return out


def hash_position_gradient(
    x: Float[Tensor, "n 3"], g_out: Float[Tensor, "n LF"], table: Float[Tensor, "rows F"], grid: GridShape
) -> Float[Tensor, "n 3"]:
    """Kernel of `reference.hash_position_gradient`."""
    g_x: Tensor = _PositionGradient.apply(x, g_out, table, grid)
    return g_x
