"""Kernels on all threads: each thread computes a stretch of the work, without Python's lock.

Numba itself shares out a loop of a kernel that is compiled with `parallel=True`, but then compiles for three
times as long: what Python calls, what a thread runs, and what hands over from one to the other.  Here a
kernel takes a stretch [start, stop) of its rays, points, slabs or levels, is compiled once, and handing over
is done in Python: 30 us, where Numba's took 110 on a busy machine.
"""

import os
from collections.abc import Callable
from itertools import pairwise
from queue import SimpleQueue
from threading import Lock, Thread
from typing import Any

from plnerf.ops import cpu_arrays


class _Stretch:
    """A stretch of a kernel's work, which any thread may compute."""

    def __init__(self, kernel: Callable[..., Any], *arguments: Any) -> None:
        self._kernel, self._arguments = kernel, arguments
        self._error: BaseException | None = None
        self._computing = Lock()
        self._computing.acquire()

    def compute(self) -> None:
        try:
            self._kernel(*self._arguments)
        except BaseException as error:  # for the thread that waits
            self._error = error
        self._computing.release()

    def wait(self) -> None:
        """Until it is computed; raises what the kernel raised."""
        self._computing.acquire()
        if self._error is not None:
            raise self._error


class _Helpers:
    """Threads that compute stretches: started when they are first needed, they end with the process."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Begins anew, as a forked process must: it has none of its parent's threads."""
        self._waiting: SimpleQueue[_Stretch] = SimpleQueue()
        self._threads, self._starting = 0, Lock()

    def compute(self, stretches: list[_Stretch]) -> None:
        with self._starting:
            while self._threads < len(stretches):
                Thread(target=self._help, name="kernels", daemon=True).start()
                self._threads += 1
        for stretch in stretches:
            self._waiting.put(stretch)

    def _help(self) -> None:
        while True:
            self._waiting.get().compute()


_HELPERS = _Helpers()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_HELPERS.forget)


def share(kernel: Callable[..., Any], *arguments: Any, of: int, threads: int | None = None) -> None:
    """Calls kernel(*arguments, start, stop) for stretches that make up range(of), one on each thread.

    threads: how many, the caller's among them; None: as many as Numba may use.
    """
    count = max(1, min(of, cpu_arrays.num_threads() if threads is None else threads))
    edges = [of * k // count for k in range(count + 1)]
    others = [_Stretch(kernel, *arguments, *edge) for edge in pairwise(edges[1:])]
    _HELPERS.compute(others)
    try:
        kernel(*arguments, 0, edges[1])
    finally:
        for stretch in others:
            stretch.wait()
