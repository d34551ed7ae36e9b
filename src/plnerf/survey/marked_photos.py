"""Photos with the places of the wires in them."""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float

from plnerf.line.survey import Picture
from plnerf.line.wire import Wire
from plnerf.scene.cameras import project
from plnerf.survey.posed_photos import Photos

IN_FRONT_M = 0.02
"""Points nearer to the camera's plane, or behind it, are in no picture."""


def pictures_of(photos: Photos, wires: Sequence[Wire], count: int) -> tuple[Picture, ...]:
    """Some of the photos, evenly chosen; none without wires."""
    if not wires or not count:
        return ()
    every = np.linspace(0, len(photos.names) - 1, count + 2).round().astype(int)
    lines = [wire.polyline() for wire in wires]
    return tuple(
        Picture(photos.names[i], photos.images.image(i), tuple(_pixels(photos, i, line) for line in lines))
        for i in np.unique(every)[1:-1].tolist()
    )


def _pixels(photos: Photos, i: int, line: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "v 2"]:
    """Where an image shows points; NaN behind the camera."""
    pixels, depths = project(photos.cameras[[i]], torch.from_numpy(line))
    shown: Float[np.ndarray, "v 2"] = pixels[0].numpy().copy()
    shown[depths[0].numpy() <= IN_FRONT_M] = np.nan
    return shown
