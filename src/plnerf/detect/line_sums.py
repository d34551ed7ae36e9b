"""Averages of ridge responses along straight lines through every pixel, in all directions.

An image lies as (U, V), the axis u along which lines run first; a line moves by `slope` along v for each step
along u, |slope| <= 1.  The image is sheared so that the line stands still, running sums are kept along it,
and it is sheared back: the cost does not depend on the length of the lines.

Rows are handed on as slices, whose indices LLVM knows not to be negative, and constants are float32: so each
loop along v works on 8 pixels at a time.

What Numba compiles is marked no_type_check: a wrapper that checks annotations cannot be compiled.
"""

import math
from typing import no_type_check

import numpy as np

from plnerf.ops.cpu_arrays import FAST
from plnerf.ops.kernel_cache import inlined, njit

_FLAGS = {"cache": True, "fastmath": FAST, "error_model": "numpy", "nogil": True}


@njit(**_FLAGS)
@no_type_check
def strongest_lines(parts, slopes, half_length, edge_weight, most, best, index):
    """Into best and index (U, V): the average largest in size over the directions, and its direction's index.

    parts: (S, 5, U, V) float32, of S scales the derivatives u, v, uu, uv, vv, in units of the neighbourhood's
    contrast.  slopes: (D,) float32.  half_length: in pixels along the line.  A line's average is over its
    part in the image, or over half its length where less is, so that a corner cut off by a line is not judged
    by a few pixels; it is positive for bright lines.
    """
    U, V = best.shape
    row = np.zeros(V + 2, np.float32)  # with a zero at either end, for interpolation
    means = np.empty(V, np.float32)
    for d in range(slopes.shape[0]):
        slope = slopes[d]
        reach = math.ceil(abs(slope) * (U - 1) / 2) + 2
        W = V + 2 * reach
        sums = np.zeros((U + 1, W), np.float32)
        first, end = np.full(W, np.float32(U)), np.zeros(W, np.float32)
        for u in range(U):
            across_the_line(parts, u, slope, edge_weight, most, row[1 : V + 1])
            shift, part = shift_of(u, U, slope)
            at = slice(reach - shift - 1, reach - shift + V)  # the sheared places between the row's entries
            for w in range(W):
                sums[u + 1, w] = sums[u, w]
            add_sheared(row, part, np.float32(u), sums[u + 1, at], first[at], end[at])
        half = round(half_length / math.sqrt(1 + slope * slope))
        for u in range(U):
            shift, part = shift_of(u, U, slope)
            at = slice(reach - shift - 1, reach - shift + V)
            begin, stop = max(0, u - half), min(U, u + half + 1)
            stretch = (np.float32(begin), np.float32(stop), np.float32(half))
            average_sheared(sums[begin, at], sums[stop, at], first[at], end[at], stretch, part, means)
            keep_larger(means, np.int32(d), best[u], index[u])


@inlined(fastmath=FAST, error_model="numpy")
@no_type_check
def shift_of(u, U, slope):
    """Whole pixels and the rest by which a line has moved along v at u, from the image's middle.

    From the middle, so that what interpolation does is the same when the image is turned.
    """
    moved = slope * np.float32(u - (U - 1) / 2)
    whole = math.floor(moved)
    return int(whole), np.float32(moved - whole)


@inlined(fastmath=FAST, error_model="numpy")
@no_type_check
def across_the_line(parts, u, slope, edge_weight, most, row):
    """Into row (V,): how much each pixel of one row looks like a line's, at the best of the scales.

    The bend across the line less the slope across it: at the middle of a line the brightness is even, at an
    edge it bends only where it also slopes.  Positive for bright lines, at most `most` in size.
    """
    length = np.float32(1 / math.sqrt(1 + slope * slope))
    nu, nv, zero = -slope * length, length, np.float32(0)
    uu, uv, vv = nu * nu, np.float32(2) * nu * nv, nv * nv
    for v in range(len(row)):
        row[v] = zero
    for k in range(parts.shape[0]):
        by_u, by_v, by_uu, by_uv, by_vv = (
            parts[k, 0, u], parts[k, 1, u], parts[k, 2, u], parts[k, 3, u], parts[k, 4, u]
        )  # fmt: skip
        for v in range(len(row)):
            bend = uu * by_uu[v] + uv * by_uv[v] + vv * by_vv[v]
            tilt = nu * by_u[v] + nv * by_v[v]
            size = min(max(abs(bend) - edge_weight * abs(tilt), zero), most)
            signed = -size if bend > zero else size
            row[v] = signed if size > abs(row[v]) else row[v]


@inlined(fastmath=FAST, error_model="numpy")
@no_type_check
def add_sheared(row, part, u, sums, first, end):
    """Adds row u (V + 2,), moved by a part of a pixel, to sums (V + 1,), which reach from first to end."""
    rest, beyond = np.float32(1) - part, u + np.float32(1)
    for w in range(len(sums)):
        sums[w] += rest * row[w] + part * row[w + 1]
        first[w] = min(first[w], u)
        end[w] = beyond


@inlined(fastmath=FAST, error_model="numpy")
@no_type_check
def average_sheared(before, after, first, end, stretch, part, means):
    """Into means (V,): the averages over a stretch, moved back; before and after it the sums are (V + 1,)."""
    begin, stop, half = stretch
    one = np.float32(1)
    rest = one - part
    for v in range(len(means)):
        total = rest * (after[v + 1] - before[v + 1]) + part * (after[v] - before[v])
        here = max(min(stop, end[v + 1]) - max(begin, first[v + 1]), half)
        beside = max(min(stop, end[v]) - max(begin, first[v]), half)
        means[v] = total / max(rest * here + part * beside, one)


@inlined(fastmath=FAST, error_model="numpy")
@no_type_check
def keep_larger(means, d, best, index):
    """Into best and index (V,): the averages of direction d that are larger in size."""
    for v in range(len(best)):
        larger = abs(means[v]) > abs(best[v])
        best[v] = means[v] if larger else best[v]
        index[v] = d if larger else index[v]
