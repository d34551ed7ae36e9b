"""Numba kernels around known curves: where rays pass near them, edges that are laid there, samples in tubes.

The references are in plain torch: `windows` in `field/guides.py`, `guide_edges` in `render/guided.py` and
`TubeField.locate` in `field/tubes.py`, with the letters used here.  Op by op they make some two hundred
passes over a few thousand numbers.  Nothing has a gradient.

Curves come as the fields of `Guides`, one array each, in float64 whatever the type of the rays, and so is
what is computed on their bases: it costs nothing beside the loops, and float32 loses digits where a ray runs
along a wire.  What Numba compiles is marked no_type_check: a wrapper that checks annotations cannot be
compiled.
"""

import math
from collections.abc import Sequence
from typing import no_type_check

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from plnerf.ops.kernel_cache import INNER, njit
from plnerf.ops.launch import arrays, launch

_LEAST_ACROSS = 1e-6  # as the reference's
_INNER = INNER | {"cache": True, "error_model": "numpy"}


@njit(**_INNER)
@no_type_check
def _on_base(x, y, z, ux, uy):
    return ux * x + uy * y, ux * y - uy * x, z


@njit(**_INNER)
@no_type_check
def _approach(ox, oy, oz, dx, dy, dz, y0, y1, y2, z0, z1, z2, low, high, iterations):  # noqa: PLR0913 (a kernel's numbers, one by one)
    """t, distance and sine of the angle where a ray on a curve's base comes closest to it."""
    s = (low + high) / 2
    t = miss = oblique = 0.0
    for step in range(iterations + 1):
        if step == 0:  # from the middle of the chord, along the chord
            ty, tz = y1 + y2 * (low + high), z1 + z2 * (low + high)
        else:
            ty, tz = y1 + 2 * y2 * s, z1 + 2 * z2 * s
        ax, ay, az = ox - s, oy - (y0 + s * (y1 + y2 * s)), oz - (z0 + s * (z1 + z2 * s))
        b, dw = dx + dy * ty + dz * tz, dx * ax + dy * ay + dz * az
        ee = 1 + ty * ty + tz * tz
        across = max(ee - b * b, _LEAST_ACROSS * ee)
        if step == iterations:
            mx, my, mz = ax - dw * dx, ay - dw * dy, az - dw * dz
            t, miss, oblique = -dw, math.sqrt(mx * mx + my * my + mz * mz), math.sqrt(across / ee)
        else:
            s = min(max(s + (ax + ay * ty + az * tz - b * dw) / across, low), high)
    return t, miss, oblique


@njit(cache=True, error_model="numpy")
@no_type_check
def _windows(  # noqa: PLR0913 (a kernel's arrays, one by one)
    origins, directions, radius, origin, along, y, z, ends, reaches, near, most_oblique, iterations,
    low, high, curve, hit, start, stop,
):  # fmt: skip
    count, k = len(reaches), low.shape[1]
    ratio, middle, half = np.empty(k), np.empty(k), np.empty(k)
    for ray in range(start, stop):
        ratio[:], middle[:], half[:] = np.inf, 0.0, 0.0
        curve[ray, :] = 0
        for c in range(count):
            ux, uy = along[c, 0], along[c, 1]
            ox, oy, oz = _on_base(
                origins[ray, 0] - origin[c, 0], origins[ray, 1] - origin[c, 1], origins[ray, 2], ux, uy
            )
            dx, dy, dz = _on_base(directions[ray, 0], directions[ray, 1], directions[ray, 2], ux, uy)
            t, miss, oblique = _approach(
                ox, oy, oz, dx, dy, dz, y[c, 0], y[c, 1], y[c, 2], z[c, 0], z[c, 1], z[c, 2],
                ends[c, 0], ends[c, 1], iterations,
            )  # fmt: skip
            reach = reaches[c] + radius[ray] * max(t, 0.0)
            width = reach / max(oblique, most_oblique)
            if not (miss < reach and t - width > near):
                continue
            place = k
            while place > 0 and miss / reach < ratio[place - 1]:
                place -= 1
            for other in range(k - 1, place, -1):
                ratio[other], middle[other] = ratio[other - 1], middle[other - 1]
                half[other], curve[ray, other] = half[other - 1], curve[ray, other - 1]
            if place < k:
                ratio[place], middle[place], half[place] = miss / reach, t, width
                curve[ray, place] = c
        hit[ray] = ratio[0] < np.inf
        for place in range(k):
            chosen = place if ratio[place] < np.inf else 0
            low[ray, place], high[ray, place] = middle[chosen] - half[chosen], middle[chosen] + half[chosen]
            curve[ray, place] = curve[ray, chosen]


@njit(cache=True, error_model="numpy")
@no_type_check
def _lay(s, low, high, hit, jitter, count, first, last, knee, kept, laid, start, stop):  # noqa: PLR0913 (a kernel's arrays, one by one)
    k = low.shape[1]
    each = count // k
    for ray in range(start, stop):
        if not hit[ray]:
            laid[ray] = s[ray]
            continue
        size = 0
        for i in range(len(kept)):
            if kept[i]:
                laid[ray, size] = s[ray, i]
                size += 1
        for window in range(k):
            for i in range(each):
                # Of a window that stands twice, the second one's edges lie between the first one's.
                share = i / each + (window + jitter[ray, 0]) / count
                t = low[ray, window] + share * (high[ray, window] - low[ray, window])
                g = t / (2 * knee) if t < knee else 1 - knee / (2 * t)
                value = s.dtype.type(min(max((g - first) / (last - first), 0.0), 1.0))
                at = size
                while at > 0 and laid[ray, at - 1] > value:
                    laid[ray, at] = laid[ray, at - 1]
                    at -= 1
                laid[ray, at] = value
                size += 1


