"""Numba twin of `reference.ray_mlp`: all layers of a small network in one pass over blocks of points.

At 64 units a layer does so little arithmetic that writing its output to memory costs as much.  Here a block
of points goes through all layers while it is in the first-level cache, and the separate passes for bias, ReLU,
concatenation and their backwards disappear.

Letters: a block has B points; x (I/4, 4, B) and y (O/4, 4, B) are the inputs and outputs of a layer, w its
weights as tiles (O/4 I/4, 4, 4), g the gradient of what it precedes; widths are filled up with zeros to whole
tiles.  Gradients of the weights are summed in a fixed number of slabs of rays, so that they do not depend on
the number of threads.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, no_type_check

import numpy as np
import torch
from jaxtyping import Float
from numba import njit, prange
from torch import Tensor
from torch.autograd.function import once_differentiable

from plnerf.ops.cpu_arrays import FAST, array

BLOCK = 64
SLABS = 16
_SUMS = FAST | {"reassoc"}  # lets LLVM add a block's terms in vectors; the order is still a fixed one


@njit(cache=True, fastmath=FAST)
@no_type_check
def _add_product(w, inputs, x, x_from, y, y_from, outputs):
    """y += w x for some tiles of inputs and outputs: 16 multiply-adds of vectors for 8 loads and 4 stores."""
    for o in range(outputs):
        b = y_from + o
        for i in range(inputs):
            a, t = x_from + i, w[o * inputs + i]
            w00, w01, w02, w03 = t[0, 0], t[0, 1], t[0, 2], t[0, 3]
            w10, w11, w12, w13 = t[1, 0], t[1, 1], t[1, 2], t[1, 3]
            w20, w21, w22, w23 = t[2, 0], t[2, 1], t[2, 2], t[2, 3]
            w30, w31, w32, w33 = t[3, 0], t[3, 1], t[3, 2], t[3, 3]
            for p in range(BLOCK):
                x0, x1, x2, x3 = x[a, 0, p], x[a, 1, p], x[a, 2, p], x[a, 3, p]
                y[b, 0, p] = y[b, 0, p] + w00 * x0 + w01 * x1 + w02 * x2 + w03 * x3
                y[b, 1, p] = y[b, 1, p] + w10 * x0 + w11 * x1 + w12 * x2 + w13 * x3
                y[b, 2, p] = y[b, 2, p] + w20 * x0 + w21 * x1 + w22 * x2 + w23 * x3
                y[b, 3, p] = y[b, 3, p] + w30 * x0 + w31 * x1 + w32 * x2 + w33 * x3


@njit(cache=True, fastmath=_SUMS)
@no_type_check
def _add_outer(g, outputs, x, x_from, inputs, g_w):
    """g_w += g x^T, half a tile at a time."""
    for o in range(outputs):
        for i in range(inputs):
            a, t = x_from + i, g_w[o * inputs + i]
            for half in range(0, 4, 2):
                s0 = s1 = s2 = s3 = t0 = t1 = t2 = t3 = g_w.dtype.type(0)
                for p in range(BLOCK):
                    u, v = g[o, half, p], g[o, half + 1, p]
                    x0, x1, x2, x3 = x[a, 0, p], x[a, 1, p], x[a, 2, p], x[a, 3, p]
                    s0, s1, s2, s3 = s0 + u * x0, s1 + u * x1, s2 + u * x2, s3 + u * x3
                    t0, t1, t2, t3 = t0 + v * x0, t1 + v * x1, t2 + v * x2, t3 + v * x3
                t[half, 0] += s0
                t[half, 1] += s1
                t[half, 2] += s2
                t[half, 3] += s3
                t[half + 1, 0] += t0
                t[half + 1, 1] += t1
                t[half + 1, 2] += t2
                t[half + 1, 3] += t3


@njit(cache=True, fastmath=_SUMS)
@no_type_check
def _add_sums(g, outputs, g_bias):
    """g_bias += the sums of the rows of g."""
    for o in range(outputs):
        for r in range(4):
            total = g_bias.dtype.type(0)
            for p in range(BLOCK):
                total += g[o, r, p]
            g_bias[o, r] += total


@njit(cache=True)
@no_type_check
def _load(source, first, count, row, x):
    """Rows `row`... of x from points first... of the row-major source; points that do not exist are 0."""
    for p in range(count):
        for i in range(source.shape[1]):
            x[(row + i) >> 2, (row + i) & 3, p] = source[first + p, i]
    for i in range(row, row + source.shape[1]):
        for p in range(count, BLOCK):
            x[i >> 2, i & 3, p] = 0


@njit(cache=True)
@no_type_check
def _rectify(y, first, tiles, zero):
    """ReLU of some tiles, in place."""
    for o in range(first, first + tiles):
        for r in range(4):
            for p in range(BLOCK):
                y[o, r, p] = max(y[o, r, p], zero)


@njit(cache=True)
@no_type_check
def _slab(slab, rays):
    """First ray of a slab, and the one after its last."""
    return rays * slab // SLABS, rays * (slab + 1) // SLABS


@njit(parallel=True, cache=True, fastmath=FAST)
@no_type_check
def _forward(x, const, base, samples, sizes, weights, biases, hidden, firsts, out):  # noqa: PLR0913 (no structs here)
    """hidden (blocks, tiles, 4, B): what the layers put out, kept for the backward; `firsts` each slab's
    first block, -1 where a slab shall use block number `slab` again and again (nothing is kept)."""
    rays, real, depth = base.shape[0], base.dtype.type, len(sizes) - 1
    for slab in prange(SLABS):
        first_ray, end_ray = _slab(slab, rays)
        end = end_ray * samples
        xs = np.zeros((sizes[0], 4, BLOCK), base.dtype)
        y = np.zeros((sizes[depth], 4, BLOCK), base.dtype)
        block = firsts[slab]
        for first in range(first_ray * samples, end, BLOCK):
            count = min(BLOCK, end - first)
            _load(x, first, count, 0, xs)
            _load(const, first, count, x.shape[1], xs)
            h = hidden[block] if block >= 0 else hidden[slab]
            block += block >= 0
            h[sizes[1] - 1] = 0  # the padding
            p = 0
            while p < count:  # the samples of one ray after another
                ray = (first + p) // samples
                stop = min((ray + 1) * samples - first, count)
                for o in range(base.shape[1]):
                    for q in range(p, stop):
                        h[o >> 2, o & 3, q] = base[ray, o]
                p = stop
            for o in range(base.shape[1]):
                for q in range(count, BLOCK):
                    h[o >> 2, o & 3, q] = 0
            _add_product(weights, sizes[0], xs, 0, h, 0, sizes[1])
            _rectify(h, 0, sizes[1], real(0))
            start, stop, w = 0, sizes[1], sizes[0] * sizes[1]
            for layer in range(1, depth):
                tiles = sizes[layer + 1]
                last = layer == depth - 1
                to, row = (y, 0) if last else (h, stop)
                for o in range(tiles):
                    for r in range(4):
                        to[row + o, r] = biases[stop + o, r]
                _add_product(weights[w:], sizes[layer], h, start, to, row, tiles)
                if not last:
                    _rectify(to, row, tiles, real(0))
                start, stop, w = stop, stop + tiles, w + sizes[layer] * tiles
            for p in range(count):
                for o in range(out.shape[1]):
                    out[first + p, o] = y[o >> 2, o & 3, p]


@njit(parallel=True, cache=True, fastmath=FAST)
@no_type_check
def _backward(  # noqa: PLR0913 (a kernel has no structs)
    x, const, samples, sizes, transposed, hidden, firsts, g_out, g_x, g_base, g_weights, g_biases
):
    """g_weights, g_biases have a slab each in their first axis; the caller adds up."""
    rays, depth, real = g_base.shape[0], len(sizes) - 1, g_base.dtype.type
    for slab in prange(SLABS):
        first_ray, end_ray = _slab(slab, rays)
        end = end_ray * samples
        xs = np.zeros((sizes[0], 4, BLOCK), g_base.dtype)
        g = np.zeros((sizes.max(), 4, BLOCK), g_base.dtype)
        before = np.zeros((sizes.max(), 4, BLOCK), g_base.dtype)
        block = firsts[slab]
        for first in range(first_ray * samples, end, BLOCK):
            count = min(BLOCK, end - first)
            _load(x, first, count, 0, xs)
            _load(const, first, count, x.shape[1], xs)
            h = hidden[block]
            block += 1
            g[sizes[depth] - 1] = 0  # the padding
            _load(g_out, first, count, 0, g)
            start, w = hidden.shape[1], len(transposed)
            for back in range(depth - 1):
                layer = depth - 1 - back
                tiles, above = sizes[layer], sizes[layer + 1]
                _add_sums(g, above, g_biases[slab, start:])
                start, w = start - tiles, w - tiles * above
                _add_outer(g, above, h, start, tiles, g_weights[slab, w:])
                before[:tiles] = 0
                _add_product(transposed[w:], above, g, 0, before, 0, tiles)
                for i in range(tiles):
                    for r in range(4):
                        for p in range(BLOCK):
                            before[i, r, p] = before[i, r, p] if h[start + i, r, p] > 0 else real(0)
                g, before = before, g
            _add_outer(g, sizes[1], xs, 0, sizes[0], g_weights[slab])
            p = 0
            while p < count:
                ray = (first + p) // samples
                stop = min((ray + 1) * samples - first, count)
                for o in range(g_base.shape[1]):
                    total = real(0)
                    for q in range(p, stop):
                        total += g[o >> 2, o & 3, q]
                    g_base[ray, o] += total
                p = stop
            wanted = -(-g_x.shape[1] // 4)
            before[:wanted] = 0
            _add_product(transposed, sizes[1], g, 0, before, 0, wanted)
            for p in range(count):
                for i in range(g_x.shape[1]):
                    g_x[first + p, i] = before[i >> 2, i & 3, p]


def _tiles(matrices: Sequence[np.ndarray]) -> np.ndarray:
    """Weights (O, I), filled up with zeros, as tiles (sum of O/4 I/4, 4, 4): one layer after another."""
    tiles = []
    for w in matrices:
        full = np.pad(w, [(0, -size % 4) for size in w.shape])
        outputs, inputs = full.shape
        tiles.append(full.reshape(outputs // 4, 4, inputs // 4, 4).swapaxes(1, 2).reshape(-1, 4, 4))
    return np.concatenate(tiles)


def _rows(vectors: Sequence[np.ndarray]) -> np.ndarray:
    """Biases (O,), filled up with zeros, as (sum of O/4, 4)."""
    return np.concatenate([np.pad(b, (0, -len(b) % 4)) for b in vectors]).reshape(-1, 4)


def _blocks(rays: int, samples: int) -> np.ndarray:
    """First block of every slab and, last, their number."""
    edges = rays * np.arange(SLABS + 1) // SLABS * samples
    return np.concatenate([[0], np.cumsum(-(-np.diff(edges) // BLOCK))])


class _RayMLP(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, const: Tensor, base: Tensor, *params: Tensor) -> Tensor:
        rays, samples = x.shape[:2]
        matrices = [array(w) for w in (params[0], *params[1::2])]
        # The first layer's bias is `base`: its place is kept, so that biases count like hidden units.
        vectors = [np.zeros_like(matrices[0][:, 0]), *(array(b) for b in params[2::2])]
        sizes = np.array([-(-n // 4) for n in (matrices[0].shape[1], *(len(w) for w in matrices))])
        kept = any(ctx.needs_input_grad)
        blocks = _blocks(rays, samples)
        firsts, count = (blocks[:-1], int(blocks[-1])) if kept else (np.full(SLABS, -1), SLABS)
        hidden = x.new_empty(count, int(sizes[1:-1].sum()), 4, BLOCK)
        out = x.new_empty(rays * samples, len(matrices[-1]))
        _forward(
            array(x.flatten(0, 1)), array(const.flatten(0, 1)), array(base), samples, sizes, _tiles(matrices),
            _rows(vectors), hidden.numpy(), firsts, out.numpy(),
        )  # fmt: skip
        if kept:
            ctx.save_for_backward(x, const, base, hidden, *params)
            ctx.firsts, ctx.sizes = firsts, sizes
        return out.unflatten(0, (rays, samples))

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *g_outputs: Tensor) -> tuple[Tensor | None, ...]:
        x, const, base, hidden, *params = ctx.saved_tensors
        matrices, sizes = [array(w) for w in (params[0], *params[1::2])], ctx.sizes
        # Each layer's tiles transposed, the layers in their order.
        transposed = _tiles([w.T for w in matrices])
        g_weights = np.zeros((SLABS, *transposed.shape), transposed.dtype)
        g_biases = np.zeros((SLABS, int(sizes[1:].sum()), 4), transposed.dtype)
        wanted = x.shape[2] if ctx.needs_input_grad[0] else 0
        g_x, g_base = x.new_empty(*x.shape[:2], wanted), torch.zeros_like(base)
        _backward(
            array(x.flatten(0, 1)), array(const.flatten(0, 1)), x.shape[1], sizes, transposed, hidden.numpy(),
            ctx.firsts, array(g_outputs[0].flatten(0, 1)), g_x.flatten(0, 1).numpy(), g_base.numpy(),
            g_weights, g_biases,
        )  # fmt: skip
        tiles, rows = g_weights.sum(0), g_biases.sum(0)
        g_params: list[Tensor] = []
        for (inputs, outputs), w in zip(pairwise(sizes.tolist()), matrices, strict=True):
            mine, tiles = tiles[: inputs * outputs].reshape(outputs, inputs, 4, 4), tiles[inputs * outputs :]
            whole = mine.swapaxes(1, 2).reshape(outputs * 4, inputs * 4)
            bias, rows = rows[:outputs].reshape(-1), rows[outputs:]
            g_params += [torch.from_numpy(whole[: len(w), : w.shape[1]]), torch.from_numpy(bias[: len(w)])]
        del g_params[1]  # the first layer's bias is `base`
        return g_x if wanted else None, None, g_base, *g_params


def ray_mlp(
    x: Float[Tensor, "r S I"],
    const: Float[Tensor, "r S J"],
    base: Float[Tensor, "r H"],
    weights: Sequence[Tensor],
) -> Float[Tensor, "r S O"]:
    """Twin of `reference.ray_mlp`; the gradient by `const` is left out unless it is asked for."""
    if const.requires_grad:
        x, const = torch.cat([x, const], -1), const[..., :0]
    out: Tensor = _RayMLP.apply(x, const, base, *weights)
    return out
