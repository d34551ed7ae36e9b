"""Numba kernels of what keeps thin things in histograms: blur and dilation, each in one pass over a ray.

The references are in plain torch in `rays/histograms.py`; edges are constants here.  Letters as there: s the
E = S + 1 edges, increasing; w the S weights.
"""

from collections.abc import Callable
from typing import Any, no_type_check

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from plnerf.ops.cpu_arrays import FAST
from plnerf.ops.kernel_cache import njit
from plnerf.ops.launch import arrays, launch

FLOOR = 1e-5
"""As in the reference, which is above this room."""


@njit(cache=True, fastmath=FAST, error_model="numpy")
@no_type_check
def _blurred(  # noqa: PLR0913 (a kernel's arrays, one by one)
    s, w, s_proposal, w_proposal, h, loss, gradient, start, stop
):
    # All sums in double: the integral of the distribution function is needed to much less than h.
    S, P = w.shape[1], w_proposal.shape[1]
    density, below, area = np.empty(S + 1), np.empty(S + 1), np.empty(S + 1)
    for ray in range(start, stop):
        below[0] = area[0] = density[S] = 0.0
        for i in range(S):
            width = np.float64(s[ray, i + 1]) - np.float64(s[ray, i])
            weight = np.float64(w[ray, i])
            density[i] = weight / width if width > 0.0 else 0.0
            below[i + 1] = below[i] + weight
            area[i + 1] = area[i] + (below[i + 1] + below[i]) * 0.5 * width
        last_low = last_high = 0
        before = lost = 0.0
        for j in range(P + 1):
            # The last edges of s at or before x - h and at or before x + h.
            low, high = np.float64(s_proposal[ray, j]) - h, np.float64(s_proposal[ray, j]) + h
            while last_low < S and s[ray, last_low + 1] <= low:
                last_low += 1
            while last_high < S and s[ray, last_high + 1] <= high:
                last_high += 1
            past = max(high - s[ray, last_high], 0.0)
            if h == 0.0:
                now = below[last_high] + density[last_high] * past
            else:
                upper = area[last_high] + past * (below[last_high] + density[last_high] * past * 0.5)
                past = max(low - s[ray, last_low], 0.0)
                lower = area[last_low] + past * (below[last_low] + density[last_low] * past * 0.5)
                now = (upper - lower) / (2.0 * h)
            if j > 0:
                excess = now - before - w_proposal[ray, j - 1]
                gradient[ray, j - 1] = 0.0
                if excess > 0.0:
                    share = excess / (w_proposal[ray, j - 1] + FLOOR)
                    lost += excess * share
                    gradient[ray, j - 1] = -share * (2.0 + share)
            before = now
        loss[ray] = lost


@njit(cache=True, fastmath=FAST, error_model="numpy")
@no_type_check
def _dilate(s, w, h, out, start, stop):
    # Intervals come within reach and go out of it in their order: those that may yet be the densest wait in a
    # queue of decreasing density, the densest of all within reach at its head.
    S, real = w.shape[1], s.dtype.type
    zero, one, h, eps = real(0), real(1), real(h), real(np.finfo(s.dtype).eps)
    density, queue = np.empty(S, s.dtype), np.empty(S, np.int64)
    for ray in range(start, stop):
        for i in range(S):
            density[i] = w[ray, i] / max(s[ray, i + 1] - s[ray, i], eps)
        head = tail = coming = leaving = 0
        x, total, spread_total = s[ray, 0], zero, zero
        for i in range(S):
            spread = zero
            while x < s[ray, i + 1]:
                while coming < S and s[ray, coming] - h <= x:
                    while tail > head and density[queue[tail - 1]] <= density[coming]:
                        tail -= 1
                    queue[tail] = coming
                    tail += 1
                    coming += 1
                while leaving < S and s[ray, leaving + 1] + h <= x:
                    leaving += 1
                while queue[head] < leaving:
                    head += 1
                to = min(s[ray, i + 1], s[ray, leaving + 1] + h)
                if coming < S:
                    to = min(to, s[ray, coming] - h)
                spread += density[queue[head]] * (to - x)
                x = to
            out[ray, i] = max(spread, w[ray, i])
            total += w[ray, i]
            spread_total += out[ray, i]
        scale = total / spread_total if spread_total > zero else one
        for i in range(S):
            out[ray, i] *= scale


class _WithGradient(torch.autograd.Function):
    """A loss of rays, differentiable by weights, once, whose kernel writes the loss and its gradient."""

    @staticmethod
    def forward(ctx: Any, w: Tensor, kernel: Callable[[Tensor, Tensor], None]) -> Tensor:
        loss, gradient = w.new_empty(len(w)), torch.empty_like(w, memory_format=torch.contiguous_format)
        kernel(loss, gradient)
        ctx.save_for_backward(gradient)
        return loss

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *g_outputs: Tensor) -> tuple[Tensor, None]:
        (gradient,) = ctx.saved_tensors
        return g_outputs[0][:, None] * gradient, None


def blurred_interlevel_loss(
    s: Float[Tensor, "r E"],
    w: Float[Tensor, "r S"],
    s_proposal: Float[Tensor, "r F"],
    w_proposal: Float[Tensor, "r P"],
    half_width: float,
) -> Float[Tensor, " r"]:
    """Kernel of `histograms.blurred_interlevel_loss`: differentiable by w_proposal alone."""

    def kernel(loss: Tensor, gradient: Tensor) -> None:
        *inputs, out, slope = arrays(s, w, s_proposal, w_proposal, loss, gradient)
        launch(
            _blurred, *inputs, float(half_width), out, slope,
            rays=len(s), samples=w.numel() + w_proposal.numel(), ns=8.0,
        )  # fmt: skip

    result: Tensor = _WithGradient.apply(w_proposal, kernel)
    return result


def dilate(s: Float[Tensor, "r E"], w: Float[Tensor, "r S"], half_width: float) -> Float[Tensor, "r S"]:
    """Kernel of `histograms.dilate`.  No gradient flows: samples are constants."""
    out = torch.empty_like(w, memory_format=torch.contiguous_format)
    s_array, w_array, out_array = arrays(s, w, out)
    launch(
        _dilate, s_array, w_array, float(half_width), out_array,
        rays=len(s), samples=w.numel(), ns=20.0,
    )  # fmt: skip
    return out
