"""Numba twin of `reference.hash_mlp`: hash encoding and a network of one hidden layer in one pass.

A proposal's network is so small (10 inputs, 16 hidden, 1 output) that writing its layers out costs more than
their arithmetic: here a block of points goes through both while it is in the first-level cache, laid out as
structure of arrays, so that the inner loops run over the points of a block.

The gradient of the weights is summed in a fixed number of slabs of blocks, so that it does not depend on the
number of threads; the gradient of the table is left to `cpu_hash`.  Points are constants: no gradient by x.
"""

from functools import cache
from typing import Any, NamedTuple, no_type_check

import numpy as np
import torch
from jaxtyping import Float
from numba import njit, prange
from torch import Tensor
from torch.autograd.function import once_differentiable

from plnerf.ops.cpu_arrays import FAST, adds_in_place, array, parts
from plnerf.ops.cpu_hash import add_table_gradient
from plnerf.ops.grid import HASH_PRIMES, GridShape

BLOCK = 64  # points; the largest scratch, 16 x 64 floats, fills an eighth of the first-level cache
SLABS = 16
_PRIME_Y, _PRIME_Z = (np.uint32(prime) for prime in HASH_PRIMES[1:])
_SUMS = FAST | {"reassoc"}  # lets LLVM add a block's terms in vectors; the order is still a fixed one


class _Kernels(NamedTuple):
    forward: Any
    backward: Any


