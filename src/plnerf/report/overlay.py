"""Fitted wires drawn over a photo, so that a reader can see whether they lie on it.

Each is two thin lines beside the wire: a line on it would hide what it is to be compared with.
"""

import base64
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from plnerf.errors import SurveyError
from plnerf.line.survey import Picture
from plnerf.line.wire import Wire
from plnerf.report.colours import KINDS, rgb
from plnerf.report.figures import wires_named
from plnerf.report.side import runs

ASIDE = 1 / 260
"""From the wire to either line, as a share of the picture's width, and LEAST_ASIDE_PX or more."""
LEAST_ASIDE_PX = 4.0
THICK = 1 / 1280
"""Of a line, likewise; a pixel or more."""
FAR = 2.0
"""Vertices farther outside than so many times the picture's size are left out."""
JPEG_QUALITY = 84
PICTURE_PX = 1280
"""Greatest width of a picture in the page; larger ones are reduced by area."""
_BITS = 4
"""Fraction of a pixel, in bits."""


@dataclass(frozen=True)
class Shown:
    """A picture as the page holds it."""

    url: str
    """The JPEG itself."""
    width: int
    height: int
    caption: str


def shown_picture(picture: Picture, wires: Sequence[Wire]) -> Shown:
    """A photo with its wires drawn in.  Raises SurveyError for one without pixels."""
    height, width = picture.rgb.shape[:2]
    if not height or not width:
        raise SurveyError(
            f"The picture {picture.name!r} has {width} x {height} pixels. Give one that has some."
        )
    drawn = overlay(picture.rgb, picture.wires, [rgb(KINDS[wire.kind][1]) for wire in wires])
    if width > PICTURE_PX:
        size = (PICTURE_PX, max(1, round(height * PICTURE_PX / width)))
        drawn = cv2.resize(drawn, size, interpolation=cv2.INTER_AREA)
    inside = [
        wire.id
        for wire, line in zip(wires, picture.wires, strict=True)
        if ((line >= 0) & (line <= [width, height])).all(1).any()
    ]
    return Shown(
        jpeg_url(drawn),
        drawn.shape[1], drawn.shape[0],
        f"{picture.name}: {wires_named(inside) if inside else 'no wire'}",
    )  # fmt: skip


def jpeg_url(picture: UInt8[np.ndarray, "h w 3"]) -> str:
    """The picture itself, as a page holds it."""
    _, data = cv2.imencode(
        ".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    )
    return f"data:image/jpeg;base64,{base64.b64encode(data.tobytes()).decode()}"


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
