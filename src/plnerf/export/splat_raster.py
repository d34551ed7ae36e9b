"""A rasteriser of 2D Gaussians for a CPU: front-to-back alpha compositing, and its gradient.

3D Gaussian Splatting (Kerbl et al. 2023), eq. 3: at a pixel x, with Gaussians i from front to back,

    q_i = (x - m_i)^T A_i (x - m_i) / 2,   alpha_i = min(MAX_ALPHA, o_i exp(-q_i)),
    T_i = prod_{j<i} (1 - alpha_j),        colour = sum_i T_i alpha_i c_i,   transmittance = T_{n+1}

A Gaussian ends at three standard deviations, as the kernel "ellipse" of KHR_gaussian_splatting does.  There
are no tiles: the image is split into bands of rows, one for each thread, and a band goes through all
Gaussians in order, each over its own box of pixels.  The arrays of a band stay in the processor's cache.

Letters: n Gaussians from front to back, h rows, w columns, P bands.  A row of `splats` holds mean x and y,
conic a, b, c (A = [[a, b], [b, c]]), opacity and colour; lengths are pixels, pixel centres are at +0.5.
What Numba compiles is marked no_type_check: a wrapper that checks annotations cannot be compiled.
"""

from typing import Any, no_type_check

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from plnerf.ops.cpu_arrays import FAST, num_threads
from plnerf.ops.cpu_math import exp_and_expm1_neg
from plnerf.ops.kernel_cache import njit
from plnerf.ops.threads import share

MAX_ALPHA, MIN_ALPHA = 0.99, 1 / 255
"""An alpha is no greater, and what is smaller is left out: as in the reference implementation."""
OPAQUE = 1e-4
"""Transmittance below which nothing more is added to a pixel."""
CUT_OFF = 4.5
"""q at three standard deviations."""


@njit(cache=True, fastmath=FAST, error_model="numpy")
@no_type_check
def _composite_rows(splats, box, rgb, transmittance, last, first_row, stop_row):
    real = splats.dtype.type
    most, least, opaque, cut = real(MAX_ALPHA), real(MIN_ALPHA), real(OPAQUE), real(CUT_OFF)
    one, half = real(1), real(0.5)
    for i in range(splats.shape[0]):
        low, high = max(box[i, 2], first_row), min(box[i, 3], stop_row)
        if low >= high:
            continue
        mx, my, a, b, c = splats[i, 0], splats[i, 1], splats[i, 2], splats[i, 3], splats[i, 4]
        opacity, red, green, blue = splats[i, 5], splats[i, 6], splats[i, 7], splats[i, 8]
        for y in range(low, high):
            dy = real(y) + half - my
            for x in range(box[i, 0], box[i, 1]):
                T = transmittance[y, x]
                if opaque > T:
                    continue
                dx = real(x) + half - mx
                q = half * (a * dx * dx + c * dy * dy) + b * dx * dy
                if q > cut or q < 0:
                    continue
                bell, _ = exp_and_expm1_neg(q)
                alpha = min(most, opacity * bell)
                if alpha < least:
                    continue
                weight = T * alpha
                rgb[y, x, 0] += weight * red
                rgb[y, x, 1] += weight * green
                rgb[y, x, 2] += weight * blue
                transmittance[y, x] = T * (one - alpha)
                last[y, x] = i


