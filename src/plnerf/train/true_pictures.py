"""What is known of a scene's images beside their colours: which pixels are wires, and how deep each pixel is.

Letters: h rows, w columns of a render; H and W those of the full-size truth.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float, Shaped, UInt16
from PIL import Image

from plnerf.errors import SceneError
from plnerf.scene.build_store import reduce_by_area

WIRE_RULE = "a pixel is the wire's where at least half of a line one full-size pixel wide would cover it"
CLOSE_M = 0.25
FARTHEST_MM = 65535
"""The largest number of a 16-bit picture, which also stands for whatever is farther."""


@dataclass(frozen=True)
class DepthError:
    """How far the rendered depth along the camera's z axis is from the truth, over the pixels of a set."""

    pixels: int
    median_m: float | None
    """Median absolute error over the pixels where the render has a surface; None without any."""
    close_share: float
    """Share of all pixels whose error is at most `CLOSE_M`."""
    no_surface_share: float
    """Share of the pixels where the render has no surface."""


def depth_error(
    rendered_m: Float[np.ndarray, "h w"], truth_mm: UInt16[np.ndarray, "H W"], use: Bool[np.ndarray, "H W"]
) -> DepthError | None:
    """Compares each full-size pixel in use that has a true depth with the rendered pixel that covers it.

    rendered_m: 0 = no surface; truth_mm: 0 = no surface, 65535 = that far or farther; neither is compared.
    No depth is averaged.  None where no pixel is left.
    """
    use = use & (truth_mm > 0) & (truth_mm < FARTHEST_MM)
    if not use.any():
        return None
    rendered = at_full_size(rendered_m, truth_mm.shape)[use].astype(np.float64)
    found = rendered > 0
    error_m = np.abs(rendered - truth_mm[use] / 1000)
    return DepthError(
        pixels=int(use.sum()),
        median_m=float(np.median(error_m[found])) if found.any() else None,
        close_share=float((found & (error_m <= CLOSE_M)).mean()),
        no_surface_share=float(1 - found.mean()),
    )


def reduced_wire_mask(
    full: Bool[np.ndarray, "H W"], size_px: tuple[int, int], dilate_px: int = 0
) -> Bool[np.ndarray, "h w"]:
    """A full-size wire mask at another size (width, height), then grown by a disc of `dilate_px` pixels.

    Reduced by area: a line one full-size pixel wide covers 1/f of each pixel on it at a reduction by f, and
    half of that is enough.
    """
    covered = reduce_by_area(full.astype(np.float32), size_px)
    wire: Bool[np.ndarray, "h w"] = covered >= 0.5 * min(1.0, size_px[0] / full.shape[1])
    if dilate_px > 0:
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * dilate_px + 1, 2 * dilate_px + 1))
        return cv2.dilate(wire.astype(np.uint8), disc) > 0
    return wire


def at_full_size(reduced: Shaped[np.ndarray, "h w"], shape: tuple[int, ...]) -> Shaped[np.ndarray, "H W"]:
    """Each full-size pixel's value in a reduced array: that of the pixel which covers its centre."""
    rows, columns = (
        ((np.arange(full) + 0.5) * small / full).astype(np.int64)
        for full, small in zip(shape, reduced.shape, strict=True)
    )
    full_size: Shaped[np.ndarray, "H W"] = reduced[rows[:, None], columns]
    return full_size


def read_wire_mask(path: Path) -> Bool[np.ndarray, "H W"]:
    """A scene's wire mask, True on wires.  Raises SceneError where it is none."""
    array = _read(path, "wire mask", "wire_mask_path")
    if array.dtype != np.uint8 or array.ndim != 2:
        raise SceneError(
            f"The wire mask {path} must be an 8-bit grey picture (255 on wires), but is {array.dtype} of "
            f"shape {array.shape}. Write it again, or take wire_mask_path out of transforms.json."
        )
    wire: Bool[np.ndarray, "H W"] = array >= 128
    return wire


def read_depth_mm(path: Path) -> UInt16[np.ndarray, "H W"]:
    """A scene's depth picture in millimetres, 0 = no surface.  Raises SceneError where it is none."""
    array = _read(path, "depth picture", "depth_path")
    # Older versions of Pillow give 16-bit grey as int32.
    if array.dtype not in (np.uint16, np.int32) or array.ndim != 2:
        raise SceneError(
            f"The depth picture {path} must be 16-bit grey (millimetres, 0 = no surface), but is "
            f"{array.dtype} of shape {array.shape}. Write it again, or take depth_path out of "
            "transforms.json."
        )
    return array.astype(np.uint16)


def _read(path: Path, what: str, key: str) -> Shaped[np.ndarray, "..."]:
    try:
        with Image.open(path) as image:
            return np.asarray(image)
    except Exception as error:  # a decoder that meets damaged bytes can raise anything
        raise SceneError(
            f"The {what} {path} cannot be read ({error}). Put it back, or take {key} out of transforms.json."
        ) from error
