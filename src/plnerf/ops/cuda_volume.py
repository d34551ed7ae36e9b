"""Triton kernels of the volume rendering equations: a program for each ray.

The references are in plain torch in `render/volume.py`, the closed-form gradients and the letters in
`cpu_volume.py`.  Sums over what lies before or behind a sample leave out the sample itself: taken away
afterwards, it would leave inf - inf.

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
from plnerf.ops.rendered import Rendered


@triton.jit
@no_type_check
def _opacity(depth):
    """1 - exp(-depth), of few depths a difference of numbers near 1: there the series, nested."""
    series = tl.zeros_like(depth) + 1
    for k in tl.static_range(15):
        series = 1 - depth * series / (16 - k)
    return tl.where(depth < 0.5, depth * series, 1 - tl.exp(-depth))


@triton.jit
@no_type_check
def _ray_weights(sigma, t, i, S):
    """Weights of a ray's intervals, and the transmittance behind each; arrays begin at the ray."""
    there = i < S
    depth = tl.load(sigma + i, mask=there, other=0.0)
    depth *= tl.load(t + i + 1, mask=there, other=0.0) - tl.load(t + i, mask=there, other=0.0)
    inner = there & (i > 0)
    previous = tl.load(sigma + i - 1, mask=inner, other=0.0)
    previous *= tl.load(t + i, mask=inner, other=0.0) - tl.load(t + i - 1, mask=inner, other=0.0)
    before = tl.cumsum(previous, 0)
    return _opacity(depth) * tl.exp(-before), tl.exp(-(before + depth))


@triton.jit
@no_type_check
def _by_density(t, w, T_next, g, seen, i, S):
    """Gradient by density of `g`, that by the weights; `seen` is g w of the next sample."""
    there = i < S
    width = tl.load(t + i + 1, mask=there, other=0.0) - tl.load(t + i, mask=there, other=0.0)
    behind = tl.load(T_next + i, mask=there, other=0.0)
    return width * (g * behind - tl.cumsum(seen, 0, reverse=True))


@triton.jit
@no_type_check
def _weights(sigma, t, w, T_next, S, BLOCK: tl.constexpr):
    ray, i = tl.program_id(0).to(tl.int64), tl.arange(0, BLOCK)
    weight, behind = _ray_weights(sigma + ray * S, t + ray * (S + 1), i, S)
    tl.store(w + ray * S + i, weight, mask=i < S)
    tl.store(T_next + ray * S + i, behind, mask=i < S)


@triton.jit
@no_type_check
def _weights_backward(t, w, T_next, g_w, g_sigma, S, BLOCK: tl.constexpr):
    ray, i = tl.program_id(0).to(tl.int64), tl.arange(0, BLOCK)
    at, later = ray * S + i, i + 1 < S
    g = tl.load(g_w + at, mask=i < S, other=0.0)
    seen = tl.load(g_w + at + 1, mask=later, other=0.0) * tl.load(w + at + 1, mask=later, other=0.0)
    found = _by_density(t + ray * (S + 1), w + ray * S, T_next + ray * S, g, seen, i, S)
    tl.store(g_sigma + at, found, mask=i < S)


@triton.jit
@no_type_check
def _median(w, t, i, S, EPS: tl.constexpr):
    """`volume.median_depth`: `inside` the interval where the sum of weights reaches 1/2."""
    ended = tl.cumsum(w, 0)
    short = (ended < 0.5) & (i < S)
    inside = tl.sum(short.to(tl.int32), 0)
    transmittance = tl.maximum(1 - tl.max(tl.where(short, ended, 0.0), 0), EPS)
    alpha = tl.minimum(tl.maximum(tl.sum(tl.where(i == inside, w, 0.0), 0) / transmittance, 0.0), 1.0)
    rest = tl.maximum(1 - alpha, EPS)
    # -log(1 - alpha) of few alpha (Kahan): what 1 - alpha was rounded by is divided out.
    optical = tl.where(rest == 1, alpha, tl.log(rest) * alpha / (rest - 1))
    share = tl.maximum(tl.log(2 * transmittance), 0.0) / tl.maximum(optical, EPS)
    last = tl.minimum(inside, S - 1)
    t0, t1 = tl.load(t + last), tl.load(t + last + 1)
    return tl.where(inside >= S, t1, t0 + tl.minimum(share, 1.0) * (t1 - t0))


@triton.jit
@no_type_check
def _render(  # noqa: PLR0913 (a kernel's arrays, one by one)
    sigma, t, colours, w, T_next, colour, rest, rays, S, EPS: tl.constexpr, BLOCK: tl.constexpr
):
    ray, i = tl.program_id(0).to(tl.int64), tl.arange(0, BLOCK)
    there, edges = i < S, t + ray * (S + 1)
    weight, behind = _ray_weights(sigma + ray * S, edges, i, S)
    weight = tl.where(there, weight, 0.0)
    tl.store(w + ray * S + i, weight, mask=there)
    tl.store(T_next + ray * S + i, behind, mask=there)
    total = tl.sum(weight, 0)
    for c in tl.static_range(3):
        value = tl.load(colours + (ray * S + i) * 3 + c, mask=there, other=0.0)
        last = tl.load(colours + (ray * S + S - 1) * 3 + c)
        tl.store(colour + ray * 3 + c, tl.sum(weight * value, 0) + (1 - total) * last)
    first, end = tl.load(edges), tl.load(edges + S)
    middle = tl.load(edges + i, mask=there, other=0.0) + tl.load(edges + i + 1, mask=there, other=0.0)
    mean = tl.sum(weight * (middle * 0.5), 0) / tl.maximum(total, EPS)
    tl.store(rest + ray, total)
    tl.store(rest + rays + ray, tl.minimum(tl.maximum(mean, first), end))
    tl.store(rest + 2 * rays + ray, _median(weight, edges, i, S, EPS))