@njit(cache=True, fastmath=FAST, error_model="numpy")
@no_type_check
def _gradient_band(  # noqa: PLR0913 (a kernel's arrays, one by one)
    splats, box, transmittance, final, last, by_rgb, by_final, behind, grad, first_row, stop_row
):
    """From back to front: `transmittance` is that in front of what is still to come, `behind` its colour."""
    real = splats.dtype.type
    most, least, cut = real(MAX_ALPHA), real(MIN_ALPHA), real(CUT_OFF)
    one, half = real(1), real(0.5)
    for i in range(splats.shape[0] - 1, -1, -1):
        low, high = max(box[i, 2], first_row), min(box[i, 3], stop_row)
        if low >= high:
            continue
        mx, my, a, b, c = splats[i, 0], splats[i, 1], splats[i, 2], splats[i, 3], splats[i, 4]
        opacity, red, green, blue = splats[i, 5], splats[i, 6], splats[i, 7], splats[i, 8]
        gmx = gmy = ga = gb = gc = go = gr = gg = gl = real(0)
        for y in range(low, high):
            dy = real(y) + half - my
            for x in range(box[i, 0], box[i, 1]):
                if i > last[y, x]:
                    continue
                dx = real(x) + half - mx
                q = half * (a * dx * dx + c * dy * dy) + b * dx * dy
                if q > cut or q < 0:
                    continue
                bell, _ = exp_and_expm1_neg(q)
                alpha = min(most, opacity * bell)
                if alpha < least:
                    continue
                through = one / (one - alpha)
                T = transmittance[y, x] * through
                transmittance[y, x] = T
                u, v, s = by_rgb[y, x, 0], by_rgb[y, x, 1], by_rgb[y, x, 2]
                weight = T * alpha
                gr += weight * u
                gg += weight * v
                gl += weight * s
                by_alpha = T * (
                    (red - behind[y, x, 0]) * u + (green - behind[y, x, 1]) * v + (blue - behind[y, x, 2]) * s
                )
                by_alpha -= by_final[y, x] * final[y, x] * through
                behind[y, x, 0] += alpha * (red - behind[y, x, 0])
                behind[y, x, 1] += alpha * (green - behind[y, x, 1])
                behind[y, x, 2] += alpha * (blue - behind[y, x, 2])
                if opacity * bell >= most:
                    continue
                go += by_alpha * bell
                by_q = -by_alpha * alpha
                gmx -= by_q * (a * dx + b * dy)
                gmy -= by_q * (b * dx + c * dy)
                ga += by_q * half * dx * dx
                gb += by_q * dx * dy
                gc += by_q * half * dy * dy
        grad[i, 0], grad[i, 1], grad[i, 2], grad[i, 3], grad[i, 4] = gmx, gmy, ga, gb, gc
        grad[i, 5], grad[i, 6], grad[i, 7], grad[i, 8] = go, gr, gg, gl


class _Rasterise(torch.autograd.Function):
    @staticmethod
    def forward(context: Any, splats: Tensor, box: Tensor, size_px: tuple[int, int]) -> tuple[Tensor, Tensor]:
        w, h = size_px
        rgb, transmittance = splats.new_zeros(h, w, 3), splats.new_ones(h, w)
        last = np.full((h, w), -1, np.int32)
        share(
            _composite_rows, splats.detach().numpy(), box.numpy(), rgb.numpy(), transmittance.numpy(), last,
            of=h,
        )  # fmt: skip
        context.save_for_backward(splats, box, transmittance)
        context.last = last
        return rgb, transmittance

    @staticmethod
    def backward(context: Any, by_rgb: Tensor, by_final: Tensor) -> tuple[Tensor, None, None]:
        splats, box, final = context.saved_tensors
        h = len(by_final)
        bands = min(num_threads(), h)
        grads = np.zeros((bands, *splats.shape), splats.detach().numpy().dtype)
        behind = np.zeros(by_rgb.shape, grads.dtype)
        arrays = (
            splats.detach().numpy(), box.numpy(), final.numpy().copy(), final.numpy(), context.last,
            by_rgb.contiguous().numpy(), by_final.contiguous().numpy(), behind,
        )  # fmt: skip

        def of_bands(start: int, stop: int) -> None:
            for band in range(start, stop):
                _gradient_band(*arrays, grads[band], h * band // bands, h * (band + 1) // bands)

        share(of_bands, of=bands)
        return torch.from_numpy(grads.sum(0)), None, None


def rasterise(
    splats: Float[Tensor, "n 9"], box: Int[Tensor, "n 4"], size_px: tuple[int, int]
) -> tuple[Float[Tensor, "h w 3"], Float[Tensor, "h w"]]:
    """Colour over black, and transmittance, of an image; differentiable by `splats`.

    size_px: width and height.  box: the pixels of each Gaussian, int32: first and end
    column, first and end row, inside of the image.
    """
    rgb, transmittance = _Rasterise.apply(splats.contiguous(), box.int().contiguous(), size_px)
    return rgb, transmittance
