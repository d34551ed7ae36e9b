"""Numba kernel of `reference.ray_mlp`: all layers of a small network in one pass over blocks of points.

At 64 units a layer does so little arithmetic that writing its output to memory costs as much.  Here a
block of points goes through all layers while it is in the first-level cache, and the separate passes for
bias, ReLU, concatenation and their backwards disappear.

Letters: B points of a block, I and O inputs and outputs of a layer; "wide" numbers are rounded up to whole
vectors of 16.  Arrays in a kernel are flat.  Gradients of the weights are summed in a fixed number of slabs
of rays, so that they do not depend on the number of threads.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any, no_type_check

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from plnerf.ops.cpu_arrays import FAST, array, flat
from plnerf.ops.cpu_products import add_products
from plnerf.ops.kernel_cache import INNER, njit
from plnerf.ops.threads import share

BLOCK = 64
SLABS = 16
_ROWS, _START, _STEP = np.int64(BLOCK), np.int64(0), np.int64(1)
"""NumPy integers, not Python's: for each constant of these Numba would compile a function anew."""
_FLAGS = {"fastmath": FAST, "error_model": "numpy", "cache": True}
_INNER = _FLAGS | INNER


@njit(**_INNER)
@no_type_check
def _multiply(out, out_first, rows, width, s, s_first, s_stride, s_step, v, v_first, terms):  # noqa: PLR0913 (a kernel's arrays, one by one)
    """out (rows, width) += s (rows, terms) v (terms, width); rows a multiple of 8, width of 16."""
    for c in range(0, width - 31, 32):
        for a in range(0, rows, 8):
            add_products(
                out, out_first + a * width + c, width, s, s_first + a * s_stride, s_stride, s_step,
                v, v_first + c, width, terms, 8, 32,
            )  # fmt: skip
    if width & 16:
        for a in range(0, rows, 8):
            add_products(
                out, out_first + (a + 1) * width - 16, width, s, s_first + a * s_stride, s_stride, s_step,
                v, v_first + width - 16, width, terms, 8, 16,
            )  # fmt: skip


@njit(**_INNER)
@no_type_check
def _load(source, columns, first, count, to, column, width):
    """Rows first... of a (points, columns) array into columns of (B, width); what there is not is 0."""
    for p in range(BLOCK):
        row = to[p * width + column : p * width + column + columns]
        if p < count:
            _copy(source[(first + p) * columns : (first + p + 1) * columns], row)
        else:
            row[:] = 0


@njit(**_INNER)
@no_type_check
def _copy(source, to):
    # Of slices, since LLVM makes vector code of loops whose places begin at 0.
    for i in range(to.size):
        to[i] = source[i]


@njit(**_INNER)
@no_type_check
def _add(source, to):
    for i in range(to.size):
        to[i] += source[i]


@njit(**_INNER)
@no_type_check
def _rectify(h):
    for i in range(h.size):
        h[i] = max(h[i], h.dtype.type(0))


@njit(**_INNER)
@no_type_check
def _stop(g, h):
    # No gradient goes where h, what came out of a ReLU, is 0.
    for i in range(g.size):
        g[i] = g[i] if h[i] > 0 else 0


