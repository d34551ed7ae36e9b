"""What is measured, and on what."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from plnerf.errors import ConfigError
from plnerf.ops.backends import BackendChoice
from plnerf.render.config import ModelConfig
from plnerf.train.config import Settings

SUITES = ("ops", "train", "render", "span", "coverage")
SPAN_PRESETS = ("nerfacto", "pl-nerf", "pl-nerf-wire")
"""Systems of the suite span."""
REPORTED_SEEDS = tuple(range(41, 80, 2))
"""Seeds of the scenes whose figures are reported; settings were chosen on even seeds, and after those
of odd ones up to 39 had been inspected."""


@dataclass(frozen=True)
class BenchConfig:
    """One call of `plnerf bench`."""

    out: Path
    """Folder for bench.json, bench.md and the runs that are made."""
    suites: tuple[str, ...] = ("ops", "train", "render")
    scene: Path | None = None
    """Scene of the suites train and render, or scene or folder of scenes of the suite span; None is the
    bundled span."""
    run: Path | None = None
    """Finished run for the suite render; None trains one."""
    preset: str = "pl-nerf"
    systems: Mapping[str, Settings] = field(default_factory=dict)
    """Settings of presets, by their names; those of a preset that is not here are its own."""
    downscale: int = 1
    seconds: float = 60.0
    """Training budget of the suite train, and of every run of the suite span."""
    targets_db: tuple[float, ...] = (18.0, 20.0, 22.0)
    """Held-out PSNRs whose times are reported."""
    seed: int = 0
    device: Literal["auto", "cpu", "cuda"] = "auto"
    backend: BackendChoice = "auto"
    quick: bool = False
    """Small shapes and few repeats: to see that all works, not to quote."""
    seeds: tuple[int, ...] = REPORTED_SEEDS
    """Seeds of the LiDAR flights that the suite `coverage` simulates."""
    image_seeds: tuple[int, ...] = ()
    """Seeds of the random scenes that it renders, which takes minutes each."""
    scenes: tuple[Path, ...] = ()
    """Folders of rendered scenes that it takes as they are."""

    def __post_init__(self) -> None:
        unknown = [name for name in self.suites if name not in SUITES]
        if unknown or not self.suites or len(set(self.suites)) < len(self.suites):
            what = f"there is no suite {unknown[0]!r}" if unknown else f"got --suite {' '.join(self.suites)}"
            raise ConfigError(
                f"--suite takes one or more of {', '.join(SUITES)}, each once, but {what}. Correct it."
            )
        if min((*self.seeds, *self.image_seeds), default=0) < 0:
            raise ConfigError(
                f"Seeds must be 0 or more, but --seeds is {self.seeds} and --image-seeds is "
                f"{self.image_seeds}."
            )
        if len({scene.resolve().name for scene in self.scenes}) < len(self.scenes):
            raise ConfigError(
                "Results are named after their scenes' folders, but of --scenes two have one name: "
                f"{', '.join(map(str, self.scenes))}. Rename one."
            )
        if not 0 < self.seconds < math.inf or not all(map(math.isfinite, self.targets_db)):
            raise ConfigError(
                "The budget must be positive and finite and targets finite, but --seconds is "
                f"{self.seconds} and --targets is {self.targets_db}."
            )
        for name in ("bench.json", "train", "profile", "render"):
            if (self.out / name).exists():
                raise ConfigError(
                    f"The bench writes a new folder, but {self.out / name} is there already. Remove it, or "
                    "name another folder: -o."
                )


def for_the_span(settings: Settings) -> Settings:
    """pl-nerf for the bundled span, as it is compared with pl-nerf-wire; other systems as they are.

    Cells across the line are three times smaller than along it, upwards twice; three times as many samples on
    fewer rays.
    """
    if not isinstance(settings.model, ModelConfig):
        return settings
    sampler = replace(settings.model.sampler, proposals=(128, 96), final=64)
    train = replace(
        settings.train,
        rays=320,
        normal_rays=16,
        detail_part=0.05,
        loss=replace(settings.train.loss, distortion=0.0003),
    )
    model = replace(settings.model, stretch=(1.0, 3.0, 2.0), sampler=sampler)
    return replace(settings, model=model, train=train)
