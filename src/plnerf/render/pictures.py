"""Rendered arrays to pictures: colour, depth for people and for programs, uncertainty, normals.

Letters: h rows, w columns.  Depth pictures hold the depth along the camera's z axis in world units: metres,
or the units of an unscaled scene.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8, UInt16
from PIL import Image, ImageDraw, ImageFont

from plnerf.render.views import RenderedView
from plnerf.scene.transforms import Frames

NO_SURFACE = (38, 38, 38)
"""Where a depth picture shows neither near nor far."""
_MAX_16 = 65535


@dataclass(frozen=True)
class DepthRange:
    """The lengths at both ends of a picture's colours, which are even in their logarithm; world units."""

    near: float
    far: float
    unit: str
    """"m", or "units, unscaled"."""


Colours = Callable[[Float[np.ndarray, "h w"]], UInt8[np.ndarray, "h w 3"]]
"""A map of colours, of values from 0 to 1."""


def viridis_r(value: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    """From bright yellow at 0 to dark violet at 1."""
    return _mapped(1 - value, cv2.COLORMAP_VIRIDIS)


def inferno(value: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    """From black at 0 by violet and orange to bright yellow at 1."""
    return _mapped(value, cv2.COLORMAP_INFERNO)


def _mapped(value: Float[np.ndarray, "h w"], colour_map: int) -> UInt8[np.ndarray, "h w 3"]:
    grey = np.round(np.clip(value, 0, 1) * 255).astype(np.uint8)
    return cv2.cvtColor(cv2.applyColorMap(grey, colour_map), cv2.COLOR_BGR2RGB).astype(np.uint8)


def rgb_picture(rgb: Float[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
    """Colours in [0, 1] to 8 bits, rounded."""
    return np.round(np.clip(rgb, 0, 1) * 255).astype(np.uint8)


def accumulation_picture(accumulation: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
    """Grey: black where rays pass through, white where all of them end."""
    return np.round(np.clip(accumulation, 0, 1) * 255).astype(np.uint8)


def normals_picture(view: RenderedView) -> UInt8[np.ndarray, "h w 3"]:
    """Unit normals n of the scene frame as (n + 1)/2, black where there is no surface."""
    assert view.normals is not None
    length = np.linalg.norm(view.normals, axis=-1, keepdims=True)
    unit = view.normals / np.maximum(length, 1e-6)
    return rgb_picture((unit + 1) / 2 * view.accumulation[..., None])


def world_depth(view: RenderedView, frames: Frames) -> Float[np.ndarray, "h w"]:
    """Depth along the camera's z axis in world units, float32, 0 where there is no surface."""
    return np.where(view.has_surface, frames.depth_to_world(view.z_depth), 0.0).astype(np.float32)


def world_deviation(view: RenderedView, frames: Frames) -> Float[np.ndarray, "h w"]:
    """Standard deviation of the distance in world units, float32, 0 where there is no surface."""
    assert view.depth_deviation is not None
    return np.where(view.has_surface, frames.depth_to_world(view.depth_deviation), 0.0).astype(np.float32)


def steps_per_world_unit(frames: Frames) -> float:
    """What a 16-bit depth picture counts per world unit: 1000 a metre; unscaled, 1000 a scene unit."""
    return 1000.0 if frames.unit == "m" else 1000.0 * frames.length_to_scene(1.0)


def depth_16bit(depth: Float[np.ndarray, "h w"], frames: Frames) -> UInt16[np.ndarray, "h w"]:
    """`world_depth` in 16 bits; 0 = no surface, surfaces count at least 1; what is too far counts 65535."""
    steps = np.clip(np.round(depth.astype(np.float64) * steps_per_world_unit(frames)), 1, _MAX_16)
    return np.where(depth > 0, steps, 0).astype(np.uint16)


def depth_16bit_meaning(frames: Frames) -> str:
    """The sentence that goes with every 16-bit depth picture."""
    unit = "metres" if frames.unit == "m" else "units of the unscaled world frame"
    return (
        f"Depth along the camera's z axis in {unit} = value / {steps_per_world_unit(frames):.9g}; "
        "0 = no surface, 65535 = that far or farther."
    )


def depth_range(lengths: Sequence[Float[np.ndarray, "_ _"]], frames: Frames) -> DepthRange:
    """Robust range of arrays of `world_depth` or `world_deviation`: 1st to 98th percentile of surfaces."""
    unit = "m" if frames.unit == "m" else "units, unscaled"
    surfaces = np.concatenate([np.empty(0), *(one[one > 0] for one in lengths)])
    if not surfaces.size:
        return DepthRange(1.0, 2.0, unit)
    near, far = (float(value) for value in np.percentile(surfaces, [1, 98]))
    return DepthRange(near, max(far, near * 1.05), unit)


def depth_picture(depth: Float[np.ndarray, "h w"], shown: DepthRange) -> UInt8[np.ndarray, "h w 3"]:
    """Depth in viridis, nearer brighter; dark grey: no surface.  `with_legend` adds the scale."""
    return _lengths_picture(depth, shown, viridis_r)


def uncertainty_picture(deviation: Float[np.ndarray, "h w"], shown: DepthRange) -> UInt8[np.ndarray, "h w 3"]:
    """`world_deviation` in inferno, what is spread farther brighter; dark grey: no surface."""
    return _lengths_picture(deviation, shown, inferno)


def _lengths_picture(
    lengths: Float[np.ndarray, "h w"], shown: DepthRange, colours: Colours
) -> UInt8[np.ndarray, "h w 3"]:
    surface = lengths > 0
    log = np.log(np.where(surface, lengths, shown.near) / shown.near) / np.log(shown.far / shown.near)
    return np.where(surface[..., None], colours(log), np.array(NO_SURFACE, np.uint8)).astype(np.uint8)


def legend(width: int, shown: DepthRange, colours: Colours) -> UInt8[np.ndarray, "h w 3"]:
    """A bar of this many pixels that states what the colours of a picture of lengths mean."""
    text_px = label_px(width)
    bar_px = round(text_px * 0.9)
    strip = Image.new("RGB", (width, bar_px + round(2.0 * text_px)), "white")
    left, right = text_px, width - text_px
    ramp = colours(np.linspace(0, 1, max(2, right - left), dtype=np.float32)[None].repeat(bar_px, 0))
    strip.paste(Image.fromarray(ramp), (left, round(0.3 * text_px)))
    draw, font = ImageDraw.Draw(strip), ImageFont.load_default(text_px)
    taken: list[tuple[float, float]] = []
    for tick, text in _ticks(shown):
        x = left + (right - left) * math.log(tick / shown.near) / math.log(shown.far / shown.near)
        half = draw.textlength(text, font=font) / 2
        middle = min(max(x, half), width - half)
        span = (middle - half - text_px / 2, middle + half + text_px / 2)
        if all(span[1] <= low or span[0] >= high for low, high in taken):
            draw.line([(x, bar_px), (x, bar_px + 0.6 * text_px)], fill="black")
            draw.text((middle, bar_px + 0.6 * text_px), text, fill="black", font=font, anchor="ma")
            taken.append(span)
    return np.asarray(strip)


def with_legend(
    picture: UInt8[np.ndarray, "h w 3"], shown: DepthRange, colours: Colours = viridis_r
) -> UInt8[np.ndarray, "h2 w 3"]:
    """The picture with a legend of its colours below."""
    return np.concatenate([picture, legend(picture.shape[1], shown, colours)])


def label_px(width: int) -> int:
    """Height of the letters on a picture of this width."""
    return int(np.clip(width // 26, 9, 40))


def _ticks(shown: DepthRange) -> list[tuple[float, str]]:
    """Labels of a legend, the most important first: far end with unit, near end, round numbers."""
    decades = 10.0 ** np.arange(math.floor(math.log10(shown.near)), math.ceil(math.log10(shown.far)) + 1)
    round_ones = [float(step * decade) for step in (1, 2, 5, 3, 7, 1.5) for decade in decades]
    ends = [(shown.far, f"{shown.far:.3g} {shown.unit}"), (shown.near, f"{shown.near:.3g}")]
    return ends + [(value, f"{value:.3g}") for value in round_ones if shown.near < value < shown.far]


def error_picture(
    rgb: Float[np.ndarray, "h w 3"],
    truth: Float[np.ndarray, "h w 3"],
    valid: Bool[np.ndarray, "h w"],
    times: int = 4,
) -> UInt8[np.ndarray, "h w 3"]:
    """|render - photo| times a factor, black where a mask says "ignore"."""
    return rgb_picture(np.abs(rgb - truth) * times * valid[..., None])
