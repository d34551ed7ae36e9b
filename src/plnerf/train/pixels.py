"""Which pixels a step looks at.

A wire is a thousandth of an image, so a share of the pixels is drawn from the *detail pixels*: those with
the strongest ridges (thin bright or dark lines) of each training image.  Importance weights keep the loss
unbiased: with N pixels in all and D detail pixels, a pixel is drawn with probability
    q = (1 - share)/N + share/D [is detail]        and counts for        (1/N) / q.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from torch import Generator, Tensor

from plnerf.scene.images import ImageStore

MOST_DETAIL_PIXELS = 1 << 24
"""128 MB of indices: the detail pixels of some hundred photos at full size."""


@dataclass(frozen=True)
class PixelBatch:
    """r pixels drawn from the training images."""

    camera: Int[Tensor, " r"]
    pixel_px: Float[Tensor, "r 2"]
    colour: Float[Tensor, "r 3"]
    importance: Float[Tensor, " r"]  # 0 where a mask says "ignore"


def ridge_strength(image: UInt8[np.ndarray, "h w 3"]) -> Float[np.ndarray, "h w"]:
    """Largest absolute curvature of the brightness at scales of 1 and 2 px (Lindeberg's normalisation).

    sigma^2 max |lambda|, lambda the eigenvalues of the Hessian of the brightness smoothed by a Gaussian.
    """
    grey = image.astype(np.float32).mean(-1) / 255
    strength = np.zeros_like(grey)
    for sigma in (1.0, 2.0):
        smooth, slope, bend = _gaussian_derivatives(sigma)
        xx, xy, yy = (
            cv2.sepFilter2D(grey, cv2.CV_32F, along_x, along_y, borderType=cv2.BORDER_REPLICATE)
            for along_x, along_y in ((bend, smooth), (slope, slope), (smooth, bend))
        )
        largest = np.abs(xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)
        strength = np.maximum(strength, largest * sigma**2)
    return strength


def _gaussian_derivatives(sigma: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A Gaussian and its first and second derivative as filters, exact for constants, lines and parabolas.

    Differences of neighbours would do for an edge, but flatten a line one pixel wide to less than an edge.
    """
    x = np.arange(-math.ceil(4 * sigma), math.ceil(4 * sigma) + 1, dtype=np.float64)
    smooth = np.exp(-(x**2) / (2 * sigma**2))
    smooth /= smooth.sum()
    variance = (x**2 * smooth).sum()  # sigma^2, but for the sampling
    bend = (x**2 - variance) * smooth
    return smooth, x * smooth / variance, 2 * bend / (x**2 * bend).sum()


def detail_pixels(
    store: ImageStore, images: tuple[int, ...], part: float, most: int = MOST_DETAIL_PIXELS
) -> Int[np.ndarray, " d"]:
    """Flat indices of the `part` of each image's pixels with the strongest ridges, in increasing order.

    Where these are more than `most` in all, every k-th of them: memory stays bounded, and the loss unbiased,
    since each of these fewer pixels is drawn more often and counts for less.
    """
    total = part * float(np.diff(store.starts)[list(images)].sum())
    stride = max(1, math.ceil(total / most))
    chosen = []
    for image in sorted(images):
        strength = ridge_strength(store.image(image)).ravel()
        count = max(1, round(part * strength.size))
        strongest = np.sort(np.argpartition(strength, -count)[-count:])
        chosen.append(store.starts[image] + strongest[image % stride % count :: stride])
    return np.concatenate(chosen).astype(np.int64)


class PixelSampler:
    """Draws pixels of the training images; holds no random state of its own."""

    def __init__(self, store: ImageStore, images: tuple[int, ...], share: float, part: float) -> None:
        """`share` of the draws go to the detail pixels, a `part` of all pixels; share 0 draws uniformly."""
        self.store, self.share = store, share
        sizes = np.diff(store.starts)[list(images)]
        self._firsts = torch.from_numpy(store.starts[list(images)])
        self._ends = torch.from_numpy(np.cumsum(sizes))
        self.total = int(sizes.sum())
        self._detail = torch.from_numpy(detail_pixels(store, images, part)) if share else None

    def draw(self, rays: int, generator: Generator) -> PixelBatch:
        """A batch of pixels, drawn with replacement."""
        within = torch.randint(self.total, (rays,), generator=generator)
        slot = torch.searchsorted(self._ends, within, right=True)
        flat = self._firsts[slot] + within - torch.where(slot > 0, self._ends[slot - 1], 0)
        importance = torch.ones(rays)
        if self._detail is not None:
            count = len(self._detail)
            pick = self._detail[torch.randint(count, (rays,), generator=generator)]
            flat = torch.where(torch.rand(rays, generator=generator) < self.share, pick, flat)
            found = torch.searchsorted(self._detail, flat).clamp(max=count - 1)
            is_detail = self._detail[found] == flat
            importance = 1 / (1 - self.share + self.share * self.total / count * is_detail)
        camera, pixel_px = self.store.locate(flat)
        return PixelBatch(
            camera, pixel_px, self.store.colours(flat), importance * self.store.valid_flat(flat)
        )
