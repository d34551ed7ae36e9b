"""Samples of a picture along and across the lines through its pixels, and the bend across them.

Samples are bilinear, of a picture that goes on beyond its border as it is there: it comes padded, so that no
sample needs to ask where the border is.  Directions are unit vectors (x right, y down) of each pixel.

What Numba compiles is marked no_type_check: a wrapper that checks annotations cannot be compiled.
"""

from typing import no_type_check

import cv2
import numpy as np
from jaxtyping import Float32

from plnerf.ops.cpu_arrays import FAST
from plnerf.ops.kernel_cache import inlined, njit

_FLAGS = {"cache": True, "fastmath": FAST, "error_model": "numpy", "nogil": True}


def padded(picture: Float32[np.ndarray, "h w"], reach_px: int) -> Float32[np.ndarray, "H W"]:
    """The picture with the border that samples up to so many pixels away need."""
    side = reach_px + 1
    return cv2.copyMakeBorder(picture, side, side, side, side, cv2.BORDER_REPLICATE)


@njit(**_FLAGS)
@no_type_check
def average_along(picture, angle, low, high, apart, steps, best):
    """Into best (h, w), zeros before: the average largest in size of samples along lines.

    picture: padded.  angle: (h, w), of lines through the pixels, from the x axis towards y.  low, high:
    (h, w), between which they may be turned from there.  Tried are the multiples of `apart` up to half of it
    beyond.  steps: (k,), places along the lines in pixels.

    One direction is tried at many neighbours of a row: their samples are neighbours in memory, too, and lie
    between pixels in the same way, so that they are read 8 at a time.
    """
    h, w = best.shape
    width, flat, count = picture.shape[1], picture.reshape(-1), np.float32(len(steps))
    side, half = (width - w) // 2, np.float32(0.5)
    first, last, total = np.empty(w, np.int32), np.empty(w, np.int32), np.empty(w, np.float32)
    for row in range(h):
        start = (row + side) * width + side
        for v in range(w):
            first[v] = np.int32(np.ceil((angle[row, v] + low[row, v]) / apart - half))
            last[v] = np.int32(np.floor((angle[row, v] + high[row, v]) / apart + half))
        for a in range(first.min(), last.max() + 1):
            dx, dy = np.cos(np.float32(a) * apart), np.sin(np.float32(a) * apart)
            v = 0
            while v < w:
                end = v
                while end < w and first[end] <= a <= last[end]:
                    end += 1
                if end > v:
                    add_samples(flat, start + v, width, dx, dy, steps, total[v:end])
                    keep_larger(total[v:end], count, best[row, v:end])
                v = end + 1


@inlined(fastmath=FAST, error_model="numpy")
@no_type_check
def add_samples(flat, start, width, dx, dy, steps, total):
    """Into total (n,): sums of samples along lines in direction (dx, dy) through pixels from `start` on."""
    n, one = len(total), np.float32(1)
    for v in range(n):
        total[v] = np.float32(0)
    for k in range(len(steps)):
        x, y = steps[k] * dx, steps[k] * dy
        left, above = np.floor(x), np.floor(y)
        fx, fy = x - left, y - above
        i = start + int(above) * width + int(left)
        j = i + width
        a, b, c, d = flat[i : i + n], flat[i + 1 : i + 1 + n], flat[j : j + n], flat[j + 1 : j + 1 + n]
        wa, wb, wc, wd = (one - fx) * (one - fy), fx * (one - fy), (one - fx) * fy, fx * fy
        for v in range(n):
            total[v] += wa * a[v] + wb * b[v] + wc * c[v] + wd * d[v]


@inlined(fastmath=FAST, error_model="numpy")
@no_type_check
def keep_larger(total, count, best):
    """Into best (n,) the means that are larger in size."""
    for v in range(len(best)):
        mean = total[v] / count
        best[v] = mean if abs(mean) > abs(best[v]) else best[v]


@njit(**_FLAGS)
@no_type_check
def strongest_across(picture, towards, least, beside_px, echo_px, out):
    """Into out (h, w): whether a pixel is in the middle of a line, with at least a response of `least`.

    picture: signed responses, padded; no stronger one is within `beside_px` to both sides of the line, and no
    stronger one of the other sign within `echo_px`.
    """
    h, w = out.shape
    side, flat = (picture.shape[1] - w) // 2, picture.reshape(-1)
    for row in range(h):
        for column in range(w):
            response = picture[row + side, column + side]
            strength = abs(response)
            middle = strength >= least
            x, y = np.float32(column + side), np.float32(row + side)
            c, s = towards[row, column]
            k = 1
            while middle and k <= echo_px:
                dx, dy = -np.float32(k) * s, np.float32(k) * c
                one = sample(flat, picture.shape[1], x + dx, y + dy)
                other = sample(flat, picture.shape[1], x - dx, y - dy)
                if k <= beside_px:
                    middle = strength >= max(abs(one), abs(other))
                else:
                    sign = np.sign(response)
                    middle = strength >= max(-sign * one, -sign * other)
                k += 1
            out[row, column] = middle


@inlined(fastmath=FAST, error_model="numpy")
@no_type_check
def sample(flat, width, x, y):
    """A picture's value, its rows one after another, between four pixels; 0 <= x, y."""
    column, row = np.uint32(x), np.uint32(y)
    fx, fy = x - np.float32(column), y - np.float32(row)
    i, one = np.uint64(row) * np.uint64(width) + np.uint64(column), np.uint64(1)
    j = i + np.uint64(width)
    upper, lower = flat[i] + fx * (flat[i + one] - flat[i]), flat[j] + fx * (flat[j + one] - flat[j])
    return upper + fy * (lower - upper)


@njit(**_FLAGS)
@no_type_check
def bend_across(second, first, towards, edge_weight, weight, best):
    """Into best (h, w), where larger in size: the bend across the line beyond what edges and texture have.

    second: derivatives xx, xy, yy; first: x, y.  It has the sign of the second derivative across the line.
    weight: of this scale.
    """
    (xx, xy, yy), (x, y), zero, two = second, first, np.float32(0), np.float32(2)
    for row in range(len(best)):
        for column in range(best.shape[1]):
            c, s = towards[row, column, 0], towards[row, column, 1]
            cc, cs, ss = c * c, two * c * s, s * s
            across = ss * xx[row, column] - cs * xy[row, column] + cc * yy[row, column]
            along = cc * xx[row, column] + cs * xy[row, column] + ss * yy[row, column]
            tilt = c * y[row, column] - s * x[row, column]
            size = weight * max(abs(across) - abs(along) - edge_weight * abs(tilt), zero)
            if size > abs(best[row, column]):
                best[row, column] = size if across > zero else -size
