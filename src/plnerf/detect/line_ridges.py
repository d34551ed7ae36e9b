"""The ridges of lines in images: how strongly a pixel responds, and which way the line through it runs.

Letters: p pixels of one image or of several.
"""

from collections.abc import Sequence
from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float, Float32, UInt8

from plnerf.ops.kernel_cache import njit

HALF_TURN = 256
"""Steps of tangents in half a turn: a byte holds one."""


class LineRidges(NamedTuple):
    """Pixels in the middle of lines."""

    response: Float32[np.ndarray, "*p"]
    """0 to 1; 0 where there is no ridge."""
    tangent: UInt8[np.ndarray, "*p"]
    """The way a ridge runs, from x (right) to y (down), in steps of which half a turn has 256."""


def joined_ridges(parts: Sequence[LineRidges]) -> LineRidges:
    """Those of several images, one image after the other, each row by row."""
    response, tangent = (np.concatenate([one.ravel() for one in many]) for many in zip(*parts, strict=True))
    return LineRidges(response, tangent)


def steps_of(tangent_rad: Float[np.ndarray, "*p"]) -> UInt8[np.ndarray, "*p"]:
    """Tangents in steps."""
    return (np.round(tangent_rad * (HALF_TURN / np.pi)).astype(np.int64) % HALF_TURN).astype(np.uint8)


@njit(cache=True)
@no_type_check
def turned(tangent, direction_rad):
    """The angle between a tangent in steps and a direction, 0 to a quarter of a turn; in radians."""
    turn = tangent * (np.pi / HALF_TURN) - direction_rad
    turn -= np.pi * np.floor(turn / np.pi)  # `%` takes six times as long
    return min(turn, np.pi - turn)
