"""How far each pixel of a view lies from the nearest ridge, exactly, as far as `FARTHEST_PX`.

OpenCV's transform of a whole view takes twice as long, and a call with Python's lock: a line takes its
ridges, and gives them back, in some dozens of views at a time.
"""

from typing import no_type_check

import numpy as np

from plnerf.detect.config import FARTHEST_PX
from plnerf.ops.kernel_cache import njit

STEPS = 4
"""Distances are kept in quarters of a pixel: a byte for each pixel."""
FARTHER = 255
"""Stands for every distance greater than `FARTHEST_PX`."""


@njit(cache=True)
@no_type_check
def nearest_of_views(ridges, starts, sizes, out, start, stop):
    """Into out (p,): from each pixel to the nearest ridge (p,) of its view, in quarters of a pixel."""
    for n in range(start, stop):
        w, h = sizes[n]
        part = slice(starts[n], starts[n] + w * h)
        put_steps(squared_to_nearest(ridges[part].reshape(h, w), FARTHEST_PX), out[part].reshape(h, w))


@njit(cache=True)
@no_type_check
def put_steps(squared, out):
    """Into out (h, w): squared distances as whole quarters of a pixel."""
    most = np.float32(FARTHEST_PX * FARTHEST_PX)
    for r in range(len(squared)):
        row, into = squared[r], out[r]
        for c in range(len(row)):
            steps = np.int32(np.float32(STEPS) * np.sqrt(row[c]))
            into[c] = steps if row[c] <= most else FARTHER


@njit(cache=True)
@no_type_check
def squared_to_nearest(marked, reach):
    """Squared distance in pixels to the nearest marked pixel (h, w); (reach + 1)^2 where none is so near.

    First along columns, then along rows.  Comparisons are written out: `min` would keep LLVM from vectors.
    """
    h, w = marked.shape
    far, one = np.float32(reach + 1), np.float32(1)
    upright, run = np.full((h, w + 2 * reach), far * far), np.full(w, far)
    for r in range(h):
        here, row = marked[r], upright[r, reach : reach + w]
        for c in range(w):
            away = run[c] + one if run[c] + one < far else far
            run[c] = row[c] = np.float32(0) if here[c] else away
    run[:] = far
    for r in range(h - 1, -1, -1):
        row = upright[r, reach : reach + w]
        for c in range(w):
            away = run[c] + one if run[c] + one < row[c] else row[c]
            run[c], row[c] = away, away * away
    out = upright[:, reach : reach + w].copy()
    for r in range(h):
        row = out[r]
        for d in range(1, reach + 1):
            square = np.float32(d * d)
            before, beyond = upright[r, reach - d : reach - d + w], upright[r, reach + d : reach + d + w]
            for c in range(w):
                nearer = (before[c] if before[c] < beyond[c] else beyond[c]) + square
                row[c] = nearer if nearer < row[c] else row[c]
    return out


@njit(cache=True)
@no_type_check
def forget_in(ridges, free, every, left, others, least, muffled, starts, sizes, boxes, start, stop):  # noqa: PLR0913 (a kernel's arrays, one by one)
    """Into ridges and free (p,): distances in and about boxes (b, 5), where the ridges left have changed.

    boxes: a view, and the first and the end of its rows and of its columns.  every: (p,), distances to the
    ridges of all; left: (p,), responses of those that are left, ridges from `least` on; muffled: pixels from
    those of `others` (p,) within which nothing is known.
    """
    reach = max(FARTHEST_PX, muffled)
    for k in range(start, stop):
        n, top, bottom, first, end = boxes[k]
        w, h = sizes[n]
        part = slice(starts[n], starts[n] + w * h)
        # What lies farther from the box is as it was, and what lies farther from that changes nothing in it.
        r0, r1 = max(0, top - reach), min(h, bottom + reach)
        c0, c1 = max(0, first - reach), min(w, end + reach)
        rows = slice(max(0, r0 - reach), min(h, r1 + reach))
        columns = slice(max(0, c0 - reach), min(w, c1 + reach))
        near = squared_to_nearest(left[part].reshape(h, w)[rows, columns] >= least, FARTHEST_PX)
        here = slice(r0 - rows.start, r1 - rows.start), slice(c0 - columns.start, c1 - columns.start)
        put_steps(near[here], free[part].reshape(h, w)[r0:r1, c0:c1])
        ridge, box = ridges[part].reshape(h, w), (r0, r1, c0, c1)
        ridge[r0:r1, c0:c1] = every[part].reshape(h, w)[r0:r1, c0:c1]
        put_discs(others[part].reshape(h, w), muffled, box, ridge)


@njit(cache=True)
@no_type_check
def put_discs(marked, radius, box, out):
    """Into out (h, w), within a box of it: 0 on a drawn disc about each marked pixel."""
    r0, r1, c0, c1 = box
    for r in range(max(0, r0 - radius), min(len(marked), r1 + radius)):
        for c in range(max(0, c0 - radius), min(marked.shape[1], c1 + radius)):
            for row in range(max(r0, r - radius), min(r1, r + radius + 1) if marked[r, c] else 0):
                half = round(np.sqrt(radius * radius - (row - r) ** 2))
                out[row, max(c0, c - half) : min(c1, c + half + 1)] = 0
