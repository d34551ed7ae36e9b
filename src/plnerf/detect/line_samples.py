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
