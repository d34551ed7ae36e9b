"""Averages along straight lines through every pixel, in those directions that each pixel may have.

As in `line_sums.py` running sums are kept along sheared pictures, so that the cost does not depend on the
length of the lines; here lines run in a few of all directions, other ones in each part of the picture.

Letters: h rows, w columns, x right, y down; D directions in half a turn, d of them, as multiples of pi / D
from +x towards +y.  A kernel's picture lies as (U, V), the axis u along which lines run first.

What Numba compiles is marked no_type_check: a wrapper that checks annotations cannot be compiled.
"""

import math
from typing import no_type_check

import numpy as np
from jaxtyping import Float32

from plnerf.detect.line_sums import average_sheared, shift_of
from plnerf.ops.cpu_arrays import FAST
from plnerf.ops.kernel_cache import inlined, njit

_FLAGS = {"cache": True, "fastmath": FAST, "error_model": "numpy", "nogil": True}


def average_along(
    picture: Float32[np.ndarray, "h w"],
    low: Float32[np.ndarray, "h w"],
    high: Float32[np.ndarray, "h w"],
    apart_rad: float,
    half_px: float,
) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
    """The average largest in size over lines through each pixel, and the direction of that line in radians.

    low, high: the angles between which lines may run there.  Directions are at most `apart_rad` apart, and
    the nearest to both of these count too.  half_px: half the length of the lines; where less than that is in
    the picture, the sum is divided by half_px.
    """
    D = 4 * math.ceil(math.pi / apart_rad / 4)
    first = np.round(low * np.float32(D / np.pi)).astype(np.int32)
    more = np.round(high * np.float32(D / np.pi)).astype(np.int32) - first
    first %= D
    # Directions within 45 degrees of the x axis run along x, the others along y.
    steep = np.arange(D // 4, D - D // 4)
    flat = np.setdiff1d(np.arange(D), steep)
    parts = []
    for steps, turned in ((flat, True), (steep, False)):
        angle = np.pi / D * steps
        slopes = np.tan(angle) if turned else 1 / np.tan(angle)
        fields = [np.ascontiguousarray(field.T) if turned else field for field in (picture, first, more)]
        best, index = (np.zeros(fields[0].shape, kind) for kind in (np.float32, np.int32))
        largest_average(*fields, D, steps, slopes.astype(np.float32), half_px, best, index)
        parts.append((best.T, index.T) if turned else (best, index))
    (along_x, index_x), (along_y, index_y) = parts
    larger = np.abs(along_x) > np.abs(along_y)
    direction = np.where(larger, index_x, index_y).astype(np.float32)
    return np.where(larger, along_x, along_y), direction * np.float32(np.pi / D)


@njit(**_FLAGS)
@no_type_check
def largest_average(picture, first, more, D, steps, slopes, half_px, best, index):  # noqa: PLR0913 (a kernel's arrays, one by one)
    """Into best (U, V), zeros before: the average largest in size; into index (U, V): its line's direction.

    first, more: (U, V) int32, the first of the directions that lines may have, in [0, D), and how many follow
    it.  steps, slopes: (d,), directions that run along u, and by how much they move along v for each step.
    """
    U, V = best.shape
    row = np.zeros(V + 4, np.float32)  # with zeros at either end, for interpolation
    means = np.empty(V, np.float32)
    used = rows_of(first, more, D)
    sums = np.empty((U + 1, U + V + 8), np.float32)
    for k in range(len(steps)):
        slope, rows = slopes[k], np.flatnonzero(used[steps[k]])
        if len(rows) == 0:
            continue
        half = round(half_px / math.sqrt(1 + slope * slope))
        top, bottom = max(0, rows[0] - half), min(U, rows[-1] + half + 1)
        reach = math.ceil(abs(slope) * (U - 1) / 2) + 2
        W = V + 2 * reach
        begins, ends = np.full(W, np.float32(U)), np.zeros(W, np.float32)
        sums[top, :W] = 0
        for u in range(top, bottom):
            row[2 : V + 2] = picture[u]
            shift, part = shift_of(u, U, slope)
            at = slice(reach - shift - 1, reach - shift + V)  # the sheared places between the row's entries
            sums[u + 1, :W] = sums[u, :W]
            add_row(row, part, np.float32(u), sums[u + 1, at], begins[at], ends[at])
        for u in range(rows[0], rows[-1] + 1):
            shift, part = shift_of(u, U, slope)
            at = slice(reach - shift - 1, reach - shift + V)
            begin, stop = max(0, u - half), min(U, u + half + 1)
            stretch = (np.float32(begin), np.float32(stop), np.float32(half))
            average_sheared(sums[begin, at], sums[stop, at], begins[at], ends[at], stretch, part, means)
            keep_allowed(means, np.int32(steps[k]), np.int32(D), first[u], more[u], best[u], index[u])


@inlined(fastmath=FAST, error_model="numpy")
@no_type_check
def add_row(row, part, u, sums, begins, ends):
    """Adds row u (V + 4,), moved by a part of a pixel, to the sums (V + 1,) of lines, from begins to ends.

    Between pixels by Catmull-Rom splines: linear interpolation, here and on the way back, would blur lines of
    a pixel away.
    """
    one, two, half, t = np.float32(1), np.float32(2), np.float32(0.5), part
    beyond = u + one
    a, d = half * t * (t * (two - t) - one), half * t * t * (t - one)
    b = one + half * t * t * (np.float32(3) * t - np.float32(5))
    c = one - a - b - d
    for w in range(len(sums)):
        sums[w] += a * row[w] + b * row[w + 1] + c * row[w + 2] + d * row[w + 3]
        begins[w] = min(begins[w], u)
        ends[w] = beyond


@njit(**_FLAGS)
@no_type_check
def rows_of(first, more, D):
    """Whether any pixel of a row may have a direction: (D, U)."""
    U, V = first.shape
    used = np.zeros((D, U), np.bool_)
    for u in range(U):
        changes = np.zeros(2 * D + 1, np.int32)
        for v in range(V):
            changes[first[u, v]] += 1
            changes[first[u, v] + min(more[u, v], D - 1) + 1] -= 1
        count = 0
        for k in range(2 * D):
            count += changes[k]
            used[k % D, u] |= count > 0
    return used


@inlined(fastmath=FAST, error_model="numpy")
@no_type_check
def keep_allowed(means, step, D, first, more, best, index):
    """Into best and index (V,): the averages in a direction that are larger in size, where it is allowed."""
    for v in range(len(best)):
        beyond = step - first[v]
        beyond = beyond + D if beyond < 0 else beyond
        larger = (abs(means[v]) > abs(best[v])) & (beyond <= more[v])
        best[v] = means[v] if larger else best[v]
        index[v] = step if larger else index[v]
