"""Terminal output of the command line and the benches: progress bars, plain lines, training logs."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from torch import Tensor

from plnerf.progress_lines import ProgressLines
from plnerf.scene.memory import require_room_for_threads
from plnerf.scene.scene import Scene
from plnerf.train.config import RunConfig
from plnerf.train.report import RunLog
from plnerf.train.schedule import HeldOut, progress_of


def say(console: Console, text: str) -> None:
    """Prints text as it is: a path may hold what looks like markup."""
    console.print(text, markup=False, highlight=False, emoji=False, soft_wrap=True)


@contextmanager
def bars(console: Console) -> Iterator[Callable[[str, int, int], None]]:
    """A progress bar for each stage that reports (its name, done, total); a total of 0 is not known.

    Where the console is no terminal, a plain line every ten seconds in their place.
    """
    require_room_for_threads()  # one draws the bars, or writes the lines
    if not console.is_terminal:
        with ProgressLines(partial(say, console)) as lines:
            yield lines.count
        return
    columns = (
        TextColumn("[bold]{task.description}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TimeRemainingColumn(compact=True),
    )
    with Progress(*columns, console=console) as progress:
        tasks: dict[str, TaskID] = {}

        def report(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = progress.add_task(stage, total=total or None)
            progress.update(tasks[stage], completed=done, total=total or None)

        yield report


@contextmanager
def bar(console: Console, title: str) -> Iterator[Callable[[int, int], None]]:
    """A progress bar of one stage, which reports (done, total)."""
    with bars(console) as report:
        report(title, 0, 0)
        yield lambda done, total: report(title, done, total)


class RunConsole(RunLog):
    """Logs a run into its folder, and shows its progress on a console."""

    def __init__(self, folder: Path, console: Console) -> None:
        super().__init__(folder)
        self._console, self._held_out = console, ""
        self._bar = Progress(
            TextColumn("[bold]train"),
            BarColumn(bar_width=24),
            TaskProgressColumn(),
            TextColumn("{task.fields[rate]}  {task.fields[loss]}  {task.fields[psnr]}"),
            TimeRemainingColumn(compact=True),
            console=console,
        )
        self._task = self._bar.add_task("train", total=1.0, rate="compiling", loss="", psnr="")
        self._lines = None if console.is_terminal else ProgressLines(partial(say, console))

    def nothing_left(self, config: RunConfig, step: int, seconds: float) -> None:
        """Prints that a run had already used up its budget."""
        if progress_of(config, step, seconds) < 1:
            self._console.print(f"Nothing left to train: the run had settled after {step} steps.")
            return
        used = (
            f"{step} of {config.steps} steps" if config.steps else f"{seconds:.0f} of {config.seconds:.0f} s"
        )
        self._console.print(f"Nothing left to train: {used} are done. Give a larger budget to go on.")

    def begin(self, config: RunConfig, scene: Scene, step: int) -> None:
        """Opens the logs and prints what is trained, and on what."""
        super().begin(config, scene, step)
        width, height = scene.cameras.size_px[0].tolist()
        self._console.print(
            f"{len(scene.train)} training and {len(scene.test)} held-out images of {width}x{height}, "
            f"backend {config.backend} on {config.device}, seed {config.seed}"
            + (f", resumed at step {step}" if step else "")
        )
        if self._lines is None:
            self._bar.start()
        else:
            self._lines.show("train", 0.0 if config.steps is None else step / config.steps, "compiling")
            self._lines.start()

    def step(self, step: int, seconds: float, progress: float, terms: Mapping[str, Tensor]) -> None:
        """Moves the bar whenever the log has a new line."""
        before = self.latest
        super().step(step, seconds, progress, terms)
        if self.steps == 1:
            waited = self.first_step_s
            self._console.print(f"first step after {waited:.1f} s (kernels compiled or loaded)")
        if (latest := self.latest) is not before:
            rate, loss = f"{latest['rays_per_s']:,.0f} rays/s", f"loss {latest['loss']:.4f}"
            psnr = f"PSNR {latest['train_psnr_db']:.1f} dB{self._held_out}"
            self._bar.update(self._task, completed=progress, rate=rate, loss=loss, psnr=psnr)
            if self._lines is not None:
                self._lines.show("train", progress, f"{rate}, {loss}, {psnr}")

    def validation(self, step: int, seconds: float, seen: HeldOut) -> None:
        """Logs the held-out PSNR, which the bar shows from then on."""
        super().validation(step, seconds, seen)
        near = "" if seen.wire_psnr_db is None else f", near wires {seen.wire_psnr_db:.2f}"
        self._held_out = f", held out {seen.psnr_db:.2f} dB{near}"

    def end(self, step: int, seconds: float) -> None:
        """Prints what was reached."""
        self._bar.update(self._task, completed=1.0)
        self._stop()
        self._console.print(f"{step} steps in {seconds:.0f} s of training{self._held_out}")

    def close(self) -> None:
        """Closes the logs and the bar, which hides the terminal's cursor while it is there."""
        self._stop()
        super().close()

    def _stop(self) -> None:
        self._bar.stop()
        if self._lines is not None:
            self._lines.stop()
