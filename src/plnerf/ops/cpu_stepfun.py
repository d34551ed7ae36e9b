"""Numba kernels of the step functions along rays: resampling in one pass, losses with closed-form gradients.

The references are in plain torch in `rays/stepfun.py`; edges are constants here.  Letters as there: s the
E = S + 1 edges, increasing; w the S weights.  Where one sorted list is searched in another, two fingers walk
along both.
"""

from typing import Any, no_type_check

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from plnerf.ops.cpu_arrays import FAST
from plnerf.ops.cpu_math import power
from plnerf.ops.kernel_cache import njit
from plnerf.ops.launch import arrays, launch, refuse_gradients


@njit(cache=True, fastmath=FAST, error_model="numpy")
@no_type_check
def _resample(s, w, u, padding, anneal, edges, start, stop):
    S, count, real = w.shape[1], u.shape[1], s.dtype.type
    zero, half, one = real(0), real(0.5), real(1)
    padding, anneal = real(padding), real(anneal)
    cdf = np.empty(S + 1, s.dtype)
    for ray in range(start, stop):
        for i in range(S):
            cdf[i + 1] = w[ray, i]
        if anneal != one:
            for i in range(S):
                cdf[i + 1] = power(cdf[i + 1], anneal)
        total = zero
        for i in range(S):
            total += cdf[i + 1] + padding
            cdf[i + 1] = total
        cdf[0] = zero
        for i in range(S):
            cdf[i + 1] /= total
        upper = 1
        for i in range(count):
            level = u[ray, i]
            while upper < S and cdf[upper] <= level:
                upper += 1
            width = cdf[upper] - cdf[upper - 1]
            share = (level - cdf[upper - 1]) / width if width > zero else half
            share = max(min(share, one), zero)
            edges[ray, i] = s[ray, upper - 1] + share * (s[ray, upper] - s[ray, upper - 1])


@njit(cache=True, fastmath=FAST, error_model="numpy")
@no_type_check
def _interlevel(s, w, s_proposal, w_proposal, loss, gradient, start, stop):
    S, P, real = w.shape[1], w_proposal.shape[1], s.dtype.type
    zero, two, eps = real(0), real(2), real(np.finfo(s.dtype).eps)
    total, slope = np.empty(P + 1, s.dtype), np.empty(P + 1, s.dtype)
    for ray in range(start, stop):
        total[0] = slope[0] = zero
        for j in range(P):
            total[j + 1] = total[j] + w_proposal[ray, j]
            slope[j + 1] = zero
        # below: proposal edges at or before s_i; below_next: before s_{i+1}.
        below = below_next = 0
        lost = zero
        for i in range(S):
            while below <= P and s_proposal[ray, below] <= s[ray, i]:
                below += 1
            while below_next <= P and s_proposal[ray, below_next] < s[ray, i + 1]:
                below_next += 1
            low, high = max(below - 1, 0), min(below_next, P)
            excess = w[ray, i] - (total[high] - total[low])
            if excess > zero:
                share = excess / (w[ray, i] + eps)
                lost += excess * share
                slope[low] -= two * share
                slope[high] += two * share
        loss[ray] = lost
        running = zero
        for j in range(P):
            running += slope[j]
            gradient[ray, j] = running


@njit(cache=True, fastmath=FAST, error_model="numpy")
@no_type_check
def _distortion(s, w, loss, gradient, start, stop):
    # gradient_k = 2 sum_i w_i |m_i - m_k| + 2/3 w_k width_k, by two walks that add only what is positive: the
    # sum grows by (weight passed) (m_{k+1} - m_k).  The loss is quadratic: half of sum_k w_k gradient_k.
    S, real = w.shape[1], s.dtype.type
    zero, half, two, two_thirds = real(0), real(0.5), real(2), real(2 / 3)
    for ray in range(start, stop):
        passed = moment = zero
        for k in range(S):
            width = s[ray, k + 1] - s[ray, k]
            gradient[ray, k] = two * moment + two_thirds * w[ray, k] * width
            passed += w[ray, k]
            if k + 1 < S:
                moment += passed * (s[ray, k + 2] - s[ray, k]) * half
        passed = moment = doubled = zero
        for k in range(S - 1, -1, -1):
            gradient[ray, k] += two * moment
            doubled += w[ray, k] * gradient[ray, k]
            passed += w[ray, k]
            if k > 0:
                moment += passed * (s[ray, k + 1] - s[ray, k - 1]) * half
        loss[ray] = half * doubled


class _Interlevel(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, s: Tensor, w: Tensor, s_proposal: Tensor, w_proposal: Tensor) -> Tensor:
        loss, gradient = s.new_empty(len(s)), s.new_empty(w_proposal.shape)
        launch(
            _interlevel, *arrays(s, w, s_proposal, w_proposal, loss, gradient),
            rays=len(s), samples=w.numel() + w_proposal.numel(), ns=3.0,
        )  # fmt: skip
        ctx.save_for_backward(gradient)
        return loss

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *g_outputs: Tensor) -> tuple[None, None, None, Tensor]:
        (gradient,) = ctx.saved_tensors
        return None, None, None, g_outputs[0][:, None] * gradient


class _Distortion(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, s: Tensor, w: Tensor) -> Tensor:
        loss, gradient = s.new_empty(len(s)), torch.empty_like(w, memory_format=torch.contiguous_format)
        launch(
            _distortion, *arrays(s, w, loss, gradient),
            rays=len(s), samples=w.numel(), ns=2.0,
        )  # fmt: skip
        ctx.save_for_backward(gradient)
        return loss

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *g_outputs: Tensor) -> tuple[None, Tensor]:
        (gradient,) = ctx.saved_tensors
        return None, g_outputs[0][:, None] * gradient


def resample_edges(
    s: Float[Tensor, "r E"],
    w: Float[Tensor, "r S"],
    u: Float[Tensor, "r n"],
    padding: float,
    anneal: float | Tensor = 1.0,
) -> Float[Tensor, "r n"]:
    """Kernel of `stepfun.resample_edges`: edges at levels u of the distribution of w^anneal, 0 < anneal <= 1.

    Levels increase along a ray.  No gradient flows: samples are constants.
    """
    edges = torch.empty_like(u, memory_format=torch.contiguous_format)
    s_array, w_array, u_array, out = arrays(s, w, u, edges)
    launch(
        _resample, s_array, w_array, u_array, padding, float(anneal), out,
        rays=len(s), samples=w.numel() + u.numel(), ns=2.0,
    )  # fmt: skip
    return edges


def interlevel_loss(
    s: Float[Tensor, "r E"],
    w: Float[Tensor, "r S"],
    s_proposal: Float[Tensor, "r F"],
    w_proposal: Float[Tensor, "r P"],
) -> Float[Tensor, " r"]:
    """Kernel of `stepfun.interlevel_loss`: differentiable by w_proposal, once; all else is a constant."""
    loss: Tensor = _Interlevel.apply(s.detach(), w.detach(), s_proposal.detach(), w_proposal)
    return loss


def distortion_loss(s: Float[Tensor, "r E"], w: Float[Tensor, "r S"]) -> Float[Tensor, " r"]:
    """Kernel of `stepfun.distortion_loss`: differentiable by w, once."""
    refuse_gradients("distortion_loss", s=s)
    loss: Tensor = _Distortion.apply(s, w)
    return loss
