"""Wire maps: which pixels of a photo look like those of a wire, by filters alone; nothing is learned.

A wire is thin, long and nearly straight, and brighter or darker than what lies on *both* its sides.  So:
1. Second derivatives across each of many directions at a few scales (Lindeberg, "Edge detection and ridge
   detection with automatic scale selection", IJCV 1998), less the first derivative across it: an edge slopes
   where it bends, the middle of a line does not.
2. In units of the root mean square of all derivatives nearby, so that a thin wire in a clear sky counts as
   much as a bright one over a forest, and limited, so that no single pixel makes a line.
3. Averaged, with their signs, along straight lines.  Texture bends both ways and averages out; a wire does
   not.  The direction with the largest average is the wire's.

Letters: h rows, w columns, x right, y down.  Directions are angles from +x towards +y, in [0, pi).
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from plnerf.detect.config import DEFAULT
from plnerf.detect.config_lines import RidgeConfig
from plnerf.detect.line_sums import strongest_lines


@dataclass(frozen=True, eq=False)
class Ridges:
    """The response of the filters at each pixel."""

    strength: Float32[np.ndarray, "h w"]
    """0 to 1; from 0.5 on a pixel rather is a wire's."""
    tangent_rad: Float32[np.ndarray, "h w"]
    """Direction of the line through the pixel, in [0, pi)."""
    bright: Bool[np.ndarray, "h w"]
    """Whether the line is brighter than what lies beside it."""


def find_ridges(image: UInt8[np.ndarray, "h w 3"], config: RidgeConfig = DEFAULT.ridges) -> Ridges:
    """Strength, direction and polarity of the line through each pixel."""
    parts = _derivatives(grey_of(image), config)
    # Directions within 45 degrees of the x axis run along x, the others along y; together they go to
    # themselves when the picture is turned by 90 degrees.
    quarter = config.directions // 2
    steps = np.arange(quarter) - quarter // 2
    angle = np.pi / config.directions * steps
    along_x, tangent_x = _strongest(parts.transpose(0, 1, 3, 2), angle, config)
    along_y, tangent_y = _strongest(parts[:, [1, 0, 4, 3, 2]], -angle, config)
    first = np.abs(along_x.T) >= np.abs(along_y)
    response = np.where(first, along_x.T, along_y)
    tangent = np.where(first, tangent_x.T, np.pi / 2 - tangent_y) % np.pi
    square = response**2
    strength = square / (square + np.float32(config.half_response**2))
    return Ridges(strength, tangent.astype(np.float32), response > 0)


def ridge_map(
    image: UInt8[np.ndarray, "h w 3"], config: RidgeConfig = DEFAULT.ridges
) -> Float32[np.ndarray, "h w"]:
    """Strength of the line through each pixel, 0 to 1."""
    return find_ridges(image, config).strength


def grey_of(image: UInt8[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "h w"]:
    """The mean of the colours, 0 to 1."""
    red, green, blue = cv2.split(image)
    total: np.ndarray = cv2.add(cv2.add(red, green, dtype=cv2.CV_32F), blue, dtype=cv2.CV_32F)
    return total / np.float32(3) / np.float32(255)


def gaussian_derivatives(sigma: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A Gaussian and its first and second derivative as filters, exact for constants, lines and parabolas.

    Differences of neighbours would do for an edge, but flatten a line one pixel wide to less than an edge.
    """
    x = np.arange(-math.ceil(4 * sigma), math.ceil(4 * sigma) + 1, dtype=np.float64)
    smooth = np.exp(-(x**2) / (2 * sigma**2))
    smooth /= smooth.sum()
    variance = (x**2 * smooth).sum()  # sigma^2, but for the sampling
    bend = (x**2 - variance) * smooth
    return smooth, x * smooth / variance, 2 * bend / (x**2 * bend).sum()


def hessian(
    grey: Float32[np.ndarray, "h w"], sigma: float
) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
    """Second derivatives xx, xy, yy of the picture smoothed by a Gaussian, times sigma^2 (Lindeberg)."""
    smooth, slope, bend = gaussian_derivatives(sigma)
    xx, xy, yy = (
        sigma**2 * cv2.sepFilter2D(grey, cv2.CV_32F, along_x, along_y, borderType=cv2.BORDER_REPLICATE)
        for along_x, along_y in ((bend, smooth), (slope, slope), (smooth, bend))
    )
    return xx, xy, yy


def gradient(
    grey: Float32[np.ndarray, "h w"], sigma: float
) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
    """First derivatives x, y of the picture smoothed by a Gaussian, times sigma."""
    smooth, slope, _ = gaussian_derivatives(sigma)
    x, y = (
        sigma * cv2.sepFilter2D(grey, cv2.CV_32F, along_x, along_y, borderType=cv2.BORDER_REPLICATE)
        for along_x, along_y in ((slope, smooth), (smooth, slope))
    )
    return x, y


def _derivatives(grey: Float32[np.ndarray, "h w"], config: RidgeConfig) -> Float32[np.ndarray, "s 5 h w"]:
    """Derivatives x, y, xx, xy, yy at each scale (times its powers), in units of the contrast nearby."""
    parts = np.empty((len(config.scales_px), 5, *grey.shape), np.float32)
    floor = max(config.floor * float(grey.std()), config.min_contrast)
    for k, sigma in enumerate(config.scales_px):
        smooth, slope, bend = gaussian_derivatives(sigma)
        filters = ((slope, smooth), (smooth, slope), (bend, smooth), (slope, slope), (smooth, bend))
        for i, (along_x, along_y) in enumerate(filters):
            parts[k, i] = cv2.sepFilter2D(grey, cv2.CV_32F, along_x, along_y, borderType=cv2.BORDER_REFLECT)
        parts[k, :2] *= sigma
        parts[k, 2:] *= sigma**2
        x, y, xx, xy, yy = parts[k]
        # The mean square over all directions of the slope, and about that of the bend.
        energy = (x**2 + y**2 + xx**2 + yy**2 + 2 * xy**2) / 2
        around = cv2.GaussianBlur(energy, (0, 0), config.around_px, borderType=cv2.BORDER_REFLECT)
        parts[k] /= np.sqrt(around + np.float32(floor**2))
    return parts


def _strongest(
    parts: Float32[np.ndarray, "s 5 U V"], angle: Float[np.ndarray, " d"], config: RidgeConfig
) -> tuple[Float32[np.ndarray, "U V"], Float[np.ndarray, "U V"]]:
    """The largest average over lines that run along the first axis, and the line's angle to that axis."""
    best = np.zeros(parts.shape[2:], np.float32)
    index = np.zeros(parts.shape[2:], np.int32)
    strongest_lines(
        np.ascontiguousarray(parts),
        np.tan(angle).astype(np.float32),
        config.half_length_px,
        np.float32(config.edge_weight),
        np.float32(config.max_response),
        best,
        index,
    )
    return best, angle[index]
