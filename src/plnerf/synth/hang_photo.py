"""What a camera did to a photo, so that something drawn into it looks alike: sharpness, noise, JPEG.

Letters: L linear light, 1 is white; grey values 0 to 255 as stored; h x w pixels.
"""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from PIL import ExifTags, Image, JpegImagePlugin
from scipy.ndimage import gaussian_filter1d

from plnerf.scene.files import complete_file

REBLUR_PX = 1.5
"""Blur that is added to measure what is there."""
DERIVATIVE_PX = 1.0
"""Width of the Gaussians whose derivatives give gradients; narrower ones are not sampled well."""
EDGE_QUANTILE = 0.98
"""Pixels of greater gradient than this share of all are edges."""
SIGMA_PX = (0.35, 3.0)
"""Blurs that are believed.  Cameras that sharpen, and photos made smaller, have edges steeper than a pixel
leaves them: they get the first."""
BLOCK_PX = 16
"""Side of the blocks in which noise is measured."""
QUIET_QUANTILE = 0.1
"""Of the blocks of one brightness: the smoothest show noise alone."""
LEVELS = 16
"""Levels of brightness at which noise is measured."""
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True, eq=False)
class NoiseLevel:
    """Standard deviation of the noise by brightness, both in grey values."""

    level: Float[np.ndarray, " m"]
    sigma: Float[np.ndarray, " m"]

    def at(self, grey: Float[np.ndarray, "*p"]) -> Float[np.ndarray, "*p"]:
        """The standard deviation at a brightness."""
        return np.interp(grey, self.level, self.sigma)


def to_linear(stored: Float[np.ndarray, "*p"]) -> Float[np.ndarray, "*p"]:
    """Linear light of sRGB values (0 to 255).  IEC 61966-2-1."""
    v = stored / 255
    linear: Float[np.ndarray, "*p"] = np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)
    return linear


def to_stored(linear: Float[np.ndarray, "*p"]) -> Float[np.ndarray, "*p"]:
    """The inverse of `to_linear`; light beyond white is clipped."""
    L = np.clip(linear, 0.0, 1.0)
    stored: Float[np.ndarray, "*p"] = 255 * np.where(
        L <= 0.0031308, 12.92 * L, 1.055 * L ** (1 / 2.4) - 0.055
    )
    return stored


def sharpness_px(rgb: UInt8[np.ndarray, "h w 3"]) -> float:
    """Standard deviation of the blur of the photo's strong edges, pixels.

    S. Zhuo, T. Sim, "Defocus map estimation from a single image", Pattern Recognition 44, 2011: a step of
    blur sigma has at its middle a gradient R = sqrt((sigma^2 + s^2) / sigma^2) times as large as after a
    further blur of s.
    """
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float64)
    sharp = _gradient(grey, DERIVATIVE_PX)
    soft = _gradient(grey, float(np.hypot(DERIVATIVE_PX, REBLUR_PX)))
    edge = sharp >= max(float(np.quantile(sharp, EDGE_QUANTILE)), 1.0)
    # Only ridges of the gradient are middles of edges.
    edge &= sharp >= cv2.dilate(sharp, np.ones((3, 3), np.uint8)) - 1e-9
    ratio = sharp[edge] / np.maximum(soft[edge], 1e-9)
    ratio = ratio[ratio > 1.01]
    if not len(ratio):
        return 1.0
    both = REBLUR_PX / np.sqrt(ratio**2 - 1)  # of the step and of the derivative
    sigma = np.sqrt(max(float(np.median(both)) ** 2 - DERIVATIVE_PX**2, 0.0))
    return float(np.clip(sigma, *SIGMA_PX))


def _gradient(grey: Float[np.ndarray, "h w"], width: float) -> Float[np.ndarray, "h w"]:
    x = gaussian_filter1d(gaussian_filter1d(grey, width, 1, order=1), width, 0)
    y = gaussian_filter1d(gaussian_filter1d(grey, width, 0, order=1), width, 1)
    found: Float[np.ndarray, "h w"] = np.hypot(x, y)
    return found


def noise_level(rgb: UInt8[np.ndarray, "h w 3"]) -> NoiseLevel:
    """Noise by brightness, from the smoothest blocks of each.

    J. Immerkaer, "Fast noise variance estimation", Computer Vision and Image Understanding 64(2), 1996: a
    mask that sees neither slopes nor edges, whose answer to white noise is 6 times its standard deviation.
    """
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float64)
    mask = np.outer([1.0, -2.0, 1.0], [1.0, -2.0, 1.0])
    answer = np.abs(cv2.filter2D(grey, cv2.CV_64F, mask))
    h, w = (side // BLOCK_PX * BLOCK_PX for side in grey.shape)
    if min(h, w) == 0:
        return NoiseLevel(np.array([0.0]), np.array([0.0]))

    def blocks(values: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "b p"]:
        cut = values[:h, :w].reshape(h // BLOCK_PX, BLOCK_PX, w // BLOCK_PX, BLOCK_PX)
        return cut.swapaxes(1, 2).reshape(-1, BLOCK_PX**2)

    mean = blocks(grey).mean(1)
    sigma = np.sqrt(np.pi / 2) / 6 * blocks(answer).mean(1)
    # Clipped blocks, black or white, show no noise.
    use = (mean > 4) & (mean < 250)
    mean, sigma = (mean[use], sigma[use]) if use.any() else (mean, sigma)
    order = np.argsort(mean, kind="stable")
    parts = [part for part in np.array_split(order, LEVELS) if len(part)]
    return NoiseLevel(
        np.array([mean[part].mean() for part in parts]),
        np.array([np.quantile(sigma[part], QUIET_QUANTILE) for part in parts]),
    )


def exposures(paths: Sequence[Path]) -> Float[np.ndarray, " n"]:
    """Light that each photo took in, as EXIF states it (time x ISO / f-number^2), relative to their median.

    1 for all where any photo states none.
    """
    found = np.array([_exposure(path) for path in paths])
    if not (np.isfinite(found) & (found > 0)).all():
        return np.ones(len(paths))
    relative: Float[np.ndarray, " n"] = found / np.median(found)
    return relative


def _exposure(path: Path) -> float:
    with Image.open(path) as image:
        tags = image.getexif().get_ifd(ExifTags.IFD.Exif)
    try:
        iso = tags.get(ExifTags.Base.ISOSpeedRatings, 100)
        iso = float(iso[0] if isinstance(iso, tuple) else iso)
        f = float(tags.get(ExifTags.Base.FNumber, 1.0))
        return float(tags[ExifTags.Base.ExposureTime]) * iso / f**2
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        return float("nan")


def write_like(source: Path, rgb: UInt8[np.ndarray, "h w 3"], target: Path) -> None:
    """Writes a picture as `source` is: its format, JPEG tables and subsampling, EXIF, XMP, colour profile."""
    with Image.open(source) as image:
        kept: dict[str, Any] = {
            key: image.info[key]
            for key in ("exif", "xmp", "icc_profile", "comment", "dpi")
            if key in image.info
        }
        if isinstance(image, JpegImagePlugin.JpegImageFile):
            kept |= {
                "qtables": image.quantization,
                "subsampling": JpegImagePlugin.get_sampling(image),
                "progressive": bool(image.info.get("progressive")),
                "optimize": True,
            }
        form = str(image.format)
    with complete_file(target) as beside:
        Image.fromarray(rgb).save(beside, format=form, **kept)


def copy_photo(source: Path, target: Path) -> None:
    """The file as it is."""
    with complete_file(target) as beside:
        shutil.copyfile(source, beside)
