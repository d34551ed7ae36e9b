"""Who hears of a run while it trains: nobody, or a log in the run folder."""

import json
import math
import time
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from torch import Tensor

from plnerf.errors import PlnerfError
from plnerf.render.picture_files import write_text
from plnerf.scene.memory import require_room_for_threads
from plnerf.scene.scene import Scene
from plnerf.scene.strict_json import parse_json
from plnerf.train.config import RunConfig
from plnerf.train.schedule import HeldOut

LOG_EVERY = 20  # steps between two lines of the log


@runtime_checkable
class Report(Protocol):
    """Who listens to a run.  `steps` counts the steps reported; `close` follows `begin`, come what may."""

    steps: int

    def nothing_left(self, config: RunConfig, step: int, seconds: float) -> None: ...
    def begin(self, config: RunConfig, scene: Scene, step: int) -> None: ...
    def step(self, step: int, seconds: float, progress: float, terms: Mapping[str, Tensor]) -> None: ...
    def validation(self, step: int, seconds: float, seen: HeldOut) -> None: ...
    def end(self, step: int, seconds: float) -> None: ...
    def close(self) -> None: ...


class SilentReport:
    """Keeps the held-out PSNR and writes nothing."""

    def __init__(self) -> None:
        self.steps = 0
        self.held_out_db: list[float] = []

    def nothing_left(self, config: RunConfig, step: int, seconds: float) -> None:
        """Does nothing."""

    def begin(self, config: RunConfig, scene: Scene, step: int) -> None:
        """Does nothing."""

    def step(self, step: int, seconds: float, progress: float, terms: Mapping[str, Tensor]) -> None:
        """Counts."""
        self.steps += 1

    def validation(self, step: int, seconds: float, seen: HeldOut) -> None:
        """Keeps the value."""
        self.held_out_db.append(seen.psnr_db)

    def end(self, step: int, seconds: float) -> None:
        """Does nothing."""

    def close(self) -> None:
        """Does nothing."""


class RunLog(SilentReport):
    """Writes metrics.jsonl and TensorBoard events into a run folder."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self._folder = folder
        self._mark = (0, 0.0)
        self.first_step_s = 0.0
        """Seconds from the beginning to the end of the first step: kernels are compiled or loaded in it."""
        self.latest: dict[str, float] = {}
        """Values of the newest line of the log: rays_per_s, loss, train_psnr_db and the loss terms."""

    def begin(self, config: RunConfig, scene: Scene, step: int) -> None:
        """Opens the logs; drops lines that a run cut off after its last checkpoint left behind."""
        from torch.utils.tensorboard import SummaryWriter  # takes a second to import

        require_room_for_threads()  # one writes the events
        log = self._folder / "metrics.jsonl"
        kept = [line for line in read_log(log) if line["step"] <= step]
        write_text(log, "".join(json.dumps(line) + "\n" for line in kept))
        self._log = log.open("a")
        self._events = SummaryWriter(str(self._folder), purge_step=step + 1)
        self._rays, self._begin = config.train.rays, time.perf_counter()

    def step(self, step: int, seconds: float, progress: float, terms: Mapping[str, Tensor]) -> None:
        """Logs every few steps: until then, nothing is read from the device."""
        super().step(step, seconds, progress, terms)
        if self.steps == 1:
            self.first_step_s = time.perf_counter() - self._begin
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
        self.latest = {"rays_per_s": rate, "loss": loss, "train_psnr_db": train_db, **values}
        self._write(step, seconds, self.latest)

    def validation(self, step: int, seconds: float, seen: HeldOut) -> None:
        """Logs the PSNR over fixed random held-out pixels, and over those near wires."""
        super().validation(step, seconds, seen)
        near = {} if seen.wire_psnr_db is None else {"held_out_wire_psnr_db": seen.wire_psnr_db}
        self._write(step, seconds, {"held_out_psnr_db": seen.psnr_db, **near})

    def close(self) -> None:
        """Closes the logs."""
        self._log.close()
        self._events.close()

    def _write(self, step: int, seconds: float, values: Mapping[str, float]) -> None:
        self._log.write(json.dumps({"step": step, "seconds": round(seconds, 3), **values}) + "\n")
        self._log.flush()
        for name, value in values.items():
            self._events.add_scalar(name, value, step)


def read_log(path: Path) -> list[dict[str, Any]]:
    """The lines of a metrics.jsonl, each an object with a step; none where there is no log.

    What cannot be read is left out: nothing depends on a log, and a line that was lost on a full disk must
    not keep a run from going on.  A warning says how many lines these are.
    """
    data = path.read_bytes() if path.exists() else b""
    lines = data[: data.rfind(b"\n") + 1].splitlines()  # without the one that was being written
    found = []
    for number, line in enumerate(lines, start=1):
        try:
            content = parse_json(line, f"{path}, line {number}", PlnerfError)
        except PlnerfError:
            continue
        if isinstance(content, dict) and type(content.get("step")) is int:
            found.append(content)
    if len(found) < len(lines):
        lost = len(lines) - len(found)
        warnings.warn(f"{path}: {lost} of its lines cannot be read and are left out.", stacklevel=2)
    return found
