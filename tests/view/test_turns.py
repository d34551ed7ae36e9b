"""Turns: the thread that trains renders between its steps and while it waits, and never after."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from plnerf.errors import ConfigError
from plnerf.view.turns import Turns


@contextmanager
def training(turns: Turns, step_s: float = 0.001) -> Iterator[list[int]]:
    """A thread that takes steps until it is stopped; the number of steps so far."""
    steps = [0]

    def train() -> None:
        goes_on = True
        while goes_on:
            time.sleep(step_s)
            steps[0] += 1
            goes_on = turns.between_steps()
        turns.end()

    thread = threading.Thread(target=train, name="trains")
    thread.start()
    yield steps
    turns.stop()
    thread.join(5)
    assert not thread.is_alive()


def soon(done: Callable[[], Any]) -> None:
    end = time.monotonic() + 5
    while not done():
        assert time.monotonic() < end
        time.sleep(0.001)


def test_the_thread_that_trains_renders() -> None:
    turns = Turns()
    with training(turns):
        assert turns.take(lambda: threading.current_thread().name) == "trains"
        with pytest.raises(ZeroDivisionError):  # belongs to who asked
            turns.take(lambda: 1 // 0)
        assert turns.take(lambda: 7) == 7


def test_a_paused_training_takes_no_step_but_renders() -> None:
    turns = Turns()
    with training(turns) as steps:
        turns.pause(True)
        assert turns.take(lambda: True)
        before = steps[0]
        assert all(turns.take(lambda: True) for _ in range(20))
        assert turns.paused and steps[0] == before
        turns.pause(False)
        soon(lambda: steps[0] > before)


def test_it_can_be_stopped_while_it_is_paused() -> None:
    turns = Turns()
    with training(turns):
        turns.pause(True)
        turns.take(lambda: None)
        turns.stop()
        soon(lambda: turns._ended)
        with pytest.raises(ConfigError, match="The training has ended"):
            turns.take(lambda: None)


def test_pictures_leave_the_training_half_of_the_time() -> None:
    turns, rendered = Turns(), list[float]()

    def look() -> None:
        while True:
            try:
                turns.take(lambda: rendered.append(time.sleep(0.02) or 0.02))
            except ConfigError:
                return

    with training(turns) as steps:
        threading.Thread(target=look, daemon=True).start()
        before, began = steps[0], time.monotonic()
        time.sleep(0.6)
        passed = time.monotonic() - began
        assert len(rendered) >= 3 and sum(rendered) < 0.7 * passed
        assert steps[0] - before > len(rendered)
