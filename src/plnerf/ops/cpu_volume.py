"""Numba kernels of the volume rendering equations, with closed-form gradients in linear time.

The references are in plain torch in `render/volume.py`; edges t are constants here.

Letters: r rays, S intervals, E = S + 1 edges t, sigma the density, d_i = sigma_i (t_{i+1} - t_i), w the
weights, T_i the transmittance at the start of interval i; `T_next` is T_{i+1}.  Multiplied up along the ray,
    T_{i+1} = T_i exp(-d_i),   w_i = T_i (1 - exp(-d_i))
so that with G_i, the gradient by w_i of whatever is minimised, that by the density is
    dL/dsigma_k = (t_{k+1} - t_k) (G_k T_{k+1} - sum_{i>k} G_i w_i).
"""

import math
from typing import Any, no_type_check

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from plnerf.ops.cpu_arrays import FAST
from plnerf.ops.cpu_math import exp_and_expm1_neg
from plnerf.ops.kernel_cache import INNER, njit
from plnerf.ops.launch import arrays, launch, refuse_gradients
from plnerf.ops.rendered import Rendered


@njit(cache=True, fastmath=FAST, error_model="numpy")
@no_type_check
def _weights(sigma, t, w, T_next, start, stop):
    S, real = sigma.shape[1], sigma.dtype.type
    exp_neg, alpha = np.empty(S, sigma.dtype), np.empty(S, sigma.dtype)
    for ray in range(start, stop):
        for i in range(S):
            exp_neg[i], alpha[i] = exp_and_expm1_neg(sigma[ray, i] * (t[ray, i + 1] - t[ray, i]))
        transmittance = real(1)
        for i in range(S):
            w[ray, i] = transmittance * alpha[i]
            transmittance *= exp_neg[i]
            T_next[ray, i] = transmittance


@njit(cache=True, fastmath=FAST, error_model="numpy")
@no_type_check
def _weights_backward(t, w, T_next, g_w, g_sigma, start, stop):
    S, real = w.shape[1], w.dtype.type
    for ray in range(start, stop):
        later = real(0)
        for k in range(S - 1, -1, -1):
            g_sigma[ray, k] = (t[ray, k + 1] - t[ray, k]) * (g_w[ray, k] * T_next[ray, k] - later)
            later += g_w[ray, k] * w[ray, k]


@njit(cache=True, fastmath=FAST, error_model="numpy", **INNER)
@no_type_check
def _median(w, t, ray, before, inside, real, eps):
    """`volume.median_depth`: `inside` the interval where the sum of weights reaches 1/2, `before` it."""
    if inside == w.shape[1]:
        return t[ray, inside]
    transmittance = max(real(1) - before, eps)
    alpha = max(min(w[ray, inside] / transmittance, real(1) - eps), real(0))
    optical = max(-math.log1p(-alpha), eps)
    share = min(max(math.log(real(2) * transmittance), real(0)) / optical, real(1))
    return t[ray, inside] + share * (t[ray, inside + 1] - t[ray, inside])


@njit(cache=True, fastmath=FAST, error_model="numpy")
@no_type_check
def _composite(t, w, colours, colour, rest, start, stop):
    """Sums over the weights; the columns of `rest` are accumulation, expected depth and median depth."""
    S, real = w.shape[1], w.dtype.type
    eps, half, one, zero = real(np.finfo(w.dtype).eps), real(0.5), real(1), real(0)
    for ray in range(start, stop):
        red = green = blue = total = moment = before = zero
        inside = 0
        for i in range(S):
            share = w[ray, i]
            red += share * colours[ray, i, 0]
            green += share * colours[ray, i, 1]
            blue += share * colours[ray, i, 2]
            moment += share * ((t[ray, i + 1] + t[ray, i]) * half)
            total += share
            if total < half:
                inside, before = i + 1, total
        missed = one - total
        colour[ray, 0] = red + missed * colours[ray, S - 1, 0]
        colour[ray, 1] = green + missed * colours[ray, S - 1, 1]
        colour[ray, 2] = blue + missed * colours[ray, S - 1, 2]
        rest[0, ray] = total
        rest[1, ray] = min(max(moment / max(total, eps), t[ray, 0]), t[ray, S])
        rest[2, ray] = _median(w, t, ray, before, inside, real, eps)


