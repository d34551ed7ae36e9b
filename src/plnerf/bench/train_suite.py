"""The suite `train`: the real training loop, timed by a report of its own.

Seconds of training are those that the loop charges to its budget: steps without the first one (which compiles
or loads the kernels), without validation and saving.  Wall-clock seconds count all from the call on.
"""

import statistics
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from rich.console import Console
from torch import Tensor

from plnerf.bench.config import BenchConfig
from plnerf.bench.machine import MEMORY_MEANING
from plnerf.bench.tables import Table, figure
from plnerf.console import bar
from plnerf.errors import ConfigError
from plnerf.pipeline import bundled_span, train_scene
from plnerf.presets._find import find_preset
from plnerf.scene.build_store import Progress
from plnerf.scene.memory import peak_resident_bytes
from plnerf.scene.scene import Scene
from plnerf.train.config import RunConfig, Settings
from plnerf.train.report import SilentReport
from plnerf.train.schedule import HeldOut

WINDOW_STEPS = 20
WARM_SHARE = 0.1  # of the steps, left out at the start


@dataclass(frozen=True)
class Validation:
    """Held-out PSNR during training."""

    step: int
    training_s: float
    wall_s: float
    psnr_db: float


@dataclass(frozen=True)
class TrainFigures:
    """What one training run took."""

    config: RunConfig
    training_images: int
    held_out_images: int
    begin_wall_s: float
    """From the call until the scene was read and the model built."""
    first_step_wall_s: float
    """From the call until the first step was done: kernels are compiled or loaded in it."""
    total_wall_s: float
    steps: int
    training_s: float
    window_s: tuple[float, ...]
    """Seconds of training of consecutive windows of `WINDOW_STEPS` steps, after the warm-up."""
    validations: tuple[Validation, ...]
    peak_bytes: int | None

    @property
    def steps_per_s(self) -> float:
        """Median over the windows."""
        return WINDOW_STEPS / statistics.median(self.window_s)

    @property
    def rays_per_s(self) -> float:
        """Median over the windows."""
        return self.steps_per_s * self.config.train.rays

    def reached(self, target_db: float) -> Validation | None:
        """The first validation at or above a PSNR."""
        return next((one for one in self.validations if one.psnr_db >= target_db), None)


class Stopwatch(SilentReport):
    """Listens to a run and notes when what happened."""

    def __init__(self, progress: Progress | None = None) -> None:
        super().__init__()
        self.called = time.perf_counter()
        self.config: RunConfig | None = None
        self.images = (0, 0)
        self.begin_wall_s = self.first_step_wall_s = 0.0
        self.seconds: list[float] = []
        self.validations: list[Validation] = []
        self._progress = progress

    def begin(self, config: RunConfig, scene: Scene, step: int) -> None:
        """Notes what is trained, and when it began."""
        self.config, self.images = config, (len(scene.train), len(scene.test))
        self.begin_wall_s = self._since()

    def step(self, step: int, seconds: float, progress: float, terms: Mapping[str, Tensor]) -> None:
        """Notes the seconds of training so far."""
        super().step(step, seconds, progress, terms)
        if self.steps == 1:
            self.first_step_wall_s = self._since()
        self.seconds.append(seconds)
        if self._progress is not None and (self.steps % WINDOW_STEPS == 0 or progress >= 1):
            self._progress(round(1000 * progress), 1000)

    def validation(self, step: int, seconds: float, seen: HeldOut) -> None:
        """Notes the held-out PSNR."""
        super().validation(step, seconds, seen)
        self.validations.append(Validation(step, seconds, self._since(), seen.psnr_db))

    def figures(self) -> TrainFigures:
        """All of it.  Raises ConfigError where the run was too short for one window after the warm-up."""
        if self.config is None or not (windows := windows_of(self.seconds)):
            raise ConfigError(
                f"The run ended after {self.steps} steps, too few for a rate: at least "
                f"{2 * WINDOW_STEPS} are needed. Give more --seconds."
            )
        return TrainFigures(
            config=self.config,
            training_images=self.images[0],
            held_out_images=self.images[1],
            begin_wall_s=self.begin_wall_s,
            first_step_wall_s=self.first_step_wall_s,
            total_wall_s=self._since(),
            steps=self.steps,
            training_s=self.seconds[-1],
            window_s=windows,
            validations=tuple(self.validations),
            peak_bytes=peak_resident_bytes(),
        )

    def _since(self) -> float:
        return time.perf_counter() - self.called


