"""The pixels on the centre lines of wires, with where exactly between the pixels the wire lies.

A pixel is on a centre line where no response across its line is larger; chains of such pixels are kept where
they are long enough and somewhere clear enough (Canny's hysteresis).  The place and the width then come from
the brightness across the line, averaged over a few pixels along it: the wire map's own averages are too long
to follow a sagging wire.

Letters: n centre-line pixels, k samples across the line.  Pixel centres are at +0.5, x right, y down; the
normal is the tangent turned by +90 degrees, from +x towards +y.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from plnerf.detect.ridges import DEFAULT, Ridges, RidgeSettings, find_ridges, gaussian_derivatives
from plnerf.errors import ConfigError

REACH_PX = 12
"""Half the length of the profile across a line."""
STEPS = 4
"""Samples of the profile to a pixel."""
BESIDE_PX = (4, 8)
"""Distances from a line's middle between which its surroundings are looked at."""
FARTHEST_PX = 1.5
"""A place farther from its pixel than this is another line's, and the pixel is left out."""


@dataclass(frozen=True)
class PixelSettings:
    """Which chains of pixels are wires, and how they are measured."""

    weak: float = 0.35
    """Least strength in the wire map."""
    strong: float = 0.6
    """Strength that a chain must reach somewhere."""
    shortest_px: float = 30.0
    """Least extent of a chain."""
    along_px: float = 4.0
    """Half the length along the line over which the profile across it is averaged."""
    scale_px: float = 1.5
    """Standard deviation of the Gaussian whose second derivative places a line; s serves widths to 3.5 s."""

    def __post_init__(self) -> None:
        if not 0 <= self.weak <= self.strong <= 1 or min(self.along_px, self.scale_px) <= 0:
            raise ConfigError(
                f"Wire pixels need 0 <= weak <= strong <= 1 and positive lengths and scales, but got {self}."
            )


@dataclass(frozen=True, eq=False)
class WirePixels:
    """n pixels of one image, each a point on the centre line of something like a wire."""

    at_px: Float[np.ndarray, "n 2"]
    """Points x, y on centre lines, between the pixels; an image's corner is (0, 0)."""
    tangent_rad: Float[np.ndarray, " n"]
    """Direction of the line, in [0, pi) from +x towards +y; steps of the map's directions."""
    width_px: Float[np.ndarray, " n"]
    """Width of the line; lines below about 2 px are not told apart; 0 where neither side differs from it."""
    strength: Float[np.ndarray, " n"]
    """The wire map there, 0 to 1."""
    bright: Bool[np.ndarray, " n"]
    """Whether the line is brighter than its surroundings."""
    piece: Int[np.ndarray, " n"]
    """Number of the chain of pixels that a pixel belongs to."""


def wire_pixels(
    image: UInt8[np.ndarray, "h w 3"],
    settings: PixelSettings | None = None,
    ridges: RidgeSettings | Ridges = DEFAULT,
) -> WirePixels:
    """The centre lines of what looks like wires in an image; `ridges` may be the image's wire map itself."""
    settings = settings or PixelSettings()
    found = ridges if isinstance(ridges, Ridges) else find_ridges(image, ridges)
    piece = _pieces(found, settings)
    y, x = np.nonzero(piece)
    tangent = found.tangent_rad[y, x].astype(np.float64)
    bright = found.bright[y, x]
    centre = np.stack([x + 0.5, y + 0.5], 1)
    profile = _profiles(image, centre, tangent, settings.along_px) * np.where(bright, 1.0, -1.0)[:, None]
    offset, width, clear = _measure(profile, settings.scale_px)
    normal = np.stack([-np.sin(tangent), np.cos(tangent)], 1)
    kept = clear & (np.abs(offset) <= FARTHEST_PX)
    return WirePixels(
        at_px=(centre + offset[:, None] * normal)[kept],
        tangent_rad=tangent[kept],
        width_px=width[kept],
        strength=found.strength[y, x][kept].astype(np.float64),
        bright=bright[kept],
        piece=piece[y, x][kept],
    )


