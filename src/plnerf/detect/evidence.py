"""Evidence of lines in a direction in each image: the response of a ridge filter in one direction per pixel.

All lines in one direction of space meet in one point of an image, their vanishing point; the direction from a
pixel to it is the only one a wire can have there, but for its sag, which views along the line show many times
enlarged.  A wire is a ridge across that direction: the second derivative of the brightness is large across it
and small along it.

Letters: images of h x w pixels, H x W blocks.
"""

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

from plnerf.detect.config_lines import EvidenceConfig
from plnerf.detect.directed_sums import average_along
from plnerf.detect.line_ridges import LineRidges, joined_ridges, steps_of
from plnerf.detect.line_samples import bend_across, padded, strongest_across
from plnerf.detect.reduction import reduction, strongest_of_blocks, tiles, valid_blocks
from plnerf.detect.ridges import gradient, grey_of, hessian
from plnerf.scene.cameras import Cameras
from plnerf.scene.photos import Pictures

FAN_STEP = 4
"""Blocks between which the angles of fans are interpolated: they cost as much as what they are for."""


@dataclass(frozen=True)
class Vanishing:
    """Which way a line along a direction of space runs at each pixel of an image.

    The lens is left out: it turns directions by a degree or two.
    """

    along: tuple[float, float, float]
    """The direction in camera axes."""
    focal: tuple[float, float]
    principal: tuple[float, float]
    beside: tuple[tuple[float, float, float], ...] = ()
    """The outermost of the directions that lines may have beside it, in camera axes."""

    def towards(
        self, shape: tuple[int, ...], corner: tuple[int, int] = (0, 0), k: int = 1
    ) -> Float32[np.ndarray, "h w 2"]:
        """Unit vectors (x, y) at the middles of blocks of k x k pixels.

        shape: rows and columns of blocks; corner: row and column of the first pixel.
        """
        return self._towards(self.along, shape, corner, k)

    def fan(
        self, towards: Float32[np.ndarray, "h w 2"], k: int, config: EvidenceConfig
    ) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
        """Least and largest angle by which lines may be turned from `towards` at blocks of k x k pixels.

        A wire that sags is turned by its slope where it is seen from aside, not at all from straight above,
        and by many times as much where a view runs along it.
        """
        low, high = (np.zeros(towards.shape[:2], np.float32) for _ in range(2))
        ux, uy = towards[..., 0], towards[..., 1]
        for direction in self.beside:
            x, y = np.moveaxis(self._towards(direction, low.shape, (0, 0), k), 2, 0)
            turn = np.arctan2(ux * y - uy * x, ux * x + uy * y)
            np.minimum(low, turn, out=low)
            np.maximum(high, turn, out=high)
        most, lens = (np.float32(math.radians(one)) for one in (config.most_deg, config.lens_deg))
        return np.maximum(low, -most) - lens, np.minimum(high, most) + lens

    def _towards(
        self, along: tuple[float, float, float], shape: tuple[int, ...], corner: tuple[int, int], k: int
    ) -> Float32[np.ndarray, "h w 2"]:
        (ax, ay, az), (fx, fy), (cx, cy) = along, self.focal, self.principal
        rows, columns = (
            (at + k * (np.arange(n) + 0.5)).astype(np.float32) for at, n in zip(corner, shape, strict=True)
        )
        # A point moved along the direction moves in the image by (a_xy - uv a_z) / depth.
        dx = fx * ax - (columns - cx) * az
        dy = (fy * ay - (rows - cy) * az)[:, None]
        length = np.maximum(np.sqrt(dx**2 + dy**2), 1e-9)
        out = np.empty((*length.shape, 2), np.float32)
        out[..., 0], out[..., 1] = dx / length, dy / length
        return out


def vanishing(
    cameras: Cameras, i: int, direction: Float[np.ndarray, "3"], config: EvidenceConfig
) -> Vanishing:
    """For image i and a direction of the scene, and those that wires along it may have."""
    R = cameras.R_scene_camera[i].double().numpy()
    fx, fy = (float(v) for v in cameras.focal_px[i])
    cx, cy = (float(v) for v in cameras.principal_px[i])
    along, *beside = [(float(x), float(y), float(z)) for x, y, z in wire_directions(direction, config) @ R]
    return Vanishing(along, (fx, fy), (cx, cy), tuple(beside))


def wire_directions(
    direction: Float[np.ndarray, "3"], config: EvidenceConfig
) -> Float[np.ndarray, "d 3"]:
    """A direction of the scene, and the outermost of those that wires have which run along it."""
    x, y, z = direction
    turns = np.array([(0, 0), *product((-1, 1), (-1, 1))])
    azimuth = np.arctan2(y, x) + np.radians(config.askew_deg) * turns[:, 0]
    slope = np.arctan2(z, np.hypot(x, y)) + np.radians(config.sag_deg) * turns[:, 1]
    flat = np.cos(slope)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(slope)], 1)


def line_response(
    image: UInt8[np.ndarray, "h w 3"], lines: Vanishing, config: EvidenceConfig
) -> Float32[np.ndarray, "H W"]:
    """The responses of `line_ridges` alone."""
    return line_ridges(image, lines, config).response


