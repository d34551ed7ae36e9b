"""What is measured, and on what."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from plnerf.errors import ConfigError
from plnerf.ops.dispatch import BackendChoice

SUITES = ("ops", "train", "render", "span")


@dataclass(frozen=True)
class BenchConfig:
    """One call of `plnerf bench`."""

    out: Path
    """Folder for bench.json, bench.md and the runs that are made."""
    suites: tuple[str, ...] = ("ops", "train", "render")
    scene: Path | None = None
    """Scene of the suites train and render, or scene or folder of scenes of the suite span; None is the
    bundled span, with SPAN_SETTINGS for train and render."""
    run: Path | None = None
    """Finished run for the suite render; None trains one."""
    preset: str = "pl-nerf"
    settings: tuple[str, ...] = ()
    """Settings changed, as path.to.key=value."""
    downscale: int = 1
    seconds: float = 60.0
    """Training budget of the suite train, and of every run of the suite span."""
    targets_db: tuple[float, ...] = (18.0, 20.0, 22.0)
    """Held-out PSNRs whose times are told."""
    seed: int = 0
    device: Literal["auto", "cpu", "cuda"] = "auto"
    backend: BackendChoice = "auto"
    quick: bool = False
    """Small shapes and few repeats: to see that all works, not to quote."""

    def __post_init__(self) -> None:
        unknown = [name for name in self.suites if name not in SUITES]
        if unknown or not self.suites or len(set(self.suites)) < len(self.suites):
            what = f"there is no suite {unknown[0]!r}" if unknown else f"got --suite {' '.join(self.suites)}"
            raise ConfigError(
                f"--suite takes one or more of {', '.join(SUITES)}, each once, but {what}. Correct it."
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
