"""Photos with the places of the wires in them.

Letters: v vertices of a wire, w wires, k images.
"""

from collections.abc import Sequence

import cv2
import numpy as np
import torch
from jaxtyping import Float

from plnerf.line.survey import Picture
from plnerf.line.wire import Wire
from plnerf.scene.cameras import project
from plnerf.survey.posed_photos import Photos

IN_FRONT_M = 0.02
"""Points nearer to the camera's plane, or behind it, are in no picture."""
PLACES = 60
"""Along a wire, by which photos are chosen."""
MIN_SHARE = 0.5
"""A photo shows a wire if it shows this share of what the best photo shows of it."""
MOST_PX = 1920
"""Longer side of a picture: larger photos are reduced by a whole number."""


def pictures_of(photos: Photos, wires: Sequence[Wire], count: int) -> tuple[Picture, ...]:
    """Some of the photos, evenly chosen, and so many more that every wire is shown; none without wires."""
    if not wires or not count:
        return ()
    every = np.linspace(0, len(photos.names) - 1, count + 2).round().astype(int)
    chosen = np.unique(every)[1:-1].tolist()
    shown = _shown(photos, wires)
    good = (shown > 0) & (shown >= MIN_SHARE * shown.max(0))
    while (missing := good.any(0) & ~good[chosen].any(0)).any():
        chosen.append(int((shown * good)[:, missing].sum(1).argmax()))
    lines = [wire.polyline() for wire in wires]
    return tuple(_picture(photos, i, lines) for i in sorted(chosen))


def _shown(photos: Photos, wires: Sequence[Wire]) -> Float[np.ndarray, "k w"]:
    """Share of each wire that each photo shows, if nothing hides it."""
    places = [wire.points(np.linspace(0.0, wire.base.length_m, PLACES)) for wire in wires]
    found = np.zeros((len(photos.names), len(wires)))
    for i in range(len(photos.names)):
        pixels = _pixels(photos, i, np.concatenate(places)).reshape(len(wires), PLACES, 2)
        inside = (pixels >= 0) & (pixels < photos.cameras.size_px[i].numpy())
        found[i] = inside.all(2).mean(1)
    return found


def _picture(photos: Photos, i: int, lines: Sequence[Float[np.ndarray, "_ 3"]]) -> Picture:
    rgb = photos.images.image(i)
    height, width = rgb.shape[:2]
    reduced = -(-max(height, width) // MOST_PX)
    size = (width // reduced, height // reduced)
    if reduced > 1:
        rgb = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
    shrink = np.array(size) / [width, height]
    return Picture(photos.names[i], rgb, tuple(_pixels(photos, i, line) * shrink for line in lines))


def _pixels(photos: Photos, i: int, line: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "v 2"]:
    """Where an image shows points; NaN behind the camera, and where the lens is not described any more."""
    camera = photos.cameras[[i]]
    pixels, depths = project(camera, torch.from_numpy(line))
    shown: Float[np.ndarray, "v 2"] = pixels[0].numpy().copy()
    local = (line - camera.centre[0].numpy()) @ camera.R_scene_camera[0].numpy()
    depth = depths[0].numpy()
    r = np.hypot(*local[:, :2].T) / np.maximum(depth, IN_FRONT_M)
    shown[(r >= _widest(camera.distortion[0].numpy())) | (depth <= IN_FRONT_M)] = np.nan
    return shown


def _widest(distortion: Float[np.ndarray, "5"]) -> float:
    """Distance from the axis, at depth 1, up to which the lens's polynomial r (1 + k1 r^2 + k2 r^4 + k3 r^6)
    grows: farther out it turns back into the image."""
    k1, k2, _, _, k3 = distortion
    squares = np.roots([7 * k3, 5 * k2, 3 * k1, 1.0])
    real = squares[(np.abs(squares.imag) < 1e-9) & (squares.real > 0)].real
    return float(np.sqrt(real.min())) if len(real) else np.inf
