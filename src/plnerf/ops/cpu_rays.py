"""Numba kernels of the geometry of rays: distances, and contracted frustums with their encoding.

The references are in plain torch where the equations are: `rays/warp.py`, `rays/frustums.py`,
`rays/contraction.py` and `field/encodings.py`.  Nothing here has a gradient: what asks for one (refined
poses) is refused and takes the references.

Letters: r rays, S intervals, E = S + 1 edges; o, d, t, the moments and J = a I + b e_k^T as there.
A ray's samples lie side by side in scratch that stays in the first cache, so that LLVM computes 8 or 16 of
them at once.

What Numba compiles is marked no_type_check: a wrapper that checks annotations cannot be compiled.
"""

from typing import no_type_check

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from plnerf.ops.cpu_arrays import FAST
from plnerf.ops.cpu_math import exp_and_expm1_neg, sin_cos
from plnerf.ops.kernel_cache import inlined, njit
from plnerf.ops.launch import arrays, launch, refuse_gradients


@njit(cache=True, fastmath=FAST, error_model="numpy")
@no_type_check
def _distances(s, t, low, span, beyond, knee):
    real = s.dtype.type
    half, two, one = real(0.5), real(2), real(1)
    low, span, beyond, knee = real(low), real(span), real(beyond), real(knee)
    for i in range(s.size):
        g = low + s[i] * span
        rest = beyond + (one - s[i]) * span
        t[i] = two * knee * g if g < half else knee / (two * rest)


def s_to_t(s: Float[Tensor, "*n"], near: float, far: float, knee: float) -> Float[Tensor, "*n"]:
    """Kernel of `warp.s_to_t`: distance t of warped distance s, near at 0 and far at 1."""
    refuse_gradients("s_to_t", s=s)
    low, high = (t / (2 * knee) if t < knee else 1 - knee / (2 * t) for t in (near, far))
    t = torch.empty_like(s, memory_format=torch.contiguous_format)
    _distances(*arrays(s.reshape(-1), t.view(-1)), low, high - low, 1 - high, knee)
    return t


@inlined(fastmath=FAST, error_model="numpy")
@no_type_check
def _moments(t0, t1, radius, tiny, real):
    """(t_mean, var_t, var_r) of an interval: `frustums.frustum_moments`."""
    middle, half = (t0 + t1) * real(0.5), (t1 - t0) * real(0.5)
    ratio = half / max(middle, tiny)
    ratio2 = ratio * ratio
    share = ratio2 / (real(3) + ratio2)
    t_mean = middle * (real(1) + real(2) * share)
    var_t = half * half * (
        real(1 / 3) - real(4 / 15) * share * ((real(12) - ratio2) / (real(3) + ratio2))
    )  # fmt: skip
    across = radius * middle
    var_r = across * across * (real(1 / 4) + real(5 / 12) * ratio2 - real(4 / 15) * ratio2 * share)
    return t_mean, var_t, var_r


@inlined(fastmath=FAST, error_model="numpy")
@no_type_check
def _contract(x, y, z, real):
    """f(x), and of its Jacobian a, b and whether k is 0, 1 (else 2): `contraction.jacobian_terms`."""
    size_x, size_y, size_z = abs(x), abs(y), abs(z)
    first = size_x >= size_y and size_x >= size_z
    second = (not first) and size_y >= size_z
    largest = size_x if first else (size_y if second else size_z)
    m = largest if largest > real(1) else real(1)
    inverse = real(1) / m
    a = (real(2) - inverse) * inverse
    chosen = x if first else (y if second else z)
    b = (real(2) * inverse - real(2)) * inverse * inverse
    b = -b if chosen < real(0) else b
    return a, b, first, second


@inlined(fastmath=FAST, error_model="numpy")
@no_type_check
def gaussian(  # noqa: PLR0913 (a kernel's arrays, one by one)
    o0, o1, o2, d0, d1, d2, radius, t0, t1, A0, A1, A2, contraction, tiny, real
):
    """Mean and variances (x, y, z, v0, v1, v2) of an interval's frustum in [-2, 2]^3.

    `contract_frustums` or, without contraction, `clamp_frustums`; rounding may leave a variance a little
    below 0.  o and d are the ray's, both stretched by A already; tiny is the type's least normal number.
    """
    two = real(2)
    t_mean, var_t, var_r = _moments(t0, t1, radius, tiny, real)
    x, y, z = o0 + t_mean * d0, o1 + t_mean * d1, o2 + t_mean * d2
    excess = var_t - var_r
    v0 = excess * d0 * d0 + var_r * A0 * A0
    v1 = excess * d1 * d1 + var_r * A1 * A1
    v2 = excess * d2 * d2 + var_r * A2 * A2
    if contraction:
        a, b, first, second = _contract(x, y, z, real)
        b0, b1, b2 = b * x, b * y, b * z
        dk = d0 if first else (d1 if second else d2)
        corner = v0 if first else (v1 if second else v2)
        c0 = corner if first else excess * d0 * dk
        c1 = corner if second else excess * d1 * dk
        c2 = excess * d2 * dk if (first or second) else corner
        v0 = a * a * v0 + two * a * b0 * c0 + b0 * b0 * corner
        v1 = a * a * v1 + two * a * b1 * c1 + b1 * b1 * corner
        v2 = a * a * v2 + two * a * b2 * c2 + b2 * b2 * corner
        x, y, z = a * x, a * y, a * z
    else:
        x, y, z = max(min(x, two), -two), max(min(y, two), -two), max(min(z, two), -two)
    return x, y, z, v0, v1, v2


