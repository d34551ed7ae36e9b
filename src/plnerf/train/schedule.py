"""How far a run has come: when its learning rates fall, when held-out pixels are looked at, when it ends.

Learning rates wait and then fall, which is known as warmup-stable-decay (Hu et al. 2024, MiniCPM, section 4).
A budget known beforehand says when.  Until a run is settled nobody knows how long it takes: it waits while
held-out pixels gain, and then goes on for half as many steps as were taken so far.
"""

import math
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from plnerf.errors import CheckpointError
from plnerf.train.config import RunConfig


@dataclass(frozen=True)
class Moment:
    """Where a run is after some step."""

    progress: float
    """In [0, 1]: decides the learning rates; at 1 the run is done."""
    share: float
    """Part of the run that is over, in [0, 1]; 0 as long as nobody knows."""
    look: bool
    """Whether held-out pixels are looked at now."""
    save: bool
    """Whether a checkpoint is written now."""


@dataclass(frozen=True)
class HeldOut:
    """What fixed held-out pixels show of a model."""

    psnr_db: float
    """NaN where masks ignore all of them."""
    wire_psnr_db: float | None = None
    """Of those near detected wires; None without wires, NaN where none of them is to be seen."""


Look = tuple[float | None, float | None]
"""The PSNR of all held-out pixels and of those near wires; None where there is none."""


@runtime_checkable
class Schedule(Protocol):
    """What decides how long a run goes on."""

    def at(self, step: int, seconds: float) -> Moment:
        """After so many steps and seconds of training; steps are asked for in order."""

    def heard(self, step: int, seen: HeldOut) -> None:
        """Told what was asked for by `Moment.look`."""

    def state(self) -> dict[str, Any] | None:
        """What a checkpoint must keep of it, as JSON."""


def schedule_of(config: RunConfig, step: int, seconds: float, state: dict[str, Any] | None) -> Schedule:
    """The schedule of a run, after so many steps, with what its checkpoint kept."""
    if config.until == "settled":
        return UntilSettled(config, state)
    return UntilSpent(config, progress_of(config, step, seconds))


class UntilSpent:
    """Progress is the used part of the budget."""

    def __init__(self, config: RunConfig, progress: float) -> None:
        self._config, self._before = config, progress

    def at(self, step: int, seconds: float) -> Moment:
        """Looks and saves as often as the settings say, evenly over the budget."""
        cfg, before = self._config.train, self._before
        self._before = now = progress_of(self._config, step, seconds)
        return Moment(now, now, due(before, now, cfg.validations), due(before, now, cfg.checkpoints))

    def heard(self, step: int, seen: HeldOut) -> None:
        """Nothing depends on it."""

    def state(self) -> None:
        """Nothing is to be kept."""


class UntilSettled:
    """Progress waits while held-out pixels gain; the budget says when waiting must end at the latest."""

    def __init__(self, config: RunConfig, state: dict[str, Any] | None) -> None:
        self._config, self._cfg = config, config.train.settle
        self._looks: list[Look] = []
        self._settled_at: int | None = None
        self._forced = False
        if state is not None:
            self._looks, self._settled_at, self._forced = _read(state)

    def at(self, step: int, seconds: float) -> Moment:
        """Looks and saves after the first steps, then whenever a run is longer by the factor `growth`."""
        used = progress_of(self._config, step, seconds)
        if self._forced and used < self._cfg.hold:  # resumed with a larger budget
            self._settled_at, self._forced = None, False
        if self._settled_at is None and used >= self._cfg.hold:
            self._settled_at, self._forced = step, True
        mark = self._is_mark(step)
        waiting = self._cfg.hold * min(1.0, (self._settled_at or step) / self._cfg.first)
        if self._settled_at is None:
            return Moment(waiting, 0.0, mark, mark)
        rest = max(1, round((1 / self._cfg.hold - 1) * self._settled_at))
        gone = 1.0 if used >= 1 else min(1.0, (step - self._settled_at) / rest)
        share = max(used, step / (self._settled_at + rest))
        done = gone >= 1
        progress = 1.0 if done else waiting + (1 - waiting) * gone
        return Moment(progress, min(1.0, share), mark or done, mark or done)

    def heard(self, step: int, seen: HeldOut) -> None:
        """Settled where neither the last look nor the one before it gained on all that were earlier.

        Where there is nothing to look at, only the budget ends the run.
        """
        whole, near = (_finite(value) for value in (seen.psnr_db, seen.wire_psnr_db))
        self._looks.append((whole, near))
        kinds = [[value for value in kind if value is not None] for kind in zip(*self._looks, strict=True)]
        gains = [max(of[-2:]) - max(of[:-2]) for of in kinds if len(of) >= 3]
        if self._settled_at is None and gains and max(gains) < self._cfg.gain_db:
            self._settled_at = step

    def state(self) -> dict[str, Any]:
        """The looks, and when it settled."""
        looks = [list(one) for one in self._looks]
        return {"looks": looks, "settled_at": self._settled_at, "forced": self._forced}

    def _is_mark(self, step: int) -> bool:
        mark = self._cfg.first
        while mark < step:
            mark = math.ceil(mark * self._cfg.growth)
        return mark == step


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def _read(state: dict[str, Any]) -> tuple[list[Look], int | None, bool]:
    """What `UntilSettled.state` wrote.  Raises CheckpointError where it is something else."""
    try:
        looks = [(_finite(whole), _finite(near)) for whole, near in state["looks"]]
        settled_at = state["settled_at"]
        if settled_at is not None and (type(settled_at) is not int or settled_at < 0):
            raise ValueError(f"settled_at is {settled_at!r}")
        return looks, settled_at, bool(state["forced"])
    except (KeyError, TypeError, ValueError) as error:
        raise CheckpointError(
            f"The newest checkpoint does not say how far the run had settled ({error!r}): its schedule is "
            f"{state!r}. Remove this checkpoint to go on from the one before."
        ) from error


def progress_of(config: RunConfig, step: int, seconds: float) -> float:
    """Part of the budget that is used up, in [0, 1]."""
    used = step / config.steps if config.steps else seconds / (config.seconds or 1.0)
    return min(1.0, used)


def due(before: float, after: float, times: int) -> bool:
    """Whether progress passed one of `times` evenly spaced marks, the last of them at 1."""
    return int(after * times + 1e-9) > int(before * times + 1e-9)