@njit(cache=True, error_model="numpy")
@no_type_check
def _in_tubes(  # noqa: PLR0913 (a kernel's arrays, one by one)
    origins, directions, t, curves, hit, origin, along, y, z, ends, reaches, length, slots, found, unit,
    start, stop,
):  # fmt: skip
    S = t.shape[1] - 1
    for ray in range(start, stop):
        found[ray, :] = -1
        if not hit[ray]:
            continue
        for i in range(S):
            middle = (t[ray, i] + t[ray, i + 1]) / 2
            px = origins[ray, 0] + middle * directions[ray, 0]
            py = origins[ray, 1] + middle * directions[ray, 1]
            pz = origins[ray, 2] + middle * directions[ray, 2]
            for k in range(curves.shape[1]):
                c = curves[ray, k]
                s, side, up = _on_base(px - origin[c, 0], py - origin[c, 1], pz, along[c, 0], along[c, 1])
                u = (side - y[c, 0] - s * (y[c, 1] + y[c, 2] * s)) / reaches[c]
                v = (up - z[c, 0] - s * (z[c, 1] + z[c, 2] * s)) / reaches[c]
                if u * u + v * v < 1 and ends[c, 0] < s < ends[c, 1]:
                    found[ray, i] = c
                    unit[ray, i, 0] = length * (s - ends[c, 0]) / (ends[c, 1] - ends[c, 0])
                    unit[ray, i, 1] = (c % slots + 0.5 * (u + 1)) / slots
                    unit[ray, i, 2] = (c // slots + 0.5 * (v + 1)) / slots
                    break


def windows(
    origins: Float[Tensor, "r 3"],
    directions: Float[Tensor, "r 3"],
    radius: Float[Tensor, " r"],
    curves: Sequence[Tensor],
    near: float,
    most_oblique: float,
    iterations: int,
    count: int,
) -> tuple[Float[Tensor, "r k"], Float[Tensor, "r k"], Int[Tensor, "r k"], Bool[Tensor, " r"]]:
    """Fields of `Windows`, `count` a ray."""
    rays = len(origins)
    low, high = (origins.new_empty(rays, count) for _ in range(2))
    curve, hit = torch.empty(rays, count, dtype=torch.int64), torch.empty(rays, dtype=torch.bool)
    launch(
        _windows, *arrays(origins, directions, radius), *_in_double(curves), near, most_oblique, iterations,
        *arrays(low, high), curve.numpy(), hit.numpy(), rays=rays, samples=rays * len(curves[0]), ns=120.0,
    )  # fmt: skip
    return low, high, curve, hit


def lay_edges(
    s: Float[Tensor, "r E"],
    low: Float[Tensor, "r k"],
    high: Float[Tensor, "r k"],
    hit: Bool[Tensor, " r"],
    jitter: Float[Tensor, "r 1"],
    kept: Bool[Tensor, " E"],
    count: int,
    warped: tuple[float, float, float],
) -> Float[Tensor, "r E"]:
    """Edges of which those not kept are laid into windows; `warped`: near and far in the full range, knee."""
    laid = torch.empty_like(s, memory_format=torch.contiguous_format)
    edges, lows, highs, jitters, out = arrays(s, low, high, jitter, laid)
    launch(
        _lay, edges, lows, highs, hit.numpy(), jitters, count, *warped, kept.numpy(), out,
        rays=len(s), samples=s.numel(), ns=12.0,
    )  # fmt: skip
    return laid


def in_tubes(
    origins: Float[Tensor, "r 3"],
    directions: Float[Tensor, "r 3"],
    t: Float[Tensor, "r E"],
    of_windows: Int[Tensor, "r k"],
    hit: Bool[Tensor, " r"],
    curves: Sequence[Tensor],
    length: float,
    slots: int,
) -> tuple[Int[Tensor, " n"], Int[Tensor, " n"], Float[Tensor, "n 3"]]:
    """Fields of `InTubes`."""
    rays, S = t.shape[0], t.shape[1] - 1
    found, unit = torch.empty(rays, S, dtype=torch.int64), t.new_empty(rays, S, 3)
    o, d, edges, units = arrays(origins, directions, t, unit)
    launch(
        _in_tubes, o, d, edges, of_windows.contiguous().numpy(), hit.numpy(), *_in_double(curves),
        length, slots, found.numpy(), units, rays=rays, samples=rays * S, ns=15.0 * of_windows.shape[1],
    )  # fmt: skip
    index = (found.view(-1) >= 0).nonzero()[:, 0]
    return index, found.view(-1)[index], unit.view(-1, 3)[index]


def _in_double(curves: Sequence[Tensor]) -> tuple[np.ndarray, ...]:
    return arrays(*(values.double() for values in curves))
