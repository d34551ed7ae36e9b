"""Numba kernel of the hash encoding's gradient by position, and the backward of that, which normals need.

Letters as in `reference.py`.  Per axis, s is the weight of the upper vertex, ds = s'(u) N its derivative by x
and dds = s''(u) N^2 the second one.  With the eight rows t_c of a cell and their weights w_c = s_x s_y s_z:

    g_x = sum_c (dw_c/dx) <g_out, t_c>

and with q = the gradient of g_x, the scalar to differentiate in the backward is sum_c m_c <g_out, t_c>, where
m_c = <q, dw_c/dx>.
"""

from functools import cache
from typing import Any, NamedTuple, no_type_check

import torch
from numpy import uint32, uint64
from torch import Tensor
from torch.autograd.function import once_differentiable

from plnerf.ops import cpu_arrays
from plnerf.ops.cpu_arrays import FAST, adds_in_place, flat
from plnerf.ops.cpu_cells import curvature, locate, slope, vertex_row, weight
from plnerf.ops.cpu_vectors import add_scaled, dot, load_row, scaled, store_row
from plnerf.ops.grid import GridShape
from plnerf.ops.kernel_cache import njit
from plnerf.ops.layout import grid_layout
from plnerf.ops.threads import share


class _Kernels(NamedTuple):
    position_gradient: Any
    position_gradient_backward: Any


@cache
@no_type_check
def _kernels(features: int) -> _Kernels:
    """Kernels for a fixed number of features: the length of their vectors."""
    F = features

    @njit(cache=True, fastmath=FAST)
    def position_gradient(x, g_out, table, layout, cubic, g_x, start, stop):
        levels, real = layout.shape[0], x.dtype.type
        one = real(1)
        for level in range(levels):
            n, row_first, dense, mask = layout[level]
            for p in range(start, stop):
                i, u = locate(x[3 * p], n, real)
                j, v = locate(x[3 * p + 1], n, real)
                k, w = locate(x[3 * p + 2], n, real)
                du = slope(u, cubic, real) * real(n)
                dv = slope(v, cubic, real) * real(n)
                dw = slope(w, cubic, real) * real(n)
                u, v, w = weight(u, cubic, real), weight(v, cubic, real), weight(w, cubic, real)
                g = load_row(g_out, uint64((p * levels + level) * F), F)
                for c in range(8):
                    a, b, d = c & 1, c >> 1 & 1, c >> 2
                    r = vertex_row(
                        uint32(i + uint32(a)),
                        uint32(j + uint32(b)),
                        uint32(k + uint32(d)),
                        n,
                        dense,
                        mask,
                    )
                    value = dot(g, load_row(table, uint64(row_first + r) * uint64(F), F))
                    pu, pv, pw = (u if a else one - u), (v if b else one - v), (w if d else one - w)
                    g_x[3 * p] += value * (du if a else -du) * pv * pw
                    g_x[3 * p + 1] += value * pu * (dv if b else -dv) * pw
                    g_x[3 * p + 2] += value * pu * pv * (dw if d else -dw)

    @njit(cache=True, fastmath=FAST)
    def position_gradient_backward(  # noqa: PLR0913 (a kernel's arrays, one by one)
        x, g_out, table, layout, cubic, q, slabs_x, g_g_out, g_table, parts, start, stop
    ):
        # slabs_x (L, 3 n) has one slab a level, added up by the caller.
        points, levels, real = x.size // 3, layout.shape[0], x.dtype.type
        one = real(1)
        for part in range(start, stop):
            for level in range(part, levels, parts):
                n, row_first, dense, mask = layout[level]
                for p in range(points):
                    i, u = locate(x[3 * p], n, real)
                    j, v = locate(x[3 * p + 1], n, real)
                    k, w = locate(x[3 * p + 2], n, real)
                    du = slope(u, cubic, real) * real(n)
                    dv = slope(v, cubic, real) * real(n)
                    dw = slope(w, cubic, real) * real(n)
                    ddu = curvature(u, cubic, real) * real(n) * real(n)
                    ddv = curvature(v, cubic, real) * real(n) * real(n)
                    ddw = curvature(w, cubic, real) * real(n) * real(n)
                    u, v, w = weight(u, cubic, real), weight(v, cubic, real), weight(w, cubic, real)
                    q0, q1, q2 = q[3 * p], q[3 * p + 1], q[3 * p + 2]
                    encoded = uint64((p * levels + level) * F)
                    g = load_row(g_out, encoded, F)
                    g_g = scaled(real(0), g)
                    x0, x1, x2 = real(0), real(0), real(0)
                    for c in range(8):
                        a, b, d = c & 1, c >> 1 & 1, c >> 2
                        r = vertex_row(
                            uint32(i + uint32(a)),
                            uint32(j + uint32(b)),
                            uint32(k + uint32(d)),
                            n,
                            dense,
                            mask,
                        )
                        row = uint64(row_first + r) * uint64(F)
                        pu, pv, pw = (u if a else one - u), (v if b else one - v), (w if d else one - w)
                        su, sv, sw = (du if a else -du), (dv if b else -dv), (dw if d else -dw)
                        tu, tv, tw = (ddu if a else -ddu), (ddv if b else -ddv), (ddw if d else -ddw)
                        m = q0 * su * pv * pw + q1 * pu * sv * pw + q2 * pu * pv * sw
                        features_c = load_row(table, row, F)
                        g_g = add_scaled(g_g, m, features_c)
                        store_row(g_table, row, add_scaled(load_row(g_table, row, F), m, g))
                        value = dot(g, features_c)
                        x0 += value * (q0 * tu * pv * pw + q1 * su * sv * pw + q2 * su * pv * sw)
                        x1 += value * (q0 * su * sv * pw + q1 * pu * tv * pw + q2 * pu * sv * sw)
                        x2 += value * (q0 * su * pv * sw + q1 * pu * sv * sw + q2 * pu * pv * tw)
                    store_row(g_g_out, encoded, g_g)
                    slabs_x[level, 3 * p], slabs_x[level, 3 * p + 1], slabs_x[level, 3 * p + 2] = x0, x1, x2

    return _Kernels(position_gradient, position_gradient_backward)


