"""Numba kernel of `reference.hash_mlp`: hash encoding and a network of one hidden layer in one pass.

A proposal's network is so small (10 inputs, 16 hidden, 1 output) that writing its layers out costs more than
their arithmetic: here a block of points goes through both while it is in the first-level cache, as
`cpu_blocks.py` lays it out.  The encodings are kept for the backward pass, hidden layers are computed again.

Backward, only points with a gradient count, about half of them in training: proposals are only pushed where
they fall short.  These, one after the other, fill the blocks.  The gradient of the weights is summed in a
fixed number of slabs of them, so that it does not depend on the number of threads; the gradient of the table
is left to `cpu_hash`.  Points are constants: no gradient by x.

Letters as in `cpu_blocks.py`; I inputs of the network, m points with a gradient.
"""

from typing import Any, no_type_check

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from plnerf.ops.cpu_arrays import FAST, adds_in_place, array, flat
from plnerf.ops.cpu_blocks import add_layer, encode, grid_of, network_of, run_network, spread_biases
from plnerf.ops.cpu_cells import BLOCK
from plnerf.ops.cpu_hash import add_table_gradient
from plnerf.ops.cpu_products import add_products
from plnerf.ops.grid import GridShape
from plnerf.ops.kernel_cache import INNER, njit
from plnerf.ops.threads import share

SLABS = 16
_FLAGS = {"fastmath": FAST, "error_model": "numpy", "cache": True}
_INNER = _FLAGS | INNER
_SUMS = FAST | {"reassoc"}  # lets LLVM add a block's terms in vectors; the order is still a fixed one


@njit(**_FLAGS)
@no_type_check
def _forward(x, grid, network, encoded, out, start, stop):
    """The blocks start .. stop - 1 of the points."""
    rows, shares = np.empty(8 * BLOCK, np.uint32), np.empty(8 * BLOCK, x.dtype)
    hidden = np.empty(network.sizes[1] * BLOCK, x.dtype)
    other = np.empty(network.sizes[1] * BLOCK, x.dtype)
    for block in range(start, stop):
        first = block * BLOCK
        count = min(BLOCK, out.size - first)
        encode(x, first, count, grid, rows, shares, encoded[block])
        raw = run_network(network, encoded[block], 0, hidden, other)
        for p in range(count):
            out[first + p] = raw[p]


@njit(**_INNER | {"fastmath": _SUMS})
@no_type_check
def _dot(a, b):
    total = a.dtype.type(0)
    for p in range(BLOCK):
        total += a[p] * b[p]
    return total


@njit(**_INNER | {"fastmath": _SUMS})
@no_type_check
def _sum(a):
    total = a.dtype.type(0)
    for p in range(BLOCK):
        total += a[p]
    return total


@njit(**_INNER)
@no_type_check
def _through_unit(g, weight, h, kept):
    """h (B), a hidden unit before its ReLU, becomes the gradient by it; what it put out goes to `kept`."""
    zero = h.dtype.type(0)
    for p in range(BLOCK):
        kept[p] = max(h[p], zero)
        h[p] = weight * g[p] if h[p] > zero else zero


@njit(**_INNER)
@no_type_check
def _add_by_inputs(w1, inputs, units, g_h, g_x):
    """g_x (I, B) += w1^T (I, H) g_h (H, B)."""
    tiles = inputs // 8 * 8
    for i in range(0, tiles, 8):
        for p in range(0, BLOCK, 32):
            add_products(g_x, i * BLOCK + p, BLOCK, w1, i, 1, inputs, g_h, p, BLOCK, units, 8, 32)
    for i in range(tiles, inputs):
        for p in range(0, BLOCK, 64):
            add_products(g_x, i * BLOCK + p, BLOCK, w1, i, 1, inputs, g_h, p, BLOCK, units, 1, 64)


