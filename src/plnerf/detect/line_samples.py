"""Samples of a picture along and across the lines through its pixels, and the bend across them.

Samples are bilinear, of a picture that goes on beyond its border as it is there: it comes padded, so that no
sample needs to ask where the border is.  Directions are unit vectors (x right, y down) of each pixel.

What Numba compiles is marked no_type_check: a wrapper that checks annotations cannot be compiled.
"""

import math
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
def average_along(picture, towards, low, high, apart, steps, best, turn):
    """Into best (h, w), zeros before: the average largest in size of samples along lines.

    Into turn (h, w): the angle by which that line is turned.

    picture: padded.  towards: (h, w, 2).  low, high: (h, w), angles between which lines may be turned from
    there: so many are tried that no two neighbours are farther than `apart` from each other, and the best
    counts.  steps: (k,), places along the lines in pixels.

    Neighbours in a row have nearly the same direction, so that most samples of neighbours lie between
    neighbours: a run of those is read as it lies in memory, 8 at a time.
    """
    h, w = best.shape
    width, flat, count = picture.shape[1], picture.reshape(-1), np.float32(len(steps))
    side, away, rows = (width - w) // 2, np.empty(w, np.int32), np.empty((6, w), np.float32)
    dx, dy, fx, fy, total, angle = rows[0], rows[1], rows[2], rows[3], rows[4], rows[5]
    cosine, sine = np.empty(w, np.float32), np.empty(w, np.float32)
    for row in range(h):
        start, turns = (row + side) * width + side, 1
        for v in range(w):
            turns = max(turns, math.ceil((high[row, v] - low[row, v]) / apart))
        first_line(towards[row], low[row], high[row], turns, dx, dy, cosine, sine)
        for a in range(turns + 1):
            if a:
                turned(dx, dy, cosine, sine)
            part = np.float32(a) / np.float32(turns)
            for v in range(w):
                total[v], angle[v] = np.float32(0), low[row, v] + part * (high[row, v] - low[row, v])
            for k in range(len(steps)):
                sample_places(dx, dy, steps[k], np.float32(width), away, fx, fy)
                v = 0
                while v < w:
                    end = v + 1
                    while end < w and away[end] == away[v]:
                        end += 1
                    add_samples(flat, start + v + away[v], width, fx[v:end], fy[v:end], total[v:end])
                    v = end
            for v in range(w):
                mean = total[v] / count
                larger = abs(mean) > abs(best[row, v])
                best[row, v] = mean if larger else best[row, v]
                turn[row, v] = angle[v] if larger else turn[row, v]


@inlined(fastmath=FAST, error_model="numpy")
@no_type_check
def first_line(towards, low, high, turns, dx, dy, cosine, sine):
    """Into dx, dy (w,): directions (w, 2) turned by the lowest angle; into cosine and sine the turn to the
    next line, one of `turns` to the highest.
    """
    for v in range(len(dx)):
        x, y, c, s = towards[v, 0], towards[v, 1], np.cos(low[v]), np.sin(low[v])
        dx[v], dy[v] = c * x - s * y, s * x + c * y
        turn = (high[v] - low[v]) / np.float32(turns)
        cosine[v], sine[v] = np.cos(turn), np.sin(turn)


@inlined(fastmath=FAST, error_model="numpy")
@no_type_check
def turned(dx, dy, cosine, sine):
    """Turns directions (w,), each by its own angle."""
    for v in range(len(dx)):
        x, y = dx[v], dy[v]
        dx[v], dy[v] = cosine[v] * x - sine[v] * y, sine[v] * x + cosine[v] * y


@inlined(fastmath=FAST, error_model="numpy")
@no_type_check
def sample_places(dx, dy, step, width, away, fx, fy):
    """Into away (w,): how far in memory the pixel above and left of each sample is from the sample's own.

    Into fx and fy (w,): how far right of that pixel, and below it, the sample lies.
    """
    for v in range(len(dx)):
        x, y = step * dx[v], step * dy[v]
        left, above = np.floor(x), np.floor(y)
        away[v] = np.int32(above * width + left)
        fx[v], fy[v] = x - left, y - above


@inlined(fastmath=FAST, error_model="numpy")
@no_type_check
def add_samples(flat, i, width, fx, fy, total):
    """Adds the samples of neighbours, of which the first lies between pixel i and those right and below."""
    n, j = len(total), i + width
    a, b, c, d = flat[i : i + n], flat[i + 1 : i + 1 + n], flat[j : j + n], flat[j + 1 : j + 1 + n]
    for v in range(n):
        upper, lower = a[v] + fx[v] * (b[v] - a[v]), c[v] + fx[v] * (d[v] - c[v])
        total[v] += upper + fy[v] * (lower - upper)


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
