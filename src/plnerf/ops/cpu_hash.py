"""Numba twins of the ops for a CPU: forward, backward, and the backward of the backward that normals need.

Numba brings its own LLVM, so nothing is compiled at install time; a kernel is compiled on its first call and
kept in Numba's cache on disk.  Gradients of the table are summed by one thread per level, in the order of the
points, so that results do not depend on the number of threads.

Arithmetic is done in the type of the points, `real`: to Numba an integer times a float32 is a float64, which
makes the kernels half as fast.

Letters as in `reference.py`.  Per axis: weight s(u) of the upper vertex, its slope s'(u) N and its curvature
s''(u) N^2.

What Numba compiles is marked no_type_check: a wrapper that checks annotations cannot be compiled.
"""

from functools import cache
from typing import Any, NamedTuple, no_type_check

import numba
import numpy as np
import torch
from jaxtyping import Float
from numba import njit, prange
from torch import Tensor
from torch.autograd.function import once_differentiable

from plnerf.ops.grid import HASH_PRIMES, GridShape

_PRIME_Y, _PRIME_Z = HASH_PRIMES[1], HASH_PRIMES[2]
_FAST = {"contract", "nsz", "arcp"}  # fused multiply-add, but infinities and NaN keep their meaning


@njit(inline="always")
@no_type_check
def weight(u, cubic, real):
    return u * u * (real(3) - real(2) * u) if cubic else u


@njit(inline="always")
@no_type_check
def slope(u, cubic, real):
    return real(6) * u * (real(1) - u) if cubic else real(1)


@njit(inline="always")
@no_type_check
def curvature(u, cubic, real):
    return real(6) - real(12) * u if cubic else real(0)


@njit(inline="always")
@no_type_check
def locate(value, n, real):
    scaled = value * real(n)
    cell = min(max(np.int64(np.floor(scaled)), 0), n - 1)
    return cell, scaled - real(cell)


@njit(inline="always")
@no_type_check
def row(i, j, k, n, start, dense, mask):
    if dense:
        return start + i + (n + 1) * (j + (n + 1) * k)
    return start + ((i ^ (j * _PRIME_Y) ^ (k * _PRIME_Z)) & mask)


class _Kernels(NamedTuple):
    forward: Any
    table_gradient: Any
    position_gradient: Any
    position_gradient_backward: Any