def windows_of(seconds: list[float]) -> tuple[float, ...]:
    """Seconds of each whole window after the warm-up, from the seconds of training after every step."""
    warm = max(WINDOW_STEPS, round(WARM_SHARE * len(seconds)))
    marks = seconds[warm - 1 :: WINDOW_STEPS]
    return tuple(b - a for a, b in pairwise(marks))


def measure_training(bench: BenchConfig, out: Path, console: Console) -> TrainFigures:
    """Trains the scene of a bench into a new run folder with the real loop."""
    seconds = min(bench.seconds, 6.0) if bench.quick else bench.seconds
    # A validation every second of a minute's run: how finely the times to a PSNR are known.
    settings, validations = settings_of(bench), max(4, min(60, round(seconds)))
    with bar(console, "train") as progress:
        report = Stopwatch(progress)
        train_scene(
            scene_of(bench), out, preset=bench.preset, model=settings.model,
            train=replace(settings.train, validations=validations), detect=settings.detect, seconds=seconds,
            downscale=bench.downscale, seed=bench.seed, device=bench.device, backend=bench.backend,
            report=report,
        )  # fmt: skip
    return report.figures()


def scene_of(bench: BenchConfig) -> Path:
    """The scene of a bench."""
    return bench.scene or bundled_span()


def settings_of(bench: BenchConfig, preset: str | None = None) -> Settings:
    """Settings that a bench trains a preset with; None: its own preset."""
    name = preset or bench.preset
    if name in bench.systems:
        return bench.systems[name]
    chosen = find_preset(name)
    return Settings(chosen.model, chosen.train)


def train_tables(figures: TrainFigures, targets_db: tuple[float, ...]) -> tuple[Table, ...]:
    """Rates, memory and waiting; then the way to the targets."""
    config, gib = figures.config, (figures.peak_bytes or 0) / 2**30
    last = figures.validations[-1].psnr_db if figures.validations else None
    rows = (
        ("steps per second, median of windows", figure(figures.steps_per_s)),
        ("rays per second, median of windows", figure(figures.rays_per_s)),
        ("steps", f"{figures.steps:,}"),
        ("seconds of training", figure(figures.training_s)),
        ("held-out PSNR at the end, dB", figure(last, 4)),
        ("first step done after, s of wall clock", figure(figures.first_step_wall_s)),
        ("of these, reading the scene and building the model", figure(figures.begin_wall_s)),
        ("peak resident memory, GiB", figure(gib) if figures.peak_bytes else "–"),
    )
    notes = (
        f"{config.scene}, {figures.training_images} training and {figures.held_out_images} held-out images, "
        f"downscale {config.downscale}, preset {config.preset}, {config.train.rays} rays a step, backend "
        f"{config.backend} on {config.device}, seed {config.seed}, budget {config.seconds:.0f} s.",
        f"Windows of {WINDOW_STEPS} steps after a warm-up. Seconds of training leave out the first step, "
        "validation and saving. The time to the first step leaves out the interpreter's start and imports.",
        f"Memory: {MEMORY_MEANING}.",
    )
    reached = []
    for target in targets_db:
        one = figures.reached(target)
        cells = [figure(one.training_s), figure(one.wall_s), f"{one.step:,}"] if one else ["not reached"] * 3
        reached.append((f"{target:g} dB", *cells))
    spacing = (
        "The first validation at or above the PSNR, over 4,096 fixed random held-out pixels; learning rates "
        "decay over the budget, so that another budget takes another way."
    )
    columns = ("held-out PSNR", "s of training", "s of wall clock", "step")
    return (
        Table("Training", ("what", "measured"), rows, notes),
        Table("Time to a held-out PSNR", columns, tuple(reached), (spacing,)),
    )


def train_json(figures: TrainFigures, targets_db: tuple[float, ...]) -> dict[str, Any]:
    """Everything measured, as JSON values."""
    times = [
        {"target_db": target, "validation": asdict(one) if (one := figures.reached(target)) else None}
        for target in targets_db
    ]
    return {
        **asdict(figures),
        "window_steps": WINDOW_STEPS,
        "steps_per_s": figures.steps_per_s,
        "rays_per_s": figures.rays_per_s,
        "time_to": times,
        "memory_meaning": MEMORY_MEANING,
    }
