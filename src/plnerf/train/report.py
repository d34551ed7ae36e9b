"""What a run tells while it trains: a progress bar, metrics.jsonl and TensorBoard events."""

import json
import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol, runtime_checkable

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from torch import Tensor

from plnerf.render.files import write_text
from plnerf.scene.scene import Scene
from plnerf.train.config import RunConfig

LOG_EVERY = 20  # steps between two lines of the log


@runtime_checkable
class Report(Protocol):
    """Who listens to a run.  `steps` counts the steps reported; `close` follows `begin`, come what may."""

    steps: int

    def nothing_left(self, config: RunConfig, step: int, seconds: float) -> None: ...
    def begin(self, config: RunConfig, scene: Scene, step: int) -> None: ...
    def step(self, step: int, seconds: float, progress: float, terms: Mapping[str, Tensor]) -> None: ...
    def validation(self, step: int, seconds: float, psnr_db: float) -> None: ...
    def end(self, step: int, seconds: float) -> None: ...
    def close(self) -> None: ...


class RunReport:
    """Writes metrics.jsonl and TensorBoard events into a run folder and shows a progress bar on a console."""

    def __init__(self, folder: Path, console: Console) -> None:
        self.steps = 0
        self._folder, self._console = folder, console
        self._bar = Progress(
            TextColumn("[bold]train"),
            BarColumn(bar_width=24),
            TaskProgressColumn(),
            TextColumn("{task.fields[rate]}  {task.fields[loss]}  {task.fields[psnr]}"),
            TimeRemainingColumn(compact=True),
            console=console,
        )
        self._task = self._bar.add_task("train", total=1.0, rate="compiling", loss="", psnr="")
        self._held_out = ""
        self._mark = (0, 0.0)

    def nothing_left(self, config: RunConfig, step: int, seconds: float) -> None:
        """Says that a run had already used up its budget."""
        used = (
            f"{step} of {config.steps} steps" if config.steps else f"{seconds:.0f} of {config.seconds:.0f} s"
        )
        self._console.print(f"Nothing left to train: {used} are done. Give a larger budget to go on.")

    def begin(self, config: RunConfig, scene: Scene, step: int) -> None:
        """Opens the logs; drops lines that a run cut off after its last checkpoint left behind."""
        from torch.utils.tensorboard import SummaryWriter  # takes a second to import

        log = self._folder / "metrics.jsonl"
        write_text(log, "".join(line for line in _lines(log) if json.loads(line)["step"] <= step))
        self._log = log.open("a")
        self._events = SummaryWriter(str(self._folder), purge_step=step + 1)
        self._rays, self._begin = config.train.rays, time.perf_counter()
        width, height = scene.cameras.size_px[0].tolist()
        self._console.print(
            f"{len(scene.train)} training and {len(scene.test)} held-out images of {width}x{height}, "
            f"backend {config.backend} on {config.device}, seed {config.seed}"
            + (f", resumed at step {step}" if step else "")
        )
        self._bar.start()

    def step(self, step: int, seconds: float, progress: float, terms: Mapping[str, Tensor]) -> None:
        """Logs every few steps: until then, nothing is read from the device."""
        self.steps += 1
        if self.steps == 1:
            waited = time.perf_counter() - self._begin
            self._console.print(f"first step after {waited:.1f} s (kernels compiled or loaded)")
            self._mark = (step, seconds)
        if step % LOG_EVERY and progress < 1:
            return
        values = {name: term.item() for name, term in terms.items()}
        steps, spent = step - self._mark[0], seconds - self._mark[1]
        rate = steps * self._rays / spent if spent else 0.0
        self._mark = (step, seconds)
        # Of the weighted colour term, whose weight is 1 unless someone changed it.
        train_db = -10 * math.log10(max(values["colour"], 1e-10))
        loss = sum(values.values())
        self._write(step, seconds, {"rays_per_s": rate, "loss": loss, "train_psnr_db": train_db, **values})
        self._bar.update(
            self._task,
            completed=progress,
            rate=f"{rate:,.0f} rays/s",
            loss=f"loss {loss:.4f}",
            psnr=f"PSNR {train_db:.1f} dB{self._held_out}",
        )

    def validation(self, step: int, seconds: float, psnr_db: float) -> None:
        """Logs the PSNR over fixed random held-out pixels."""
        self._held_out = f", held out {psnr_db:.2f} dB"
        self._write(step, seconds, {"held_out_psnr_db": psnr_db})

    def end(self, step: int, seconds: float) -> None:
        """Says what was reached."""
        self._bar.update(self._task, completed=1.0)
        self._bar.stop()
        self._console.print(f"{step} steps in {seconds:.0f} s of training{self._held_out}")

    def close(self) -> None:
        """Closes the logs and the bar, which hides the terminal's cursor while it is there."""
        self._bar.stop()
        self._log.close()
        self._events.close()

    def _write(self, step: int, seconds: float, values: Mapping[str, float]) -> None:
        self._log.write(json.dumps({"step": step, "seconds": round(seconds, 3), **values}) + "\n")
        self._log.flush()
        for name, value in values.items():
            self._events.add_scalar(name, value, step)


class SilentReport:
    """Keeps the held-out PSNR and writes nothing; for tests and for use from Python."""

    def __init__(self) -> None:
        self.steps = 0
        self.held_out_db: list[float] = []

    def nothing_left(self, config: RunConfig, step: int, seconds: float) -> None:
        """Nothing to say."""

    def begin(self, config: RunConfig, scene: Scene, step: int) -> None:
        """Nothing to open."""

    def step(self, step: int, seconds: float, progress: float, terms: Mapping[str, Tensor]) -> None:
        """Counts."""
        self.steps += 1

    def validation(self, step: int, seconds: float, psnr_db: float) -> None:
        """Keeps the value."""
        self.held_out_db.append(psnr_db)

    def end(self, step: int, seconds: float) -> None:
        """Nothing to say."""

    def close(self) -> None:
        """Nothing to close."""


def _lines(path: Path) -> list[str]:
    """Whole lines of a log; a last line that was cut off in writing is left out."""
    text = path.read_text() if path.exists() else ""
    return [line for line in text.splitlines(keepends=True) if line.endswith("\n")]