@njit(**_FLAGS)
@no_type_check
def _backward(encoded, moved, g_out, network, g_encoded, g_weights, g_biases, start, stop):  # noqa: PLR0913 (a kernel's arrays, one by one)
    """By the weights and, g_encoded flat (m I), by the encodings of the points `moved`, whose are g_out (m).

    g_weights and g_biases, as the network has them, have a slab each in their first axis; the caller adds up.
    """
    inputs, units, real = network.sizes[0], network.sizes[1], encoded.dtype.type
    w1 = network.weights[: units * inputs]
    for slab in range(start, stop):
        x, g_x = np.zeros(inputs * BLOCK, encoded.dtype), np.empty(inputs * BLOCK, encoded.dtype)
        h, kept = np.empty(units * BLOCK, encoded.dtype), np.empty(BLOCK, encoded.dtype)
        g = np.empty(BLOCK, encoded.dtype)
        g_w, g_b = g_weights[slab], g_biases[slab]
        end = moved.size * (slab + 1) // SLABS
        for first in range(moved.size * slab // SLABS, end, BLOCK):
            count = min(BLOCK, end - first)
            g[:] = real(0)
            for p in range(count):
                g[p] = g_out[first + p]
                of_block, place = encoded[moved[first + p] // BLOCK], moved[first + p] % BLOCK
                for i in range(inputs):
                    x[i * BLOCK + p] = of_block[i * BLOCK + place]
            spread_biases(network.biases, 0, units, h)
            add_layer(w1, 0, units, x, 0, inputs, h)
            for o in range(units):
                g_h = h[o * BLOCK : (o + 1) * BLOCK]
                _through_unit(g, network.weights[units * inputs + o], g_h, kept)
                g_w[units * inputs + o] += _dot(g, kept)
                g_b[o] += _sum(g_h)
                for i in range(inputs):
                    g_w[o * inputs + i] += _dot(g_h, x[i * BLOCK : (i + 1) * BLOCK])
            g_b[units] += _sum(g)
            g_x[:] = real(0)
            _add_by_inputs(w1, inputs, units, h, g_x)
            for p in range(count):
                for i in range(inputs):
                    g_encoded[(first + p) * inputs + i] = g_x[i * BLOCK + p]


class _HashMLP(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, table: Tensor, shape: GridShape, *weights: Tensor) -> Tensor:
        w1, b1, w2, b2 = weights
        network = network_of(((w1, b1), (w2, b2)))
        encoded = x.new_empty(-(-len(x) // BLOCK), shape.width * BLOCK)
        out = x.new_empty(len(x))
        share(
            _forward, flat(x), grid_of(table, shape), network, encoded.numpy(), out.numpy(), of=len(encoded)
        )  # fmt: skip
        ctx.save_for_backward(x, table, encoded, *weights)
        ctx.shape = shape
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *g_outputs: Tensor) -> tuple[Tensor | None, ...]:
        if ctx.needs_input_grad[0]:
            raise NotImplementedError(
                "hash_mlp has no gradient by its points; use hash_encode and a network."
            )
        x, table, encoded, *weights = ctx.saved_tensors
        moved = g_outputs[0].nonzero()[:, 0]  # NaN is not zero
        g_encoded = x.new_empty(len(moved), ctx.shape.width)
        w1, b1, w2, b2 = weights
        g_weights = x.new_zeros(SLABS, w1.numel() + w2.numel())
        g_biases = x.new_zeros(SLABS, len(b1) + len(b2))
        share(
            _backward, encoded.numpy(), moved.numpy(), array(g_outputs[0][moved]),
            network_of(((w1, b1), (w2, b2))), flat(g_encoded), g_weights.numpy(), g_biases.numpy(), of=SLABS,
        )  # fmt: skip
        in_place = adds_in_place(table)
        g_table = table.grad if in_place else torch.zeros_like(table, memory_format=torch.contiguous_format)
        add_table_gradient(x[moved], g_encoded, g_table, ctx.shape)
        g_w1, g_w2 = g_weights.sum(0).split([w1.numel(), w2.numel()])
        g_b1, g_b2 = g_biases.sum(0).split([len(b1), len(b2)])
        g_params = (g_w1.view_as(w1), g_b1, g_w2.view_as(w2), g_b2)
        return None, None if in_place else g_table, None, *g_params


def hash_mlp(
    x: Float[Tensor, "n 3"],
    table: Float[Tensor, "rows F"],
    grid: GridShape,
    weights: tuple[Tensor, Tensor, Tensor, Tensor],
) -> Float[Tensor, " n"]:
    """Kernel of `reference.hash_mlp`.  Points are constants: NotImplementedError where they need a gradient.

    Where `table.grad` is there already, a backward pass adds to it in place and hands autograd nothing.
    """
    out: Tensor = _HashMLP.apply(x, table, grid, *weights)
    return out
