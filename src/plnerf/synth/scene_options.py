"""What `plnerf synth` may change of a named scene.  None leaves the scene's own value."""

from dataclasses import dataclass, replace
from typing import TypeVar

from plnerf.errors import ConfigError
from plnerf.synth.config import ImageConfig, SceneConfig
from plnerf.synth.flight_config import CaptureConfig
from plnerf.synth.random_scene import random_scene
from plnerf.synth.scenes import SCENES

T = TypeVar("T")
RANDOM = "random"
"""Names the scene that its seed draws."""
RANDOM_SPAN = "random-span"
"""Likewise, filmed from structure to structure."""


@dataclass(frozen=True)
class SceneOptions:
    """Changes to a scene; lengths in metres, angles in degrees, image sizes and blur in pixels."""

    seed: int | None = None
    samples: int | None = None
    width: int | None = None
    """the focal length changes alike, and so does the height unless it is given: the same picture"""
    height: int | None = None
    views: int | None = None
    """images of each pass"""
    motion_blur: float | None = None
    noise: float | None = None
    jpeg_quality: int | None = None
    auto_exposure: bool | None = None
    exposure_drift: float | None = None
    white_balance_drift: float | None = None
    pose_noise_m: float | None = None
    pose_noise_deg: float | None = None

    def apply(self, scene: SceneConfig) -> SceneConfig:
        """The scene with these changes.  Raises ConfigError for a value that no scene can have."""
        if self.seed is not None:
            if self.seed < 0:
                raise ConfigError(f"synth: the seed must be 0 or more, got {self.seed}.")
            scene = scene.with_seed(self.seed)
        return replace(scene, capture=self._capture(scene.capture), image=self._image(scene.image))

    def _capture(self, capture: CaptureConfig) -> CaptureConfig:
        width = capture.width_px if self.width is None else self.width
        scale = width / capture.width_px
        return replace(
            capture,
            width_px=width,
            height_px=round(capture.height_px * scale) if self.height is None else self.height,
            focal_px=capture.focal_px * scale,
            views_per_pass=_either(self.views, capture.views_per_pass),
            pose_noise_m=_either(self.pose_noise_m, capture.pose_noise_m),
            pose_noise_deg=_either(self.pose_noise_deg, capture.pose_noise_deg),
        )

    def _image(self, image: ImageConfig) -> ImageConfig:
        return replace(
            image,
            samples_per_pixel=_either(self.samples, image.samples_per_pixel),
            motion_blur_px=_either(self.motion_blur, image.motion_blur_px),
            noise=_either(self.noise, image.noise),
            jpeg_quality=_either(self.jpeg_quality, image.jpeg_quality),
            auto_exposure=_either(self.auto_exposure, image.auto_exposure),
            exposure_drift=_either(self.exposure_drift, image.exposure_drift),
            white_balance_drift=_either(self.white_balance_drift, image.white_balance_drift),
        )


def find_scene(name: str, seed: int | None = None) -> SceneConfig:
    """The scene of a name; of "random" and "random-span" the one that is drawn of `seed` (0 where it
    is left out).

    Raises ConfigError naming the ones there are.
    """
    if name in (RANDOM, RANDOM_SPAN):
        if seed is not None and seed < 0:
            raise ConfigError(f"synth: the seed must be 0 or more, got {seed}.")
        return random_scene(seed or 0, whole_span=name == RANDOM_SPAN)
    if name not in SCENES:
        raise ConfigError(f"There is no scene {name!r}. Scenes: {', '.join((*SCENES, RANDOM, RANDOM_SPAN))}.")
    return SCENES[name]


def _either(given: T | None, own: T) -> T:
    return own if given is None else given