@triton.jit
@no_type_check
def _render_backward(  # noqa: PLR0913 (a kernel's arrays, one by one)
    t, colours, w, T_next, g_w, g_colour, g_total, g_sigma, g_colours, S, BLOCK: tl.constexpr
):
    ray, i = tl.program_id(0).to(tl.int64), tl.arange(0, BLOCK)
    at, there, later = ray * S + i, i < S, i + 1 < S
    weight = tl.load(w + at, mask=there, other=0.0)
    g = tl.load(g_w + at, mask=there, other=0.0) + tl.load(g_total + ray)
    g_next = tl.load(g_w + at + 1, mask=later, other=0.0) + tl.load(g_total + ray)
    missed = 1 - tl.sum(weight, 0)
    for c in tl.static_range(3):
        g_c = tl.load(g_colour + ray * 3 + c)
        # Of weight 1 on an interval: the colour gained is its own less the last one's, seen otherwise.
        last = tl.load(colours + (ray * S + S - 1) * 3 + c)
        g += g_c * (tl.load(colours + at * 3 + c, mask=there, other=0.0) - last)
        g_next += g_c * (tl.load(colours + at * 3 + 3 + c, mask=later, other=0.0) - last)
        share = weight + tl.where(i == S - 1, missed, 0.0)
        tl.store(g_colours + at * 3 + c, share * g_c, mask=there)
    seen = tl.where(later, g_next * tl.load(w + at + 1, mask=later, other=0.0), 0.0)
    found = _by_density(t + ray * (S + 1), w + ray * S, T_next + ray * S, g, seen, i, S)
    tl.store(g_sigma + at, found, mask=there)


class _Weights(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, sigma: Tensor, t: Tensor) -> Tensor:
        sigma, t = contiguous(sigma, t)
        w, T_next = torch.empty_like(sigma), torch.empty_like(sigma)
        rays, samples = sigma.shape
        on_each_ray(_weights, sigma, t, w, T_next, samples, rays=rays, samples=samples)
        ctx.save_for_backward(t, w, T_next)
        return w

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *g_outputs: Tensor) -> tuple[Tensor, None]:
        t, w, T_next, g_w = contiguous(*ctx.saved_tensors, *g_outputs)
        g_sigma = torch.empty_like(w)
        rays, samples = w.shape
        on_each_ray(_weights_backward, t, w, T_next, g_w, g_sigma, samples, rays=rays, samples=samples)
        return g_sigma, None


class _Render(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, sigma: Tensor, t: Tensor, colours: Tensor) -> tuple[Tensor, ...]:
        sigma, t, colours = contiguous(sigma, t, colours)
        w, T_next = torch.empty_like(sigma), torch.empty_like(sigma)
        rays, samples = sigma.shape
        colour, rest = sigma.new_empty(rays, 3), sigma.new_empty(3, rays)
        on_each_ray(
            _render, sigma, t, colours, w, T_next, colour, rest, rays, samples,
            rays=rays, samples=samples, EPS=torch.finfo(sigma.dtype).eps,
        )  # fmt: skip
        ctx.save_for_backward(t, colours, w, T_next)
        total, depth, median = (row.clone() for row in rest)
        ctx.mark_non_differentiable(depth, median)
        return w, colour, total, depth, median

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *g_outputs: Tensor) -> tuple[Tensor, None, Tensor]:
        given = contiguous(*ctx.saved_tensors, *g_outputs[:3])
        w = given[2]
        g_sigma, g_colours = torch.empty_like(w), w.new_empty(*w.shape, 3)
        rays, samples = w.shape
        on_each_ray(_render_backward, *given, g_sigma, g_colours, samples, rays=rays, samples=samples)
        return g_sigma, None, g_colours


def weights_from_density(sigma: Float[Tensor, "r S"], t: Float[Tensor, "r E"]) -> Float[Tensor, "r S"]:
    """Kernel of `volume.weights_from_density`: differentiable by sigma >= 0, once."""
    refuse_gradients("weights_from_density", t=t)
    w: Tensor = _Weights.apply(sigma, t)
    return w


def render_rays(
    sigma: Float[Tensor, "r S"], t: Float[Tensor, "r E"], colours: Float[Tensor, "r S 3"]
) -> Rendered:
    """Weights, colour, accumulation and depths of rays at once: the kernel of `ray_ops.render_rays`.

    Differentiable by sigma >= 0 and colours, once; the depths carry no gradient.
    """
    refuse_gradients("render_rays", t=t)
    return Rendered(*_Render.apply(sigma, t, colours))
