"""Pictures of a field in training: rendered by the thread that trains, between two of its steps.

The weights change in each step, and the kernels of a CPU share one pool of threads, so nothing is rendered
beside a step.
"""

import threading
import time
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from typing import Any, TypeVar

from plnerf.errors import ConfigError

T = TypeVar("T")
SHARE = 0.5
"""Of the time, for pictures, as long as somebody waits for some."""


class Turns:
    """Functions of other threads that wait for their turn; and whether the training waits or ends."""

    def __init__(self) -> None:
        self._waiting: list[tuple[Callable[[], Any], Future[Any]]] = []
        self._changed = threading.Condition()
        self._ended, self._paused, self._stopped = False, False, False
        self._next_at = 0.0

    def take(self, function: Callable[[], T]) -> T:
        """Runs a function in the thread that trains, and returns what it returns or raises what it raises.

        To be called from any other thread.  Raises ConfigError once the training has ended.
        """
        future: Future[Any] = Future()
        with self._changed:
            if self._ended:
                future.cancel()
            else:
                self._waiting.append((function, future))
                self._changed.notify_all()
        try:
            result: T = future.result()
        except CancelledError:
            raise ConfigError("The training has ended. Show the run: plnerf view RUN.") from None
        return result

    @property
    def paused(self) -> bool:
        """Whether the training waits."""
        return self._paused

    @property
    def stopped(self) -> bool:
        """Whether the training was asked to end."""
        return self._stopped

    def pause(self, on: bool) -> None:
        """Lets the training wait after its step, or go on."""
        with self._changed:
            self._paused = on
            self._changed.notify_all()

    def stop(self) -> None:
        """Lets the training end after its step."""
        with self._changed:
            self._stopped = True
            self._changed.notify_all()

    def between_steps(self) -> bool:
        """Runs what waits, one function a step while it trains and all while it is paused; whether to go on.

        To be called by the thread that trains.
        """
        if self._waiting and time.monotonic() >= self._next_at:
            self._run_next()
        while self._paused and not self._stopped:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._stopped or not self._paused)
            self._run_next()
        return not self._stopped

    def end(self) -> None:
        """Nobody gets a turn any more."""
        with self._changed:
            self._ended = True
            for _, future in self._waiting:
                future.cancel()
            self._waiting.clear()

    def _run_next(self) -> None:
        with self._changed:
            if not self._waiting:
                return
            function, future = self._waiting.pop(0)
        began = time.monotonic()
        try:
            future.set_result(function())
        except Exception as error:  # belongs to who waits for it; the training goes on
            future.set_exception(error)
        ended = time.monotonic()
        self._next_at = ended + (ended - began) * (1 / SHARE - 1)