@cache
@no_type_check
def _kernels(features: int, hidden: int, cubic: bool) -> _Kernels:
    F, H = features, hidden

    @njit(inline="always", fastmath=FAST)
    def encode_level(x, first, count, table, level, cells, start, dense, mask, enc):  # noqa: PLR0913
        # Points first to first + count at one level: F rows of enc.
        real = x.dtype.type
        one, two, three = real(1), real(2), real(3)
        n = real(cells)
        last = np.int32(cells - 1)
        for p in range(count):
            u, v, w = x[first + p, 0] * n, x[first + p, 1] * n, x[first + p, 2] * n
            i = min(max(np.int32(np.floor(u)), np.int32(0)), last)
            j = min(max(np.int32(np.floor(v)), np.int32(0)), last)
            k = min(max(np.int32(np.floor(w)), np.int32(0)), last)
            u, v, w = u - real(i), v - real(j), w - real(k)
            if cubic:
                u, v, w = u * u * (three - two * u), v * v * (three - two * v), w * w * (three - two * w)
            if dense:
                y, z = np.int64(cells + 1), np.int64(cells + 1) * np.int64(cells + 1)
                r0 = start + i + y * j + z * k
                r1, r2, r3 = r0 + 1, r0 + y, r0 + y + 1
                r4, r5, r6, r7 = r0 + z, r0 + z + 1, r0 + z + y, r0 + z + y + 1
            else:
                i0, j0, k0 = np.uint32(i), np.uint32(j) * _PRIME_Y, np.uint32(k) * _PRIME_Z
                i1, j1, k1 = i0 + np.uint32(1), j0 + _PRIME_Y, k0 + _PRIME_Z
                r0 = start + np.int64((i0 ^ j0 ^ k0) & mask)
                r1 = start + np.int64((i1 ^ j0 ^ k0) & mask)
                r2 = start + np.int64((i0 ^ j1 ^ k0) & mask)
                r3 = start + np.int64((i1 ^ j1 ^ k0) & mask)
                r4 = start + np.int64((i0 ^ j0 ^ k1) & mask)
                r5 = start + np.int64((i1 ^ j0 ^ k1) & mask)
                r6 = start + np.int64((i0 ^ j1 ^ k1) & mask)
                r7 = start + np.int64((i1 ^ j1 ^ k1) & mask)
            s0, s1, s2, s3 = (one - v) * (one - w), v * (one - w), (one - v) * w, v * w
            for f in range(F):
                enc[level * F + f, p] = (
                    s0 * ((one - u) * table[r0, f] + u * table[r1, f])
                    + s1 * ((one - u) * table[r2, f] + u * table[r3, f])
                    + s2 * ((one - u) * table[r4, f] + u * table[r5, f])
                    + s3 * ((one - u) * table[r6, f] + u * table[r7, f])
                )

    @njit(parallel=True, cache=True, fastmath=FAST)
    def forward(x, table, layout, w1, b1, w2, b2, encoded, out, parts):  # noqa: PLR0913 (no structs)
        points, levels, blocks, real = x.shape[0], layout.shape[0], encoded.shape[0], x.dtype.type
        for part in prange(parts):
            h, raw = np.empty(BLOCK, x.dtype), np.empty(BLOCK, x.dtype)
            for block in range(blocks * part // parts, blocks * (part + 1) // parts):
                first = block * BLOCK
                count = min(BLOCK, points - first)
                enc = encoded[block]
                for level in range(levels):
                    n, start, dense, mask = layout[level]
                    encode_level(x, first, count, table, level, n, start, dense, np.uint32(mask), enc)
                for p in range(BLOCK):
                    raw[p] = b2[0]
                for o in range(H):
                    for p in range(BLOCK):
                        h[p] = b1[o]
                    for i in range(levels * F):
                        weight = w1[o, i]
                        for p in range(BLOCK):
                            h[p] += weight * enc[i, p]
                    weight = w2[0, o]
                    for p in range(BLOCK):
                        raw[p] += weight * max(h[p], real(0))
                for p in range(count):
                    out[first + p] = raw[p]

    @njit(parallel=True, cache=True, fastmath=_SUMS)
    def backward(encoded, g_out, w1, b1, w2, g_encoded, g_w1, g_b1, g_w2, g_b2):  # noqa: PLR0913
        # g_w1 and the others have a slab each in their first axis, added up by the caller.
        points, blocks, inputs, real = g_out.shape[0], encoded.shape[0], encoded.shape[1], encoded.dtype.type
        for slab in prange(SLABS):
            h, g = np.empty(BLOCK, encoded.dtype), np.empty(BLOCK, encoded.dtype)
            g_enc = np.empty((inputs, BLOCK), encoded.dtype)
            for block in range(blocks * slab // SLABS, blocks * (slab + 1) // SLABS):
                first = block * BLOCK
                count = min(BLOCK, points - first)
                enc = encoded[block]
                g[:] = 0
                moved = False
                for p in range(count):
                    g[p] = g_out[first + p]
                    moved |= g[p] != 0
                if not moved:  # most blocks: proposals are only pushed where they fall short
                    g_encoded[first : first + count] = 0
                    continue
                g_enc[:] = 0
                total = real(0)
                for p in range(BLOCK):
                    total += g[p]
                g_b2[slab, 0] += total
                for o in range(H):
                    for p in range(BLOCK):
                        h[p] = b1[o]
                    for i in range(inputs):
                        weight = w1[o, i]
                        for p in range(BLOCK):
                            h[p] += weight * enc[i, p]
                    total = real(0)
                    for p in range(BLOCK):
                        total += g[p] * max(h[p], real(0))
                    g_w2[slab, 0, o] += total
                    weight, total = w2[0, o], real(0)
                    for p in range(BLOCK):
                        h[p] = weight * g[p] if h[p] > 0 else real(0)  # now the gradient of the hidden unit
                        total += h[p]
                    g_b1[slab, o] += total
                    for i in range(inputs):
                        weight, total = w1[o, i], real(0)
                        for p in range(BLOCK):
                            total += h[p] * enc[i, p]
                            g_enc[i, p] += weight * h[p]
                        g_w1[slab, o, i] += total
                for p in range(count):
                    for i in range(inputs):
                        g_encoded[first + p, i] = g_enc[i, p]

    return _Kernels(forward, backward)


class _HashMLP(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, table: Tensor, grid: GridShape, *weights: Tensor) -> Tensor:
        w1, b1, w2, _ = weights
        kernels = _kernels(grid.features, len(b1), grid.interpolation == "cubic")
        # Zeros, since the last block may have points that do not exist.
        encoded = x.new_zeros(-(-len(x) // BLOCK), grid.width, BLOCK)
        out = x.new_empty(len(x))
        kernels.forward(
            array(x), array(table), grid.layout, *map(array, weights), encoded.numpy(), out.numpy(), parts()
        )
        ctx.save_for_backward(x, table, encoded, w1, b1, w2)
        ctx.grid = grid
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *g_outputs: Tensor) -> tuple[Tensor | None, ...]:
        if ctx.needs_input_grad[0]:
            raise NotImplementedError(
                "hash_mlp has no gradient by its points; use hash_encode and a network."
            )
        x, table, encoded, w1, b1, w2 = ctx.saved_tensors
        kernels = _kernels(ctx.grid.features, len(b1), ctx.grid.interpolation == "cubic")
        g_encoded = x.new_empty(len(x), ctx.grid.width)
        slabs = [x.new_zeros(SLABS, *shape) for shape in (w1.shape, b1.shape, w2.shape, (1,))]
        kernels.backward(
            encoded.numpy(), array(g_outputs[0]), array(w1), array(b1), array(w2), g_encoded.numpy(),
            *(slab.numpy() for slab in slabs),
        )  # fmt: skip
        in_place = adds_in_place(table)
        g_table = table.grad if in_place else torch.zeros_like(table, memory_format=torch.contiguous_format)
        add_table_gradient(x, g_encoded, g_table, ctx.grid)
        return None, None if in_place else g_table, None, *(slab.sum(0) for slab in slabs)


def hash_mlp(
    x: Float[Tensor, "n 3"],
    table: Float[Tensor, "rows F"],
    grid: GridShape,
    weights: tuple[Tensor, Tensor, Tensor, Tensor],
) -> Float[Tensor, " n"]:
    """Twin of `reference.hash_mlp`.  Points are constants: NotImplementedError where they need a gradient.

    Where `table.grad` is there already, a backward pass adds to it in place and hands autograd nothing.
    """
    out: Tensor = _HashMLP.apply(x, table, grid, *weights)
    return out
