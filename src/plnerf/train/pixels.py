"""Which pixels a step draws.

A wire is a thousandth of an image, so a share of the pixels is drawn from the *detail pixels*: those of each
training image that a map of ridges (thin bright or dark lines) puts first.  Importance weights keep the loss
unbiased: with N pixels in all and D detail pixels, a pixel is drawn with probability
    q = (1 - share)/N + share/D [is detail]        and counts for        (1/N) / q.

A step sees few pixels of many: after 1,000 steps one in twenty of a small flight was drawn.  What a texture's
pixels differ by is noise as long as most were not, so that the mean of a small square stands for its pixel
until a tenth of them were.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from torch import Generator, Tensor

from plnerf.detect.config import DEFAULT
from plnerf.detect.config_lines import RidgeConfig
from plnerf.detect.ridges import hessian, ridge_map
from plnerf.errors import ConfigError
from plnerf.scene.images import ImageStore
from plnerf.train.config import DetailMap, TrainConfig

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
        xx, xy, yy = hessian(grey, sigma)
        largest = np.abs(xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)
        strength = np.maximum(strength, largest)
    return strength


DETAIL_MAPS: Mapping[str, Callable[[UInt8[np.ndarray, "h w 3"]], Float[np.ndarray, "h w"]]] = {
    "hessian": ridge_strength,
    "ridge": ridge_map,
}


def detail_pixels(
    store: ImageStore,
    images: tuple[int, ...],
    part: float,
    most: int = MOST_DETAIL_PIXELS,
    detail_map: DetailMap = "hessian",
    ridges: RidgeConfig = DEFAULT.ridges,
) -> Int[np.ndarray, " d"]:
    """Flat indices of the `part` of each image's pixels that the map puts first, in increasing order.

    Where these are more than `most` in all, every k-th of them: memory stays bounded, and the loss unbiased,
    since each of these fewer pixels is drawn more often and counts for less.
    """
    strength_of = partial(ridge_map, config=ridges) if detail_map == "ridge" else DETAIL_MAPS[detail_map]
    total = part * float(np.diff(store.starts)[list(images)].sum())
    stride = max(1, math.ceil(total / most))
    chosen = []
    for image in sorted(images):
        strength = strength_of(store.image(image)).ravel()
        count = max(1, round(part * strength.size))
        strongest = np.sort(np.argpartition(strength, -count)[-count:])
        chosen.append(store.starts[image] + strongest[image % stride % count :: stride])
    return np.concatenate(chosen).astype(np.int64)


@dataclass(frozen=True)
class Pool:
    """Pixels that are drawn more often: flat indices in increasing order, and their share of the draws."""

    pixels: Int[np.ndarray, " d"]
    share: float


def detail_pools(
    store: ImageStore,
    images: tuple[int, ...],
    share: float,
    part: float,
    detail_map: DetailMap = "hessian",
    ridges: RidgeConfig = DEFAULT.ridges,
) -> tuple[Pool, ...]:
    """The detail pixels, a `part` of all pixels, as a pool with a share; none where the share is 0."""
    if not share:
        return ()
    return (Pool(detail_pixels(store, images, part, detail_map=detail_map, ridges=ridges), share),)


class PixelSampler:
    """Draws pixels of the training images; holds no random state of its own.

    What is not drawn from a pool is drawn uniformly; a pixel's importance is one over how much more often
    than uniformly it is drawn, so that weighted means are those of uniform draws.
    """

    def __init__(
        self, store: ImageStore, images: tuple[int, ...], pools: Sequence[Pool] = (), unbias: float = 1.0
    ) -> None:
        self.store, self._unbias = store, unbias
        sizes = np.diff(store.starts)[list(images)]
        self._firsts = torch.from_numpy(store.starts[list(images)])
        self._ends = torch.from_numpy(np.cumsum(sizes))
        self.total = int(sizes.sum())
        self._pools = [torch.from_numpy(pool.pixels) for pool in pools]
        self._shares = [pool.share for pool in pools]
        self._uniform = 1 - sum(self._shares)
        if self._uniform <= 0:
            raise ConfigError(
                f"The pools' shares of the draws must leave some to all pixels, but are {self._shares}. "
                "Lower train.detail_share or train.curve_share."
            )

    def draw(
        self, rays: int, generator: Generator, share: slice = slice(None), side: int = 1
    ) -> PixelBatch:
        """A batch of pixels, drawn with replacement; of them the `share` that one process renders.

        Those of no pool have the mean colour of a square of `side` pixels: pools are there for what is thin.
        """
        within = torch.randint(self.total, (rays,), generator=generator)
        slot = torch.searchsorted(self._ends, within, right=True)
        flat = self._firsts[slot] + within - torch.where(slot > 0, self._ends[slot - 1], 0)
        choice, reached = torch.rand(rays, generator=generator), 0.0
        for pixels, part in zip(self._pools, self._shares, strict=True):
            pick = pixels[torch.randint(len(pixels), (rays,), generator=generator)]
            flat = torch.where((choice >= reached) & (choice < reached + part), pick, flat)
            reached += part
        flat = flat[share].contiguous()
        often, pooled = torch.full((len(flat),), self._uniform), torch.zeros(len(flat), dtype=torch.bool)
        for pixels, part in zip(self._pools, self._shares, strict=True):
            found = torch.searchsorted(pixels, flat).clamp(max=len(pixels) - 1)
            here = pixels[found] == flat
            often += part * self.total / len(pixels) * here
            pooled |= here
        camera, pixel_px = self.store.locate(flat)
        colour = self.store.colours(flat)
        if side > 1:
            colour[~pooled] = self.store.mean_colours(flat[~pooled], side)
        return PixelBatch(camera, pixel_px, colour, self.store.valid_flat(flat) * often**-self._unbias)

    def side_at(self, step: int, cfg: TrainConfig) -> int:
        """Side of the squares at a step: `smooth_px` until the draws are `smooth_draws` of all pixels."""
        return cfg.smooth_px if step * cfg.rays < cfg.smooth_draws * self.total else 1