class PositionGradient(torch.autograd.Function):
    """(x, g_out, table, grid) to the gradient of <g_out, hash_encode(x)> by x, differentiable once more."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, g_out: Tensor, table: Tensor, grid: GridShape) -> Tensor:
        g_x = torch.zeros_like(x, memory_format=torch.contiguous_format)
        cubic = grid.interpolation == "cubic"
        share(
            _kernels(grid.features).position_gradient, flat(x), flat(g_out), flat(table), grid_layout(grid),
            cubic, flat(g_x), of=len(x),
        )  # fmt: skip
        ctx.save_for_backward(x, g_out, table)
        ctx.grid = grid
        return g_x

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *g_outputs: Tensor) -> tuple[Tensor, Tensor, Tensor | None, None]:
        (q,) = g_outputs
        x, g_out, table = ctx.saved_tensors
        grid, in_place = ctx.grid, adds_in_place(table)
        slabs_x = x.new_empty(grid.levels, x.numel())
        g_g_out = torch.empty_like(g_out, memory_format=torch.contiguous_format)
        g_table = table.grad if in_place else torch.zeros_like(table, memory_format=torch.contiguous_format)
        parts = cpu_arrays.num_threads()
        share(
            _kernels(grid.features).position_gradient_backward, flat(x), flat(g_out), flat(table),
            grid_layout(grid), grid.interpolation == "cubic", flat(q), slabs_x.numpy(), flat(g_g_out),
            flat(g_table), parts, of=parts,
        )  # fmt: skip
        return slabs_x.sum(0).view(x.shape), g_g_out, None if in_place else g_table, None