def centre_lines(ridges: Ridges) -> Bool[np.ndarray, "h w"]:
    """Where the map is largest across its line: no neighbour at 1 px to either side has more."""
    h, w = ridges.strength.shape
    y, x = np.mgrid[0:h, 0:w].astype(np.float32)
    nx, ny = -np.sin(ridges.tangent_rad), np.cos(ridges.tangent_rad)
    one, other = (
        cv2.remap(
            ridges.strength, x + side * nx, y + side * ny, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        for side in (1, -1)
    )
    return (ridges.strength >= one) & (ridges.strength >= other) & (ridges.strength > 0)


def _pieces(ridges: Ridges, settings: PixelSettings) -> Int[np.ndarray, "h w"]:
    """Numbers of the chains of centre-line pixels, from 1; 0 elsewhere and for chains too short or weak."""
    centre = centre_lines(ridges) & (ridges.strength >= settings.weak)
    pieces, before = np.zeros(centre.shape, np.int64), 0
    for bright in (True, False):
        count, label, box, _ = cv2.connectedComponentsWithStats(
            (centre & (ridges.bright == bright)).astype(np.uint8), connectivity=8
        )
        extent = np.hypot(box[:, cv2.CC_STAT_WIDTH], box[:, cv2.CC_STAT_HEIGHT])
        best = np.zeros(count)
        np.maximum.at(best, label.ravel(), ridges.strength.ravel())
        kept = (extent >= settings.shortest_px) & (best >= settings.strong)
        kept[0] = False
        number = np.where(kept, before + np.cumsum(kept), 0)
        pieces += number[label]
        before += int(kept.sum())
    return pieces


def _profiles(
    image: UInt8[np.ndarray, "h w 3"],
    centre: Float[np.ndarray, "n 2"],
    tangent: Float[np.ndarray, " n"],
    along_px: float,
) -> Float[np.ndarray, "n k"]:
    """Brightness across the line at each pixel, averaged along it, `STEPS` samples to a pixel."""
    grey = image.astype(np.float32).mean(-1)
    across = np.arange(-REACH_PX * STEPS, REACH_PX * STEPS + 1) / STEPS
    steps = np.arange(-math.floor(along_px), math.floor(along_px) + 1)
    c, s = np.cos(tangent), np.sin(tangent)
    total = np.zeros((len(centre), len(across)))
    if not len(centre):
        return total
    for step in steps:
        x = centre[:, :1] - 0.5 + step * c[:, None] - across * s[:, None]
        y = centre[:, 1:] - 0.5 + step * s[:, None] + across * c[:, None]
        # OpenCV takes pictures of at most 32767 rows, so a long list of pixels goes in slices.
        for i in range(0, len(centre), 30000):
            part = slice(i, i + 30000)
            total[part] += cv2.remap(
                grey, x[part].astype(np.float32), y[part].astype(np.float32), cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_REPLICATE,
            )  # fmt: skip
    return total / len(steps)


def _measure(
    profile: Float[np.ndarray, "n k"], scale_px: float
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Where the bright line of each profile has its middle, how wide it is, and whether there is one.

    The middle: the top of the parabola through the three largest samples of the response (the second
    derivative at one scale) near the profile's middle.  The width: between the crossings of half the height
    over what lies beside the line, on each side by itself.
    """
    n, k = profile.shape
    if not n:
        return np.zeros(0), np.zeros(0), np.zeros(0, bool)
    middle = k // 2
    bend = gaussian_derivatives(scale_px * STEPS)[2]
    response = -cv2.filter2D(profile, cv2.CV_64F, bend[None], borderType=cv2.BORDER_REPLICATE)
    window = round(2 * FARTHEST_PX) * STEPS // 2 + 1
    near = response[:, middle - window : middle + window + 1]
    top = middle - window + near.argmax(1)
    rows = np.arange(n)
    left, here, right = (response[rows, top + i] for i in (-1, 0, 1))
    curved = left + right - 2 * here
    clear = (curved < 0) & (here > 0)
    shift = np.where(clear, (left - right) / (2 * np.where(clear, curved, 1)), 0)
    clear &= np.abs(shift) <= 1  # otherwise the largest is at the window's end, and no top
    width = (_half_height(profile, top, -1) + _half_height(profile, top, 1)) / STEPS
    return (top + shift - middle) / STEPS, width, clear


def _half_height(
    profile: Float[np.ndarray, "n k"], top: Int[np.ndarray, " n"], side: int
) -> Float[np.ndarray, " n"]:
    """Steps from the top to where a profile has fallen half way to what lies beside, on one side; else 0."""
    n, k = profile.shape
    rows = np.arange(n)
    at = np.clip(top[:, None] + side * np.arange(BESIDE_PX[1] * STEPS + 1), 0, k - 1)
    fall = profile[rows, top][:, None] - profile[rows[:, None], at]
    half = np.median(fall[:, BESIDE_PX[0] * STEPS :], axis=1) / 2
    first = (fall >= half[:, None]).argmax(1)
    before = np.maximum(first - 1, 0)
    rise = fall[rows, first] - fall[rows, before]
    part = np.where(rise > 0, (half - fall[rows, before]) / np.where(rise > 0, rise, 1), 0)
    steps: Float[np.ndarray, " n"] = np.where(first > 0, before + part, 0.0)
    return steps