def line_ridges(image: UInt8[np.ndarray, "h w 3"], lines: Vanishing, config: EvidenceConfig) -> LineRidges:
    """Response of each block of k x k pixels to a line in the given direction, and the way the line runs.

    The second derivative across the direction less the one along it and less the first derivative across it,
    of either sign, at the best of a few scales (Lindeberg's normalisation), at the image's own resolution;
    the strongest of a block is averaged along the line, in units of the neighbourhood's; 0 beside the ridge's
    middle.  k is 1 in images of up to `most_px`.
    """
    h, w = image.shape[:2]
    k = reduction((w, h), config.most_px)
    best = np.empty((-(-h // k), -(-w // k)), np.float32)
    for tile in tiles((h, w), config.most_px // k * k, config.margin_px):
        corner = (tile.outer[0].start, tile.outer[1].start)
        bend = _bend(image[tile.outer], lines, corner, config)[tile.within]
        rows, columns = (slice(part.start // k, -(-part.stop // k)) for part in tile.inner)
        best[rows, columns] = strongest_of_blocks(bend, k)
    towards = lines.towards(best.shape, k=k)
    straight = np.arctan2(towards[..., 1], towards[..., 0])
    low, high = (straight + turn for turn in _fan(best.shape, lines, k, config))
    best, direction = average_along(best, low, high, math.radians(config.apart_deg), config.along_px)
    response = np.minimum(np.abs(best) / (config.full_response * _around(best, config)), 1)
    ridge = np.empty(best.shape, bool)
    picture = padded(best, config.echo_px)
    strongest_across(picture, towards, np.float32(0), config.beside_px, config.echo_px, ridge)
    tangent = np.zeros(best.shape, np.uint8)
    tangent[ridge] = steps_of(direction[ridge])
    return LineRidges(np.where(ridge, response, np.float32(0)), tangent)


def _fan(
    shape: tuple[int, ...], lines: Vanishing, k: int, config: EvidenceConfig
) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
    """`Vanishing.fan`, which is smooth, between blocks `FAN_STEP` times as wide."""
    h, w = shape
    few = -(-h // FAN_STEP), -(-w // FAN_STEP)
    wide = lines.fan(lines.towards(few, k=FAN_STEP * k), FAN_STEP * k, config)
    low, high = (cv2.resize(turn, (FAN_STEP * few[1], FAN_STEP * few[0]))[:h, :w] for turn in wide)
    return low, high


def _bend(
    image: UInt8[np.ndarray, "h w 3"], lines: Vanishing, corner: tuple[int, int], config: EvidenceConfig
) -> Float32[np.ndarray, "h w"]:
    """The second derivative across the line beyond what edges and texture have, with its sign, limited."""
    grey = grey_of(image)
    towards = lines.towards(grey.shape, corner)
    best = np.zeros_like(grey)
    for sigma in config.scales_px:
        weight = np.float32(sigma ** (config.gamma - 2))
        derivatives = hessian(grey, sigma), gradient(grey, sigma)
        bend_across(*derivatives, towards, np.float32(config.edge_weight), weight, best)
    limit = config.max_bend * _around(best, config)
    return np.clip(best, -limit, limit)


def _around(bend: np.ndarray, config: EvidenceConfig) -> np.ndarray:
    """Root mean square of the bends in the neighbourhood."""
    square: np.ndarray = bend * bend
    for width in _box_widths(config.contrast_px):
        square = cv2.blur(square, (width, width))
    # What running sums are rounded by is less than nothing somewhere.
    return np.sqrt(np.maximum(square, 0)) + np.float32(config.min_bend)


def _box_widths(sigma_px: float) -> list[int]:
    """Widths of three running means: together they are nearly a Gaussian, at the same cost for any width."""
    narrow = max(1, math.floor(math.sqrt(4 * sigma_px**2 + 1)) - 1) // 2 * 2 + 1
    count = round((3 * narrow**2 + 12 * narrow + 9 - 12 * sigma_px**2) / (4 * narrow + 4))
    return [narrow + 2 * (k >= count) for k in range(3)]


def line_evidence(
    photos: Pictures,
    cameras: Cameras,
    images: Sequence[int],
    direction: Float[np.ndarray, "3"],
    config: EvidenceConfig,
    progress: Callable[[int], None] | None = None,
) -> list[LineRidges]:
    """Of each of the chosen photos the lines along a direction of the scene frame.

    Block by block, row after row; where any pixel is masked out there is none.  progress: called with the
    number of photos done.
    """

    def one(i: int) -> LineRidges:
        picture = photos.image(i)
        ridges = line_ridges(picture, vanishing(cameras, i, direction, config), config)
        if photos.has_masks:
            k = reduction(picture.shape[:2], config.most_px)
            ridges.response[~valid_blocks(photos.valid(i), k)] = 0
        return joined_ridges([ridges])

    maps = []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for done, part in enumerate(pool.map(one, images), 1):
            maps.append(part)
            if progress is not None:
                progress(done)
    return maps
