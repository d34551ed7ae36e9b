"""How far a training has come, for the curves of those who watch it; and its turns."""

import threading
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from plnerf.train.config import RunConfig
from plnerf.train.report import RunLog
from plnerf.view.turns import Turns

MOST_PLACES = 400
"""Of a curve as it is sent; more are thinned evenly, the newest stays."""


@dataclass(eq=False)
class TrainingProgress:
    """Filled by the thread that trains, read by others."""

    config: RunConfig
    log: RunLog
    turns: Turns = field(default_factory=Turns)
    step: int = 0
    _places: list[tuple[float, float, float]] = field(default_factory=list)
    _validations: list[tuple[float, float]] = field(default_factory=list)
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _seen: dict[str, float] | None = None

    def note(self, step: int) -> bool:
        """Keeps the newest line of the log; whether there was a new one."""
        self.step = step
        if len(self.log.held_out_db) > len(self._validations):  # of the step before
            with self._lock:
                self._validations.append((step - 1, self.log.held_out_db[-1]))
        if not self.log.latest or self.log.latest is self._seen:
            return False
        self._seen = latest = self.log.latest
        with self._lock:
            self._places.append((step, latest["loss"], latest["train_psnr_db"]))
        return True

    def curves(self) -> Float[np.ndarray, "3 p"]:
        """Steps, loss, and PSNR of the pixels that were trained on, in dB."""
        with self._lock:
            rows = np.array(self._places, np.float64).reshape(-1, 3)
        every = max(1, -(-len(rows) // MOST_PLACES))
        return np.ascontiguousarray(rows[::-1][::every][::-1].T)

    def held_out(self) -> Float[np.ndarray, "2 v"]:
        """Steps of the validations, and PSNR of held-out pixels, in dB."""
        with self._lock:
            return np.array(self._validations, np.float64).reshape(-1, 2).T.copy()

    def text(self) -> str:
        """Step, budget and the newest values, as markdown."""
        budget = f" of {self.config.steps:,}" if self.config.steps else f", {self.config.seconds:g} s in all"
        parts = [f"step {self.step:,}{budget}"]
        if self._places:
            _, loss, psnr = self._places[-1]
            parts.append(f"loss {loss:.4f}, PSNR {psnr:.1f} dB")
        if self._validations:
            parts.append(f"held-out images {self._validations[-1][1]:.2f} dB")
        if self.turns.stopped or self.turns.paused:
            parts.append("**Stopping.**" if self.turns.stopped else "**Paused.**")
        return "  \n".join(parts)
