"""Progress as plain lines, one every ten seconds, where a bar cannot be drawn: in a log, a pipe, a job."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType

EVERY_S = 10.0


@dataclass(frozen=True)
class _Shown:
    """The newest state of a stage."""

    stage: str
    share: float | None
    """Part of the stage that is done; None: not known."""
    text: str
    begun_s: float
    first: float
    """The first share that was reported: a stage may go on where an earlier process ended."""


class ProgressLines:
    """Writes a line about the current stage every few seconds, from a thread, so that long steps show too."""

    def __init__(
        self,
        write: Callable[[str], None],
        every_s: float = EVERY_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._write, self._every_s, self._clock = write, every_s, clock
        self._shown: _Shown | None = None
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    def show(self, stage: str, share: float | None, text: str = "") -> None:
        """Notes how far a stage is; the line that comes next has it."""
        before = self._shown
        if before is None or before.stage != stage:
            before = _Shown(stage, share, text, self._clock(), share or 0.0)
        self._shown = _Shown(stage, share, text, before.begun_s, before.first)

    def count(self, stage: str, done: int, total: int) -> None:
        """The same of a stage that counts; a total of 0 is not known."""
        spent = self._clock() - (self._shown.begun_s if self._shown and self._shown.stage == stage else 0.0)
        known = self._shown is not None and self._shown.stage == stage and done and spent > 0
        rate = f", {done / spent:.2g} a second" if known else ""
        self.show(stage, done / total if total else None, f"{done} of {total}{rate}" if total else "")

    def line(self) -> str:
        """The current stage: its share done, what it reports, seconds since its beginning and left."""
        shown = self._shown
        if shown is None:
            return ""
        spent = self._clock() - shown.begun_s
        parts = [] if shown.share is None else [f"{shown.share:.0%}"]
        parts += [shown.text] if shown.text else []
        parts.append(f"{spent:.0f} s")
        if shown.share is not None and shown.share - shown.first > 0 and shown.share < 1:
            parts.append(f"about {spent * (1 - shown.share) / (shown.share - shown.first):.0f} s left")
        return f"{shown.stage}: {', '.join(parts)}"

    def start(self) -> None:
        """Begins to write lines."""
        self._thread = threading.Thread(target=self._run, name="progress", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Writes no more lines; may be called again."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def __enter__(self) -> "ProgressLines":
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        self.stop()

    def _run(self) -> None:
        while not self._ended.wait(self._every_s):
            if text := self.line():
                try:
                    self._write(text)
                except OSError:  # nobody reads any more, or the disk is full: the work goes on
                    return
