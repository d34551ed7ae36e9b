"""The images of a scene at their full size, whatever the resolution that it is trained at."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, UInt8

from plnerf.scene.decode import read_mask, read_rgb
from plnerf.scene.listing import Shot


@runtime_checkable
class Pictures(Protocol):
    """Images by number: those of an `ImageStore`, or files at their full size."""

    @property
    def has_masks(self) -> bool:
        """Whether any image has pixels to be ignored marked by a mask file."""

    def image(self, i: int) -> UInt8[np.ndarray, "h w 3"]:
        """The pixels of image i."""

    def valid(self, i: int) -> Bool[np.ndarray, "h w"]:
        """False where a mask says "ignore"."""


class PhotoFiles:
    """The photos as they are stored, each read from its file when it is asked for.

    Memory: those that callers hold, nothing else.  Raises SceneError where a file is gone or broken.
    """

    def __init__(self, shots: Sequence[Shot]) -> None:
        self._shots = tuple(shots)

    @property
    def has_masks(self) -> bool:
        """Whether any photo has a mask file."""
        return any(shot.mask is not None for shot in self._shots)

    def image(self, i: int) -> UInt8[np.ndarray, "h w 3"]:
        """The pixels of photo i."""
        return read_rgb(self._shots[i].path)

    def valid(self, i: int) -> Bool[np.ndarray, "h w"]:
        """False where a mask says "ignore"."""
        shot = self._shots[i]
        if shot.mask is None:
            return np.ones((shot.intrinsics.height, shot.intrinsics.width), dtype=np.bool_)
        return read_mask(shot.mask, shot.intrinsics)
