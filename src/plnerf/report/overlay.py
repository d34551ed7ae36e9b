"""Fitted wires drawn over a photo, so that a reader sees whether they lie on it.

Each is two thin lines beside the wire: a line on it would hide what it is to be compared with.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from plnerf.report.side import runs

ASIDE = 1 / 260
"""From the wire to either line, as a share of the picture's width, and LEAST_ASIDE_PX or more."""
LEAST_ASIDE_PX = 4.0
THICK = 1 / 1280
"""Of a line, likewise; a pixel or more."""
FAR = 2.0
"""Vertices farther outside than so many times the picture's size are left out."""
_BITS = 4
"""Fraction of a pixel, in bits."""


def overlay(
    rgb: UInt8[np.ndarray, "h w 3"],
    lines: Sequence[Float[np.ndarray, "_ 2"]],
    colours: Sequence[tuple[int, int, int]],
) -> UInt8[np.ndarray, "h w 3"]:
    """A copy of the picture with its wires.

    lines: x and y in pixels, the first pixel's middle at (0.5, 0.5); NaN parts a line where the wire cannot
    be seen.  colours: red, green and blue, one for each line.
    """
    drawn = np.ascontiguousarray(rgb).copy()
    size = np.array([rgb.shape[1], rgb.shape[0]], np.float64)
    thick = max(1, round(size[0] * THICK))
    aside = max(LEAST_ASIDE_PX, size[0] * ASIDE)
    for line, colour in zip(lines, colours, strict=True):
        with np.errstate(invalid="ignore"):
            near: Bool[np.ndarray, " v"] = np.all((line > -FAR * size) & (line < (1 + FAR) * size), axis=1)
        for run in runs(near):
            piece = line[run]
            along = np.gradient(piece, axis=0)
            length = np.linalg.norm(along, axis=1, keepdims=True)
            normal = along[:, ::-1] * [-1.0, 1.0] / np.maximum(length, 1e-9)
            for side in (-aside, aside):
                # OpenCV counts from the first pixel's middle.
                at = np.round((piece + side * normal - 0.5) * (1 << _BITS)).astype(np.int32)
                cv2.polylines(drawn, [at], False, colour, thick, cv2.LINE_AA, _BITS)
    return drawn