@njit(**_FLAGS)
@no_type_check
def _forward(  # noqa: PLR0913 (a kernel's arrays, one by one)
    x, const, base, samples, sizes, wide, weights, biases, hidden, firsts, out, first_slab, stop_slab
):
    """hidden (blocks, B sum(H)): what the layers put out, kept for the backward; `firsts` each slab's first
    block, -1 where a slab shall use block number `slab` again and again (nothing is kept)."""
    depth = len(sizes) - 2
    units, inputs = sizes[2], sizes[0] + sizes[1]
    rays = base.size // units
    for slab in range(first_slab, stop_slab):
        end = rays * (slab + 1) // SLABS * samples
        xs = np.zeros(BLOCK * wide[0], base.dtype)
        y = np.zeros(BLOCK * wide[depth], base.dtype)
        block = firsts[slab]
        for first in range(rays * slab // SLABS * samples, end, BLOCK):
            count = min(BLOCK, end - first)
            _load(x, sizes[0], first, count, xs, _START, wide[0])
            _load(const, sizes[1], first, count, xs, sizes[0], wide[0])
            h = hidden[block] if block >= 0 else hidden[slab]
            block += block >= 0
            width = wide[1]
            for p in range(BLOCK):
                ray = (first + min(p, count - 1)) // samples
                _copy(base[ray * units : (ray + 1) * units], h[p * width : p * width + units])
                h[p * width + units : (p + 1) * width] = 0
            _multiply(h, _START, _ROWS, width, xs, _START, wide[0], _STEP, weights, _START, inputs)
            start, stop, w, b = 0, BLOCK * width, inputs * width, 0
            for layer in range(1, depth):
                _rectify(h[start:stop])
                terms, width = sizes[layer + 1], wide[layer + 1]
                to, at = (y, 0) if layer == depth - 1 else (h, stop)
                for p in range(BLOCK):
                    _copy(biases[b : b + width], to[at + p * width : at + (p + 1) * width])
                _multiply(to, at, _ROWS, width, h, start, wide[layer], _STEP, weights, w, terms)
                start, stop, w, b = stop, stop + BLOCK * width, w + terms * width, b + width
            results = sizes[depth + 1]
            for p in range(count):
                row = y[p * wide[depth] : p * wide[depth] + results]
                _copy(row, out[(first + p) * results : (first + p + 1) * results])


@njit(**_FLAGS)
@no_type_check
def _backward(  # noqa: PLR0913 (a kernel's arrays, one by one)
    x, const, samples, sizes, wide, weights, hidden, firsts, g_out, g_x, g_base, g_weights, g_biases,
    first_slab, stop_slab,
):  # fmt: skip
    """weights are those of the layers, (O, wide I); g_weights, (wide O, wide I), and g_biases have a slab
    each in their first axis; the caller adds up."""
    depth, units = len(sizes) - 2, sizes[2]
    rays, widest = g_base.size // units, 0
    for width in wide:
        widest = max(widest, width)
    for slab in range(first_slab, stop_slab):
        end = rays * (slab + 1) // SLABS * samples
        xs = np.zeros(BLOCK * wide[0], g_base.dtype)
        g = np.zeros(BLOCK * widest, g_base.dtype)
        before = np.zeros(BLOCK * widest, g_base.dtype)
        g_w, g_b = g_weights[slab], g_biases[slab]
        block = firsts[slab]
        for first in range(rays * slab // SLABS * samples, end, BLOCK):
            count = min(BLOCK, end - first)
            _load(x, sizes[0], first, count, xs, _START, wide[0])
            _load(const, sizes[1], first, count, xs, sizes[0], wide[0])
            h = hidden[block]
            block += 1
            g[: BLOCK * wide[depth]] = 0
            _load(g_out, sizes[depth + 1], first, count, g, _START, wide[depth])
            start, w, to, b = h.size, len(weights), g_w.size, g_b.size
            for back in range(depth - 1):
                layer = depth - 1 - back
                outputs, above, width = sizes[layer + 2], wide[layer + 1], wide[layer]
                start, w, to, b = start - BLOCK * width, w - outputs * width, to - above * width, b - above
                for p in range(BLOCK):
                    _add(g[p * above : (p + 1) * above], g_b[b : b + above])
                _multiply(g_w, to, above, width, g, _START, _STEP, above, h, start, _ROWS)
                before[: BLOCK * width] = 0
                _multiply(before, _START, _ROWS, width, g, _START, above, _STEP, weights, w, outputs)
                _stop(before[: BLOCK * width], h[start : start + BLOCK * width])
                g, before = before, g
            above, width = wide[1], wide[0]
            _multiply(g_w, _START, above, width, g, _START, _STEP, above, xs, _START, _ROWS)
            for p in range(count):
                ray = (first + p) // samples
                _add(g[p * above : p * above + units], g_base[ray * units : (ray + 1) * units])
            if g_x.size:
                before[: BLOCK * width] = 0
                _multiply(before, _START, _ROWS, width, g, _START, above, _STEP, weights, _START, units)
                for p in range(count):
                    row = before[p * width : p * width + sizes[0]]
                    _copy(row, g_x[(first + p) * sizes[0] : (first + p + 1) * sizes[0]])


def _joined(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Matrices, or vectors, one after another, their rows filled up with zeros to whole vectors."""
    shapes = [(part.size // part.shape[-1], -(-part.shape[-1] // 16) * 16) for part in parts]
    joined = np.zeros(sum(rows * width for rows, width in shapes), parts[0].dtype)
    at = 0
    for part, (rows, width) in zip(parts, shapes, strict=True):
        joined[at : at + rows * width].reshape(rows, width)[:, : part.shape[-1]] = part
        at += rows * width
    return joined


@cache
def _blocks(rays: int, samples: int) -> np.ndarray:
    """First block of every slab and, last, their number."""
    edges = rays * np.arange(SLABS + 1) // SLABS * samples
    return np.concatenate([[0], np.cumsum(-(-np.diff(edges) // BLOCK))])


class _RayMLP(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, const: Tensor, base: Tensor, *params: Tensor) -> Tensor:
        rays, samples = x.shape[:2]
        matrices = [array(w) for w in (params[0], *params[1::2])]
        # Of x, const and every layer's outputs; and of the layers' inputs and the last one's outputs.
        sizes = np.array([x.shape[2], const.shape[2], *(len(w) for w in matrices)])
        wide = np.array([-(-size // 16) * 16 for size in (sizes[0] + sizes[1], *sizes[2:])])
        kept = any(ctx.needs_input_grad)
        blocks = _blocks(rays, samples)
        firsts, count = (blocks[:-1], int(blocks[-1])) if kept else (np.full(SLABS, -1), SLABS)
        hidden = x.new_empty(count, BLOCK * int(wide[1:-1].sum()))
        out = x.new_empty(rays, samples, int(sizes[-1]))
        share(
            _forward, flat(x), flat(const), flat(base), samples, sizes, wide,
            _joined([w.T for w in matrices]), _joined([array(b) for b in params[2::2]]), hidden.numpy(),
            firsts, flat(out), of=SLABS,
        )  # fmt: skip
        if kept:
            ctx.save_for_backward(x, const, base, hidden, *params)
            ctx.firsts, ctx.sizes, ctx.wide = firsts, sizes, wide
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *g_outputs: Tensor) -> tuple[Tensor | None, ...]:
        x, const, base, hidden, *params = ctx.saved_tensors
        matrices, sizes, wide = [array(w) for w in (params[0], *params[1::2])], ctx.sizes, ctx.wide
        g_weights = x.new_zeros(SLABS, int((wide[1:] * wide[:-1]).sum()))
        g_biases = x.new_zeros(SLABS, int(wide[2:].sum()))
        g_x = x.new_empty(x.shape if ctx.needs_input_grad[0] else (0,))
        g_base = torch.zeros_like(base, memory_format=torch.contiguous_format)
        share(
            _backward, flat(x), flat(const), x.shape[1], sizes, wide, _joined(matrices), hidden.numpy(),
            ctx.firsts, flat(g_outputs[0]), flat(g_x), flat(g_base), g_weights.numpy(), g_biases.numpy(),
            of=SLABS,
        )  # fmt: skip
        areas = (wide[1:] * wide[:-1]).tolist()
        g_params: list[Tensor] = []
        for w, g_w, inputs in zip(matrices, g_weights.sum(0).split(areas), wide[:-1], strict=True):
            g_params.append(g_w.view(-1, int(inputs))[: w.shape[0], : w.shape[1]])
        for i, g_b in enumerate(g_biases.sum(0).split(wide[2:].tolist())):
            g_params.insert(2 * i + 2, g_b[: len(matrices[i + 1])])
        return g_x if ctx.needs_input_grad[0] else None, None, g_base, *g_params


def ray_mlp(
    x: Float[Tensor, "r S I"],
    const: Float[Tensor, "r S J"],
    base: Float[Tensor, "r H"],
    weights: Sequence[Tensor],
) -> Float[Tensor, "r S O"]:
    """Kernel of `reference.ray_mlp`; the gradient by `const` is left out unless it is asked for."""
    if const.requires_grad:
        x, const = torch.cat([x, const], -1), const[..., :0]
    out: Tensor = _RayMLP.apply(x, const, base, *weights)
    return out