@njit(cache=True, fastmath=FAST, error_model="numpy")
@no_type_check
def fill_features(  # noqa: PLR0913 (a kernel's arrays, one by one)
    origins, directions, radius, t, stretch, contraction, octaves, unit, encoded, start, stop
):
    S, real = t.shape[1] - 1, t.dtype.type
    width = 3 * octaves
    tiny = real(np.finfo(t.dtype).tiny)
    zero, quarter, half, one, two = real(0), real(0.25), real(0.5), real(1), real(2)
    A0, A1, A2 = real(stretch[0]), real(stretch[1]), real(stretch[2])
    mean, variance = np.empty(3 * S, t.dtype), np.empty(3 * S, t.dtype)
    sines, cosines = np.empty((octaves, 3 * S), t.dtype), np.empty((octaves, 3 * S), t.dtype)
    for ray in range(start, stop):
        o0, o1, o2 = origins[ray, 0] * A0, origins[ray, 1] * A1, origins[ray, 2] * A2
        d0, d1, d2 = directions[ray, 0] * A0, directions[ray, 1] * A1, directions[ray, 2] * A2
        r = radius[ray]
        for i in range(S):
            x, y, z, v0, v1, v2 = gaussian(
                o0, o1, o2, d0, d1, d2, r, t[ray, i], t[ray, i + 1], A0, A1, A2, contraction, tiny, real
            )
            mean[3 * i], mean[3 * i + 1], mean[3 * i + 2] = x, y, z
            variance[3 * i], variance[3 * i + 1], variance[3 * i + 2] = v0, v1, v2
        for j in range(3 * S):
            unit[ray, j] = (mean[j] + two) * quarter
        # Every second octave follows from the one before: sin 2x = 2 sin x cos x, exp(-4x) = exp(-x)^4.
        for k in range(0, octaves, 2):
            scale = real(2.0**k)
            fineness = half * scale * scale
            double = min(k + 1, octaves - 1)  # of an odd number of octaves the last is written twice
            for j in range(3 * S):
                sine, cosine = sin_cos(mean[j] * scale)
                fade, _ = exp_and_expm1_neg(max(variance[j], zero) * fineness)
                fade2 = fade * fade
                sines[double, j] = two * sine * cosine * (fade2 * fade2)
                cosines[double, j] = (one - two * sine * sine) * (fade2 * fade2)
                sines[k, j], cosines[k, j] = sine * fade, cosine * fade
        for i in range(S):
            for k in range(octaves):
                for axis in range(3):
                    encoded[ray, i, 3 * k + axis] = sines[k, 3 * i + axis]
                    encoded[ray, i, width + 3 * k + axis] = cosines[k, 3 * i + axis]


def frustum_features(
    origins: Float[Tensor, "r 3"],
    directions: Float[Tensor, "r 3"],
    radius: Float[Tensor, " r"],
    t: Float[Tensor, "r E"],
    stretch: tuple[float, float, float],
    contraction: bool,
    octaves: int,
) -> tuple[Float[Tensor, "r S 3"], Float[Tensor, "r S e"]]:
    """Where the frustums between the edges t lie in the unit cube, and how they are encoded; e = 6 octaves.

    The reference is `ray_frustums`, then `contract_frustums` (`clamp_frustums` without contraction), then
    (mean + 2)/4 and `integrated_positional_encoding(mean, variance)`.
    """
    refuse_gradients("frustum_features", origins=origins, directions=directions, radius=radius, t=t)
    rays, intervals = t.shape[0], t.shape[1] - 1
    unit = t.new_empty(rays, intervals, 3)
    encoded = t.new_empty(rays, intervals, 6 * octaves)
    o, d, r, edges, flat, ipe = arrays(
        origins, directions, radius, t, unit.view(rays, 3 * intervals), encoded
    )
    launch(
        fill_features, o, d, r, edges, stretch, contraction, octaves, flat, ipe,
        rays=rays, samples=rays * intervals, ns=1.5 + 2.5 * octaves,
    )  # fmt: skip
    return unit, encoded