@no_type_check
def _render(  # noqa: PLR0913 (a kernel's arrays, one by one)
    sigma, t, colours, w, T_next, colour, rest, start, stop
):
    _weights(sigma, t, w, T_next, start, stop)
    _composite(t, w, colours, colour, rest, start, stop)


@njit(cache=True, fastmath=FAST, error_model="numpy")
@no_type_check
def _render_backward(  # noqa: PLR0913 (a kernel's arrays, one by one)
    t, colours, w, T_next, g_w, g_colour, g_total, g_sigma, g_colours, start, stop
):
    S, real = w.shape[1], w.dtype.type
    for ray in range(start, stop):
        red, green, blue = g_colour[ray, 0], g_colour[ray, 1], g_colour[ray, 2]
        # Of weight 1 on an interval: the colour gained is its own less the last one's, seen otherwise.
        base = g_total[ray] - (
            red * colours[ray, S - 1, 0] + green * colours[ray, S - 1, 1] + blue * colours[ray, S - 1, 2]
        )
        later = total = real(0)
        for k in range(S - 1, -1, -1):
            share = w[ray, k]
            seen = red * colours[ray, k, 0] + green * colours[ray, k, 1] + blue * colours[ray, k, 2]
            G = g_w[ray, k] + base + seen
            g_sigma[ray, k] = (t[ray, k + 1] - t[ray, k]) * (G * T_next[ray, k] - later)
            later += G * share
            total += share
            g_colours[ray, k, 0] = share * red
            g_colours[ray, k, 1] = share * green
            g_colours[ray, k, 2] = share * blue
        missed = real(1) - total
        g_colours[ray, S - 1, 0] += missed * red
        g_colours[ray, S - 1, 1] += missed * green
        g_colours[ray, S - 1, 2] += missed * blue


class _Weights(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, sigma: Tensor, t: Tensor) -> Tensor:
        w, T_next = (torch.empty_like(sigma, memory_format=torch.contiguous_format) for _ in range(2))
        launch(
            _weights, *arrays(sigma, t, w, T_next),
            rays=len(sigma), samples=sigma.numel(), ns=1.0,
        )  # fmt: skip
        ctx.save_for_backward(t, w, T_next)
        return w

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *g_outputs: Tensor) -> tuple[Tensor, None]:
        t, w, T_next = ctx.saved_tensors
        g_sigma = torch.empty_like(w)
        launch(
            _weights_backward, *arrays(t, w, T_next, *g_outputs, g_sigma),
            rays=len(w), samples=w.numel(), ns=1.0,
        )  # fmt: skip
        return g_sigma, None


class _Render(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, sigma: Tensor, t: Tensor, colours: Tensor) -> tuple[Tensor, ...]:
        w, T_next = (torch.empty_like(sigma, memory_format=torch.contiguous_format) for _ in range(2))
        colour, rest = sigma.new_empty(len(sigma), 3), sigma.new_empty(3, len(sigma))
        launch(
            _render, *arrays(sigma, t, colours, w, T_next, colour, rest),
            rays=len(sigma), samples=sigma.numel(), ns=2.5,
        )  # fmt: skip
        ctx.save_for_backward(t, colours, w, T_next)
        total, depth, median = (row.clone() for row in rest)
        ctx.mark_non_differentiable(depth, median)
        return w, colour, total, depth, median

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *g_outputs: Tensor) -> tuple[Tensor, None, Tensor]:
        t, colours, w, T_next = ctx.saved_tensors
        g_sigma, g_colours = torch.empty_like(w), w.new_empty(*w.shape, 3)
        launch(
            _render_backward,
            *arrays(t, colours, w, T_next, *g_outputs[:3], g_sigma, g_colours),
            rays=len(w), samples=w.numel(), ns=2.5,
        )  # fmt: skip
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

    The colour is sum_i w_i c_i, and the remaining transmittance takes the last interval's.  Differentiable by
    sigma >= 0 and colours, once; the depths are `volume.expected_depth` and `volume.median_depth`.
    """
    refuse_gradients("render_rays", t=t)
    return Rendered(*_Render.apply(sigma, t, colours))