@cache
@no_type_check
def _kernels(features: int, cubic: bool) -> _Kernels:
    """Kernels for a fixed number of features, so that LLVM unrolls the loops over them."""
    F = features

    @njit(parallel=True, cache=True, fastmath=_FAST)
    def forward(x, table, layout, out, parts):
        points, levels, real = x.shape[0], layout.shape[0], x.dtype.type
        one = real(1)
        for part in prange(parts):
            for level in range(levels):
                n, start, dense, mask = layout[level]
                for p in range(points * part // parts, points * (part + 1) // parts):
                    i, u = locate(x[p, 0], n, real)
                    j, v = locate(x[p, 1], n, real)
                    k, w = locate(x[p, 2], n, real)
                    u, v, w = weight(u, cubic, real), weight(v, cubic, real), weight(w, cubic, real)
                    for f in range(F):
                        out[p, level * F + f] = 0
                    for c in range(8):
                        a, b, d = c & 1, c >> 1 & 1, c >> 2
                        share = (u if a else one - u) * (v if b else one - v) * (w if d else one - w)
                        r = row(i + a, j + b, k + d, n, start, dense, mask)
                        for f in range(F):
                            out[p, level * F + f] += share * table[r, f]

    @njit(parallel=True, cache=True, fastmath=_FAST)
    def table_gradient(x, g_out, layout, g_table, parts):
        points, levels, real = x.shape[0], layout.shape[0], x.dtype.type
        one = real(1)
        for part in prange(parts):
            for level in range(part, levels, parts):
                n, start, dense, mask = layout[level]
                for p in range(points):
                    i, u = locate(x[p, 0], n, real)
                    j, v = locate(x[p, 1], n, real)
                    k, w = locate(x[p, 2], n, real)
                    u, v, w = weight(u, cubic, real), weight(v, cubic, real), weight(w, cubic, real)
                    for c in range(8):
                        a, b, d = c & 1, c >> 1 & 1, c >> 2
                        share = (u if a else one - u) * (v if b else one - v) * (w if d else one - w)
                        r = row(i + a, j + b, k + d, n, start, dense, mask)
                        for f in range(F):
                            g_table[r, f] += share * g_out[p, level * F + f]

    @njit(parallel=True, cache=True, fastmath=_FAST)
    def position_gradient(x, g_out, table, layout, g_x, parts):
        points, levels, real = x.shape[0], layout.shape[0], x.dtype.type
        one = real(1)
        for part in prange(parts):
            for level in range(levels):
                n, start, dense, mask = layout[level]
                for p in range(points * part // parts, points * (part + 1) // parts):
                    i, u = locate(x[p, 0], n, real)
                    j, v = locate(x[p, 1], n, real)
                    k, w = locate(x[p, 2], n, real)
                    du = slope(u, cubic, real) * real(n)
                    dv = slope(v, cubic, real) * real(n)
                    dw = slope(w, cubic, real) * real(n)
                    u, v, w = weight(u, cubic, real), weight(v, cubic, real), weight(w, cubic, real)
                    for c in range(8):
                        a, b, d = c & 1, c >> 1 & 1, c >> 2
                        r = row(i + a, j + b, k + d, n, start, dense, mask)
                        value = real(0)
                        for f in range(F):
                            value += g_out[p, level * F + f] * table[r, f]
                        pu, pv, pw = (u if a else one - u), (v if b else one - v), (w if d else one - w)
                        g_x[p, 0] += value * (du if a else -du) * pv * pw
                        g_x[p, 1] += value * pu * (dv if b else -dv) * pw
                        g_x[p, 2] += value * pu * pv * (dw if d else -dw)

    @njit(parallel=True, cache=True, fastmath=_FAST)
    def position_gradient_backward(  # noqa: PLR0913 (a kernel has no structs)
        x, g_out, table, layout, q, parts_x, g_g_out, g_table, parts
    ):
        # q = gradient of the position gradient; with m_c = sum_i q_i d(share_c)/dx_i the scalar to
        # differentiate is sum_c m_c <g_out, table_c>.  parts_x has one slab a level, added up by the caller.
        points, levels, real = x.shape[0], layout.shape[0], x.dtype.type
        one = real(1)
        for part in prange(parts):
            for level in range(part, levels, parts):
                n, start, dense, mask = layout[level]
                for p in range(points):
                    i, u = locate(x[p, 0], n, real)
                    j, v = locate(x[p, 1], n, real)
                    k, w = locate(x[p, 2], n, real)
                    du = slope(u, cubic, real) * real(n)
                    dv = slope(v, cubic, real) * real(n)
                    dw = slope(w, cubic, real) * real(n)
                    ddu = curvature(u, cubic, real) * real(n) * real(n)
                    ddv = curvature(v, cubic, real) * real(n) * real(n)
                    ddw = curvature(w, cubic, real) * real(n) * real(n)
                    u, v, w = weight(u, cubic, real), weight(v, cubic, real), weight(w, cubic, real)
                    q0, q1, q2 = q[p, 0], q[p, 1], q[p, 2]
                    for c in range(8):
                        a, b, d = c & 1, c >> 1 & 1, c >> 2
                        r = row(i + a, j + b, k + d, n, start, dense, mask)
                        pu, pv, pw = (u if a else one - u), (v if b else one - v), (w if d else one - w)
                        su, sv, sw = (du if a else -du), (dv if b else -dv), (dw if d else -dw)
                        tu, tv, tw = (ddu if a else -ddu), (ddv if b else -ddv), (ddw if d else -ddw)
                        m = q0 * su * pv * pw + q1 * pu * sv * pw + q2 * pu * pv * sw
                        value = real(0)
                        for f in range(F):
                            value += g_out[p, level * F + f] * table[r, f]
                            g_g_out[p, level * F + f] += m * table[r, f]
                            g_table[r, f] += m * g_out[p, level * F + f]
                        parts_x[level, p, 0] += value * (
                            q0 * tu * pv * pw + q1 * su * sv * pw + q2 * su * pv * sw
                        )
                        parts_x[level, p, 1] += value * (
                            q0 * su * sv * pw + q1 * pu * tv * pw + q2 * pu * sv * sw
                        )
                        parts_x[level, p, 2] += value * (
                            q0 * su * pv * sw + q1 * pu * sv * sw + q2 * pu * pv * tw
                        )

    return _Kernels(forward, table_gradient, position_gradient, position_gradient_backward)


def _parts() -> int:
    """Into how many parts a kernel splits its work.  Asked outside of kernels: else they are not cached."""
    return int(numba.get_num_threads())


def _array(tensor: Tensor) -> np.ndarray:
    return tensor.detach().contiguous().numpy()


def _kernels_of(grid: GridShape) -> _Kernels:
    return _kernels(grid.features, grid.interpolation == "cubic")


def _adds_in_place(table: Tensor) -> bool:
    """Whether a backward pass may add to `table.grad` itself, as autograd would do with what it is handed.

    A fresh array of the table's size at each step costs more, in page faults alone, than the gradient
    itself: up to 40 % of a training step was spent on it.  Only for a leaf whose gradient is there already,
    contiguous, and not while a graph of the gradient is made.
    """
    there = table.is_leaf and table.grad is not None and table.grad.is_contiguous()
    return there and not torch.is_grad_enabled()


def _add_table_gradient(x: Tensor, g_out: Tensor, g_table: Tensor, grid: GridShape) -> None:
    array = g_table.detach().numpy()
    _kernels_of(grid).table_gradient(_array(x), _array(g_out), grid.layout, array, _parts())


class _HashEncode(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, table: Tensor, grid: GridShape) -> Tensor:
        out = x.new_empty(x.shape[0], grid.width)
        _kernels_of(grid).forward(_array(x), _array(table), grid.layout, out.numpy(), _parts())
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
            _add_table_gradient(x, g_out, table.grad, ctx.grid)
        elif ctx.needs_input_grad[1]:
            g_table = _TableGradient.apply(x, g_out, table, ctx.grid)
        return g_x, g_table, None


class _TableGradient(torch.autograd.Function):
    """Not differentiable again: no loss here asks for the derivative of a table's gradient."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, g_out: Tensor, table: Tensor, grid: GridShape) -> Tensor:
        g_table = torch.zeros_like(table, memory_format=torch.contiguous_format)
        _add_table_gradient(x, g_out, g_table, grid)
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
        g_x = torch.zeros_like(x, memory_format=torch.contiguous_format)
        _kernels_of(grid).position_gradient(
            _array(x), _array(g_out), _array(table), grid.layout, g_x.numpy(), _parts()
        )
        ctx.save_for_backward(x, g_out, table)
        ctx.grid = grid
        return g_x

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *g_outputs: Tensor) -> tuple[Tensor, Tensor, Tensor | None, None]:
        (q,) = g_outputs
        x, g_out, table = ctx.saved_tensors
        parts_x = x.new_zeros(ctx.grid.levels, *x.shape)
        g_g_out = torch.zeros_like(g_out, memory_format=torch.contiguous_format)
        in_place = _adds_in_place(table)
        g_table = table.grad if in_place else torch.zeros_like(table, memory_format=torch.contiguous_format)
        _kernels_of(ctx.grid).position_gradient_backward(
            _array(x), _array(g_out), _array(table), ctx.grid.layout, _array(q),
            parts_x.numpy(), g_g_out.numpy(), g_table.numpy(), _parts(),
        )  # fmt: skip
        return parts_x.sum(0), g_g_out, None if in_place else g_table, None


def hash_encode(
    x: Float[Tensor, "n 3"], table: Float[Tensor, "rows F"], grid: GridShape
) -> Float[Tensor, "n LF"]:
    """Twin of `reference.hash_encode`: same values and gradients, including those of the gradient of x.

    Where `table.grad` is there already, a backward pass adds to it in place and hands autograd nothing.
    """
    out: Tensor = _HashEncode.apply(x, table, grid)
    return out


def hash_position_gradient(
    x: Float[Tensor, "n 3"], g_out: Float[Tensor, "n LF"], table: Float[Tensor, "rows F"], grid: GridShape
) -> Float[Tensor, "n 3"]:
    """Twin of `reference.hash_position_gradient`."""
    g_x: Tensor = _PositionGradient.apply(x, g_out, table, grid)
    return g_x
