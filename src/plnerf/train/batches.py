"""Work done ahead of the training loop by a thread: the pixel batches of the coming steps.

What is drawn for a step is a function of the run's seed and the step alone, so that it does not matter when
and by whom it is drawn.
"""

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import fields, replace
from typing import Generic, TypeVar

import torch

from plnerf.train.pixels import PixelBatch

T = TypeVar("T")


class Ahead(Generic[T]):
    """The values of a function of the step, from a first step on, made by a thread before they are asked for.

    At most `ahead` of them are made and waiting; with 0 each is made when it is asked for, without a thread.
    What the function raises is raised by `next` for its step.  Close it, or use it as a context manager.
    """

    def __init__(self, draw: Callable[[int], T], first: int, ahead: int = 2) -> None:
        self._draw, self._step = draw, first
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="plnerf-batches")
        self._coming: deque[Future[T]] = deque()
        for _ in range(ahead):
            self._submit()

    def __next__(self) -> T:
        """The value of the next step."""
        if not self._coming:
            self._step += 1
            return self._draw(self._step - 1)
        value = self._coming.popleft().result()
        self._submit()
        return value

    def close(self) -> None:
        """Drops what is not begun and waits for what is."""
        self._pool.shutdown(cancel_futures=True)

    def __enter__(self) -> "Ahead[T]":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _submit(self) -> None:
        self._coming.append(self._pool.submit(self._draw, self._step))
        self._step += 1


def pinned(batch: PixelBatch) -> PixelBatch:
    """The batch in page-locked memory, from which a GPU copies while the program goes on."""
    return replace(batch, **{field.name: getattr(batch, field.name).pin_memory() for field in fields(batch)})


def to_device(batch: PixelBatch, device: torch.device) -> PixelBatch:
    """The batch on a device; from page-locked memory without waiting for the copy."""
    moved = {field.name: getattr(batch, field.name).to(device, non_blocking=True) for field in fields(batch)}
    return replace(batch, **moved)
