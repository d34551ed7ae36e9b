"""Pictures side by side, each with its name above: photo, render, error, depth, normals.

Letters: h rows, w columns.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Bool, UInt8
from PIL import Image, ImageDraw, ImageFont

from plnerf.render.pictures import (
    depth_picture,
    depth_range,
    error_picture,
    label_px,
    normals_picture,
    rgb_picture,
    with_legend,
    world_depth,
)
from plnerf.render.views import RenderedView
from plnerf.scene.transforms import Frames

ERROR_TIMES = 4
MIN_WIDTH_PX, MAX_WIDTH_PX = 320, 1280
"""Smaller pictures are enlarged by a whole factor without smoothing, larger ones reduced by area."""
_GAP_PX = 6


def evaluation_panel(
    view: RenderedView,
    photo: UInt8[np.ndarray, "h w 3"],
    valid: Bool[np.ndarray, "h w"],
    frames: Frames,
    *,
    title: str,
    score: str,
) -> UInt8[np.ndarray, "h2 w2 3"]:
    """Photo, render, error, depth and, where the model predicts them, normals of one held-out image.

    title: the image's name.  score: what is written beside "render", such as its PSNR.
    """
    depth = world_depth(view, frames)
    shown = depth_range([depth], frames)
    truth = photo.astype(np.float32) / 255
    tiles = [
        (f"photo {title}", _fit(photo)),
        (f"render, {score}", _fit(rgb_picture(view.rgb))),
        (f"absolute error, times {ERROR_TIMES}", _fit(error_picture(view.rgb, truth, valid, ERROR_TIMES))),
        (
            "depth along the camera's axis (grey: no surface)",
            with_legend(_fit(depth_picture(depth, shown)), shown),
        ),
    ]
    if view.normals is not None:
        tiles.append(("normals (scene frame, z up) as red, green, blue", _fit(normals_picture(view))))
    return side_by_side(tiles)


def side_by_side(tiles: Sequence[tuple[str, UInt8[np.ndarray, "_ _ 3"]]]) -> UInt8[np.ndarray, "h2 w2 3"]:
    """Labelled pictures in one row on white, aligned at their tops."""
    text_px = max(label_px(tile.shape[1]) for _, tile in tiles)
    head = round(1.7 * text_px)
    width = sum(tile.shape[1] for _, tile in tiles) + _GAP_PX * (len(tiles) + 1)
    height = head + max(tile.shape[0] for _, tile in tiles) + _GAP_PX
    sheet = Image.new("RGB", (width, height), "white")
    draw, left = ImageDraw.Draw(sheet), _GAP_PX
    for label, tile in tiles:
        sheet.paste(Image.fromarray(tile), (left, head))
        draw.text(
            (left, head / 2),
            label,
            fill="black",
            font=_fitting_font(label, tile.shape[1], text_px),
            anchor="lm",
        )
        left += tile.shape[1] + _GAP_PX
    return np.asarray(sheet)


def _fitting_font(label: str, width: int, text_px: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """The font at the wanted height, or as much smaller as the label needs to fit."""
    font = ImageFont.load_default(text_px)
    length = font.getlength(label)
    return font if length <= width else ImageFont.load_default(max(6.0, text_px * width / length))


def _fit(picture: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h2 w2 3"]:
    """The picture, enlarged or reduced to a width between the two limits."""
    height, width = picture.shape[:2]
    if width < MIN_WIDTH_PX:
        times = -(-MIN_WIDTH_PX // width)
        return picture.repeat(times, 0).repeat(times, 1)
    if width > MAX_WIDTH_PX:
        return cv2.resize(
            picture, (MAX_WIDTH_PX, round(height * MAX_WIDTH_PX / width)), interpolation=cv2.INTER_AREA
        )
    return picture
