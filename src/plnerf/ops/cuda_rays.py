"""Triton kernels of the geometry of rays: distances, and contracted frustums with their encoding.

The references are in plain torch where the equations are: `rays/warp.py`, `rays/frustums.py`,
`rays/contraction.py` and `field/encodings.py`.  Nothing here has a gradient: what asks for one (refined
poses) is refused and takes the references.  Letters as in `cpu_rays.py`.

What Triton compiles is marked no_type_check: a wrapper that checks annotations cannot be compiled.
"""

from typing import no_type_check

import torch
import triton
import triton.language as tl
from jaxtyping import Float
from torch import Tensor

from plnerf.ops.cuda_launch import contiguous, on_samples
from plnerf.ops.launch import refuse_gradients


@triton.jit
@no_type_check
def _distances(
    s, t, count, LOW: tl.constexpr, SPAN: tl.constexpr, BEYOND: tl.constexpr, KNEE: tl.constexpr,
    BLOCK: tl.constexpr,
):  # fmt: skip
    i = tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    share = tl.load(s + i, mask=i < count, other=0.0)
    g = LOW + share * SPAN
    rest = BEYOND + (1 - share) * SPAN  # 1 - g, without cancellation at the far end
    tl.store(t + i, tl.where(g < 0.5, 2 * KNEE * g, KNEE / (2 * rest)), mask=i < count)


@triton.jit
@no_type_check
def _moments(t0, t1, radius, TINY: tl.constexpr):
    """(t_mean, var_t, var_r) of an interval: `frustums.frustum_moments`."""
    middle, half = (t0 + t1) * 0.5, (t1 - t0) * 0.5
    ratio = half / tl.maximum(middle, TINY)
    ratio2 = ratio * ratio
    share = ratio2 / (3 + ratio2)
    t_mean = middle * (1 + 2 * share)
    var_t = half * half * (1 / 3 - (4 / 15) * share * ((12 - ratio2) / (3 + ratio2)))
    across = radius * middle
    var_r = across * across * (1 / 4 + (5 / 12) * ratio2 - (4 / 15) * ratio2 * share)
    return t_mean, var_t, var_r


@triton.jit
@no_type_check
def _contracted(x, y, z, d0, d1, d2, v0, v1, v2, excess):  # noqa: PLR0913 (a frustum's numbers)
    """`contraction.contract_frustums`: mean and variances after the contraction."""
    first = (tl.abs(x) >= tl.abs(y)) & (tl.abs(x) >= tl.abs(z))
    second = (first == 0) & (tl.abs(y) >= tl.abs(z))
    third = (first | second) == 0
    chosen = tl.where(first, x, tl.where(second, y, z))
    inverse = 1 / tl.maximum(tl.abs(chosen), 1.0)
    a = (2 - inverse) * inverse
    b = (2 * inverse - 2) * inverse * inverse * tl.where(chosen < 0, -1.0, 1.0)
    b0, b1, b2 = b * x, b * y, b * z
    dk = tl.where(first, d0, tl.where(second, d1, d2))
    corner = tl.where(first, v0, tl.where(second, v1, v2))
    c0 = tl.where(first, corner, excess * d0 * dk)
    c1 = tl.where(second, corner, excess * d1 * dk)
    c2 = tl.where(third, corner, excess * d2 * dk)
    v0 = a * a * v0 + 2 * a * b0 * c0 + b0 * b0 * corner
    v1 = a * a * v1 + 2 * a * b1 * c1 + b1 * b1 * corner
    v2 = a * a * v2 + 2 * a * b2 * c2 + b2 * b2 * corner
    return a * x, a * y, a * z, v0, v1, v2


@triton.jit
@no_type_check
def _encode(encoded, at, there, axis, mean, variance, OCTAVES: tl.constexpr):
    """`encodings.integrated_positional_encoding` of one coordinate."""
    row = encoded + at * (6 * OCTAVES) + axis
    for k in tl.static_range(OCTAVES):
        fade = tl.exp(tl.maximum(variance, 0.0) * (-0.5 * 4.0**k))
        tl.store(row + 3 * k, tl.sin(mean * 2.0**k) * fade, mask=there)
        tl.store(row + 3 * (OCTAVES + k), tl.cos(mean * 2.0**k) * fade, mask=there)


