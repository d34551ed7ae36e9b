"""Averages of ridge responses along straight lines through every pixel, in all directions.

An image lies as (U, V), the axis u along which lines run first; a line moves by `slope` along v for each step
along u, |slope| <= 1.  The image is sheared so that the line stands still, running sums are kept along it,
and it is sheared back: the cost does not depend on the length of the lines.

What Numba compiles is marked no_type_check: a wrapper that checks annotations cannot be compiled.
"""

import math
from typing import no_type_check

import numpy as np

from plnerf.ops.cpu_arrays import FAST
from plnerf.ops.kernel_cache import njit

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
    for d in range(slopes.shape[0]):
        slope = slopes[d]
        reach = math.ceil(abs(slope) * (U - 1) / 2) + 2
        W = V + 2 * reach
        sums = np.zeros((U + 1, W), np.float32)
        first, end = np.full(W, U, np.int32), np.zeros(W, np.int32)
        for u in range(U):
            across_the_line(parts, u, slope, edge_weight, most, row)
            shift, part = shift_of(u, U, slope)
            start = reach - shift - 1  # the sheared place of the row's first (zero) entry
            for w in range(W):
                sums[u + 1, w] = sums[u, w]
            low, high = max(0, start), min(W, start + V + 1)
            for w in range(low, high):
                sums[u + 1, w] += (1 - part) * row[w - start] + part * row[w - start + 1]
            for w in range(low, high):
                first[w] = min(first[w], u)
                end[w] = u + 1
        half = round(half_length / math.sqrt(1 + slope * slope))
        for u in range(U):
            shift, part = shift_of(u, U, slope)
            begin, stop = max(0, u - half), min(U, u + half + 1)
            for v in range(V):
                w = v - shift + reach
                total = (1 - part) * (sums[stop, w] - sums[begin, w])
                total += part * (sums[stop, w - 1] - sums[begin, w - 1])
                here = np.float32(max(min(stop, end[w]) - max(begin, first[w]), half))
                beside = np.float32(max(min(stop, end[w - 1]) - max(begin, first[w - 1]), half))
                mean = total / max((1 - part) * here + part * beside, np.float32(1))
                if abs(mean) > abs(best[u, v]):
                    best[u, v] = mean
                    index[u, v] = d


@njit(**_FLAGS)
@no_type_check
def shift_of(u, U, slope):
    """Whole pixels and the rest by which a line has moved along v at u, from the image's middle.

    From the middle, so that what interpolation does is the same when the image is turned.
    """
    moved = slope * np.float32(u - (U - 1) / 2)
    whole = math.floor(moved)
    return int(whole), np.float32(moved - whole)


@njit(**_FLAGS)
@no_type_check
def across_the_line(parts, u, slope, edge_weight, most, row):
    """Into row[1:V+1]: how much each pixel of one row looks like a line's, at the best of the scales.

    The bend across the line less the slope across it: at the middle of a line the brightness is even, at an
    edge it bends only where it also slopes.  Positive for bright lines, at most `most` in size.
    """
    length = np.float32(1 / math.sqrt(1 + slope * slope))
    nu, nv = -slope * length, length
    V = parts.shape[3]
    for v in range(V):
        row[v + 1] = 0
    for k in range(parts.shape[0]):
        for v in range(V):
            bend = nu * nu * parts[k, 2, u, v] + 2 * nu * nv * parts[k, 3, u, v] + nv * nv * parts[k, 4, u, v]
            tilt = nu * parts[k, 0, u, v] + nv * parts[k, 1, u, v]
            size = min(max(abs(bend) - edge_weight * abs(tilt), np.float32(0)), most)
            if size > abs(row[v + 1]):
                row[v + 1] = -size if bend > 0 else size
