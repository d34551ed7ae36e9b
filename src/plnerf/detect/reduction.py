"""Photos of many megapixels as maps that a search can hold: blocks of k x k pixels, tile by tile.

A block of a map that says where lines are keeps the strongest response in it with its sign, so that a wire of
a pixel or two is not averaged away.  k is 1 where a photo is small enough.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8

from plnerf.scene.build_store import reduce_by_area


@dataclass(frozen=True)
class Tile:
    """A part of an image whose sides are whole blocks, and the same with a margin around it."""

    inner: tuple[slice, slice]
    """Rows and columns."""
    outer: tuple[slice, slice]

    @property
    def within(self) -> tuple[slice, slice]:
        """Rows and columns of the inner part in the outer one."""
        rows, columns = (
            slice(one.start - other.start, one.stop - other.start)
            for one, other in zip(self.inner, self.outer, strict=True)
        )
        return rows, columns


def reduction(size_px: tuple[int, int], most_px: int) -> int:
    """k, with which the longer side of an image has no more than `most_px` blocks."""
    return -(-max(size_px) // most_px)


def tiles(shape: tuple[int, ...], side: int, margin: int) -> Iterator[Tile]:
    """The tiles of an image (rows, columns): squares of `side` pixels, the last ones smaller."""
    parts = [
        [
            (slice(first, min(first + side, n)), slice(max(0, first - margin), min(first + side + margin, n)))
            for first in range(0, n, side)
        ]
        for n in shape[:2]
    ]
    for inner_rows, outer_rows in parts[0]:
        for inner_columns, outer_columns in parts[1]:
            yield Tile((inner_rows, inner_columns), (outer_rows, outer_columns))


def strongest_of_blocks(values: Float32[np.ndarray, "h w"], k: int) -> Float32[np.ndarray, "H W"]:
    """The value of each block that is farthest from 0."""
    if k == 1:
        return values
    h, w = (-(-side // k) for side in values.shape)
    padded = np.zeros((h * k, w * k), np.float32)
    padded[: values.shape[0], : values.shape[1]] = values
    blocks = padded.reshape(h, k, w, k)
    low, high = blocks.min((1, 3)), blocks.max((1, 3))
    return np.where(-low > high, low, high)


def valid_blocks(valid: Bool[np.ndarray, "h w"], k: int) -> Bool[np.ndarray, "H W"]:
    """The blocks all of whose pixels are valid."""
    return strongest_of_blocks((~valid).astype(np.float32), k) == 0


def mean_of_blocks(image: UInt8[np.ndarray, "h w 3"], k: int) -> UInt8[np.ndarray, "H W 3"]:
    """The image with one pixel for each block; the last row and column are repeated to fill their blocks."""
    if k == 1:
        return image
    h, w = image.shape[:2]
    below, right = -h % k, -w % k
    padded = cv2.copyMakeBorder(image, 0, below, 0, right, cv2.BORDER_REPLICATE)
    size = (padded.shape[1] // k, padded.shape[0] // k)
    return reduce_by_area(padded, size)
