"""Triton kernels of the step functions along rays: a program for each ray.

The references are in plain torch in `rays/stepfun.py`, the closed-form gradients in `cpu_stepfun.py`; edges
are constants here.  One list is searched in another by comparing all with all, sixteen at a time: for a few
hundred edges that is less than a search costs that goes to memory at every step.

What Triton compiles is marked no_type_check: a wrapper that checks annotations cannot be compiled.
"""

from typing import Any, no_type_check

import torch
import triton
import triton.language as tl
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from plnerf.ops.cuda_launch import contiguous, on_each_ray
from plnerf.ops.launch import refuse_gradients

AT_ONCE = 16


@triton.jit
@no_type_check
def _resample(  # noqa: PLR0913 (a kernel's arrays, one by one)
    s, w, u, anneal, edges, S, count, PADDING: tl.constexpr, AT_ONCE: tl.constexpr, BLOCK: tl.constexpr
):
    ray, i = tl.program_id(0).to(tl.int64), tl.arange(0, BLOCK)
    weight = tl.load(w + ray * S + i, mask=i < S, other=0.0)
    exponent = tl.load(anneal).to(weight.dtype)
    raised = tl.where(weight > 0, tl.exp(exponent * tl.log(tl.where(weight > 0, weight, 1.0))), weight)
    padded = tl.where(i < S, tl.where(exponent == 1, weight, raised) + PADDING, 0.0)
    cdf = tl.cumsum(padded, 0) / tl.sum(padded, 0)  # at the upper end of each interval
    s += ray * (S + 1)
    for begin in range(0, count, AT_ONCE):
        k = begin + tl.arange(0, AT_ONCE)
        level = tl.load(u + ray * count + k, mask=k < count, other=0.0)
        passed = (cdf[None, :] <= level[:, None]) & (i < S - 1)[None, :]
        open_ = (cdf[None, :] > level[:, None]) & (i < S - 1)[None, :]
        at = tl.sum(passed.to(tl.int32), 1)
        low = tl.max(tl.where(passed, cdf[None, :], 0.0), 1)
        high = tl.min(tl.where(open_, cdf[None, :], 1.0), 1)
        width = high - low
        share = tl.where(width > 0, (level - low) / tl.where(width > 0, width, 1.0), 0.5)
        share = tl.minimum(tl.maximum(share, 0.0), 1.0)
        s0, s1 = tl.load(s + at, mask=k < count, other=0.0), tl.load(s + at + 1, mask=k < count, other=0.0)
        tl.store(edges + ray * count + k, s0 + share * (s1 - s0), mask=k < count)


@triton.jit
@no_type_check
def _interlevel(  # noqa: PLR0913 (a kernel's arrays, one by one)
    s, w, s_proposal, w_proposal, loss, gradient, S, P,
    EPS: tl.constexpr, AT_ONCE: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    """BLOCK holds the proposal's P + 1 edges; an edge that is not there lies behind all others."""
    ray, j = tl.program_id(0).to(tl.int64), tl.arange(0, BLOCK)
    edge = tl.load(s_proposal + ray * (P + 1) + j, mask=j <= P, other=float("inf"))
    weight = tl.load(w_proposal + ray * P + j, mask=j < P, other=0.0)
    lost, slope = tl.sum(tl.zeros_like(weight), 0), tl.zeros_like(weight)
    for begin in range(0, S, AT_ONCE):
        i = begin + tl.arange(0, AT_ONCE)
        there = i < S
        from_ = tl.load(s + ray * (S + 1) + i, mask=there, other=0.0)
        to = tl.load(s + ray * (S + 1) + i + 1, mask=there, other=0.0)
        low = tl.maximum(tl.sum((edge[None, :] <= from_[:, None]).to(tl.int32), 1) - 1, 0)
        high = tl.minimum(tl.sum((edge[None, :] < to[:, None]).to(tl.int32), 1), P)
        counted = (j[None, :] < high[:, None]).to(weight.dtype) - (j[None, :] < low[:, None]).to(weight.dtype)
        own = tl.load(w + ray * S + i, mask=there, other=0.0)
        excess = tl.maximum(own - tl.sum(counted * weight[None, :], 1), 0.0)
        share = tl.where(there, excess / (own + EPS), 0.0)
        lost += tl.sum(excess * share, 0)
        slope -= 2 * tl.sum(share[:, None] * counted, 0)
    tl.store(loss + ray, lost)
    tl.store(gradient + ray * P + j, slope, mask=j < P)


@triton.jit
@no_type_check
def _distortion(s, w, loss, gradient, S, AT_ONCE: tl.constexpr, BLOCK: tl.constexpr):
    """gradient_k = 2 sum_i w_i |m_i - m_k| + 2/3 w_k width_k; the loss is half of sum_k w_k gradient_k."""
    ray, k = tl.program_id(0).to(tl.int64), tl.arange(0, BLOCK)
    s += ray * (S + 1)
    own = tl.load(w + ray * S + k, mask=k < S, other=0.0)
    s0, s1 = tl.load(s + k, mask=k < S, other=0.0), tl.load(s + k + 1, mask=k < S, other=0.0)
    found, middle = (2 / 3) * own * (s1 - s0), (s0 + s1) * 0.5
    for begin in range(0, S, AT_ONCE):
        i = begin + tl.arange(0, AT_ONCE)
        other = tl.load(w + ray * S + i, mask=i < S, other=0.0)
        sum_ = tl.load(s + i, mask=i < S, other=0.0) + tl.load(s + i + 1, mask=i < S, other=0.0)
        found += 2 * tl.sum(other[:, None] * tl.abs(sum_[:, None] * 0.5 - middle[None, :]), 0)
    tl.store(loss + ray, 0.5 * tl.sum(own * found, 0))
    tl.store(gradient + ray * S + k, found, mask=k < S)


class _Interlevel(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, s: Tensor, w: Tensor, s_proposal: Tensor, w_proposal: Tensor) -> Tensor:
        s, w, s_proposal, w_proposal = contiguous(s, w, s_proposal, w_proposal)
        loss, gradient = s.new_empty(len(s)), torch.empty_like(w_proposal)
        on_each_ray(
            _interlevel, s, w, s_proposal, w_proposal, loss, gradient, w.shape[1], w_proposal.shape[1],
            rays=len(s), samples=s_proposal.shape[1], EPS=torch.finfo(s.dtype).eps, AT_ONCE=AT_ONCE,
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
        s, w = contiguous(s, w)
        loss, gradient = s.new_empty(len(s)), torch.empty_like(w)
        samples = w.shape[1]
        on_each_ray(
            _distortion, s, w, loss, gradient, samples, rays=len(s), samples=samples, AT_ONCE=AT_ONCE
        )
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

    Levels increase along a ray.  No gradient flows: samples are constants.  An `anneal` that is on the
    device already is read there.
    """
    s, w, u = contiguous(s, w, u)
    edges, exponent = torch.empty_like(u), anneal if isinstance(anneal, Tensor) else s.new_full((), anneal)
    samples, count = w.shape[1], u.shape[1]
    on_each_ray(
        _resample, s, w, u, exponent, edges, samples, count,
        rays=len(s), samples=samples, PADDING=padding, AT_ONCE=AT_ONCE,
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
