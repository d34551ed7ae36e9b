"""Filming: each view of a flight as a photograph, a wire mask, and, where it is held out, its depth.

Wire masks and depth belong to the middle of the time that the shutter is open.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float
from PIL import Image

from plnerf.synth.capture import View
from plnerf.synth.config import SceneConfig
from plnerf.synth.effects import exposure_drift, luminance, next_gain, sensor_noise, white_balance_drift
from plnerf.synth.render import to_srgb
from plnerf.synth.shutter import flight_directions, open_shutter
from plnerf.synth.site import Site
from plnerf.synth.truth import MASK_COVERAGE

HOLD_OUT_EVERY = 8  # the scene folder's default rule: every 8th by name is held out


@runtime_checkable
class Studio(Protocol):
    """What takes the pictures of a site."""

    def linear(self, instants: Sequence[View], seed: int) -> Float[np.ndarray, "h w 3"]:
        """Linear light at the fixed exposure, 1 is white; the mean over the instants of an open shutter."""

    def wire_coverage(self, view: View) -> Float[np.ndarray, "h w"]:
        """The fraction of each pixel's area in which a conductor or shield wire is seen."""

    def depth_m(self, view: View) -> Float[np.ndarray, "h w"]:
        """Distance along the camera's z axis of what each pixel's centre sees; 0 for the sky."""


def film(
    studio: Studio,
    site: Site,
    views: Sequence[View],
    config: SceneConfig,
    folder: Path,
    progress: Callable[[int, int], None] | None = None,
) -> list[Bool[np.ndarray, "h w"]]:
    """Write images/, wire_masks/ and depth/ into `folder` and return the wire masks.

    `progress(done, total)` is called after each view.
    """
    for name in ("images", "wire_masks", "depth"):
        (folder / name).mkdir(parents=True)
    masks = []
    for i, photo in enumerate(_photos(studio, site, views, config)):
        view = views[i]
        subsampling = 0 if config.image.jpeg_quality >= 90 else 2
        Image.fromarray(to_srgb(photo)).save(
            folder / "images" / f"{view.name}.jpg",
            quality=config.image.jpeg_quality,
            subsampling=subsampling,
            optimize=True,
        )
        masks.append(studio.wire_coverage(view) >= MASK_COVERAGE)
        mask = np.where(masks[-1], 255, 0).astype(np.uint8)
        Image.fromarray(mask).save(folder / "wire_masks" / f"{view.name}.png", optimize=True)
        if i % HOLD_OUT_EVERY == 0:
            millimetres = np.rint(1000 * studio.depth_m(view))
            stored = np.where(millimetres > 65535, 0, millimetres).astype(np.uint16)  # 16 bits end at 65.5 m
            Image.fromarray(stored).save(folder / "depth" / f"{view.name}.png", optimize=True)
        if progress is not None:
            progress(i + 1, len(views))
    return masks


def _photos(
    studio: Studio, site: Site, views: Sequence[View], config: SceneConfig
) -> Iterator[Float[np.ndarray, "h w 3"]]:
    """What the sensor holds of each view, in time order: linear light, 1 is white."""
    image, n = config.image, len(views)
    rng = np.random.default_rng([config.seed, 6])
    gains = exposure_drift(n, image.exposure_drift, rng)[:, None]
    gains = gains * white_balance_drift(n, image.white_balance_drift, rng)
    instants = min(image.samples_per_pixel, math.ceil(image.motion_blur_px) + 1)
    wires = np.concatenate([wire.polyline(0.5) for wire in site.wires])
    directions = flight_directions(views)
    automatic: float | None = None
    for i, view in enumerate(views):
        own = np.random.default_rng([config.seed, 7, i])
        opened = open_shutter(view, directions[i], wires, config.capture, image.motion_blur_px, own, instants)
        linear = studio.linear(opened, i)
        if image.auto_exposure:
            automatic = next_gain(automatic, luminance(linear))
            linear = linear * automatic
        yield sensor_noise(linear * gains[i], image.noise, own)