@triton.jit
@no_type_check
def _features(  # noqa: PLR0913 (a kernel's arrays, one by one)
    origins, directions, radius, t, unit, encoded, samples, S,
    A0: tl.constexpr, A1: tl.constexpr, A2: tl.constexpr, CONTRACTION: tl.constexpr,
    OCTAVES: tl.constexpr, TINY: tl.constexpr, BLOCK: tl.constexpr,
):  # fmt: skip
    at = tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    there = at < samples
    ray = at // S
    edge = t + at + ray  # a ray has an edge more than it has samples
    t0, t1 = tl.load(edge, mask=there, other=1.0), tl.load(edge + 1, mask=there, other=1.0)
    t_mean, var_t, var_r = _moments(t0, t1, tl.load(radius + ray, mask=there, other=0.0), TINY)
    d0 = tl.load(directions + ray * 3, mask=there, other=0.0) * A0
    d1 = tl.load(directions + ray * 3 + 1, mask=there, other=0.0) * A1
    d2 = tl.load(directions + ray * 3 + 2, mask=there, other=0.0) * A2
    x = tl.load(origins + ray * 3, mask=there, other=0.0) * A0 + t_mean * d0
    y = tl.load(origins + ray * 3 + 1, mask=there, other=0.0) * A1 + t_mean * d1
    z = tl.load(origins + ray * 3 + 2, mask=there, other=0.0) * A2 + t_mean * d2
    excess = var_t - var_r
    v0 = excess * d0 * d0 + var_r * (A0 * A0)
    v1 = excess * d1 * d1 + var_r * (A1 * A1)
    v2 = excess * d2 * d2 + var_r * (A2 * A2)
    if CONTRACTION:
        x, y, z, v0, v1, v2 = _contracted(x, y, z, d0, d1, d2, v0, v1, v2, excess)
    else:
        x, y, z = (
            tl.minimum(tl.maximum(x, -2.0), 2.0),
            tl.minimum(tl.maximum(y, -2.0), 2.0),
            tl.minimum(tl.maximum(z, -2.0), 2.0),
        )
    tl.store(unit + at * 3, (x + 2) * 0.25, mask=there)
    tl.store(unit + at * 3 + 1, (y + 2) * 0.25, mask=there)
    tl.store(unit + at * 3 + 2, (z + 2) * 0.25, mask=there)
    _encode(encoded, at, there, 0, x, v0, OCTAVES)
    _encode(encoded, at, there, 1, y, v1, OCTAVES)
    _encode(encoded, at, there, 2, z, v2, OCTAVES)


def s_to_t(s: Float[Tensor, "*n"], near: float, far: float, knee: float) -> Float[Tensor, "*n"]:
    """Kernel of `warp.s_to_t`: distance t of warped distance s, near at 0 and far at 1."""
    refuse_gradients("s_to_t", s=s)
    low, high = (t / (2 * knee) if t < knee else 1 - knee / (2 * t) for t in (near, far))
    (s,) = contiguous(s)
    t = torch.empty_like(s)
    count = s.numel()
    on_samples(
        _distances, s, t, count, samples=count, LOW=low, SPAN=high - low, BEYOND=1 - high, KNEE=knee
    )
    return t


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

    The reference is `ray_ops.frustum_features`.
    """
    refuse_gradients("frustum_features", origins=origins, directions=directions, radius=radius, t=t)
    given = contiguous(origins, directions, radius, t)
    rays, intervals = t.shape[0], t.shape[1] - 1
    unit, encoded = t.new_empty(rays, intervals, 3), t.new_empty(rays, intervals, 6 * octaves)
    on_samples(
        _features, *given, unit, encoded, rays * intervals, intervals, samples=rays * intervals,
        A0=stretch[0], A1=stretch[1], A2=stretch[2], CONTRACTION=contraction, OCTAVES=octaves,
        TINY=torch.finfo(t.dtype).tiny,
    )  # fmt: skip
    return unit, encoded
