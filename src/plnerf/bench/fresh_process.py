"""A function called in a new process, which ends with the one that began it."""

import multiprocessing
import os
import sys
import threading
import warnings
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.process import BaseProcess
from typing import TypeVar

from plnerf.errors import PlnerfError

T = TypeVar("T")
U = TypeVar("U")


def in_fresh_process(function: Callable[[T], U], task: T) -> U:
    """Calls a function in a new Python process; its errors are raised here.  Interrupted, it ends that one.

    Raises PlnerfError where the process is ended from outside.
    """
    spawn, others = multiprocessing.get_context("spawn"), multiprocessing.active_children()
    try:
        with ProcessPoolExecutor(1, mp_context=spawn, initializer=_begin) as pool:
            try:
                return pool.submit(function, task).result()
            except KeyboardInterrupt:  # the pool would wait until the work is done
                for child in set(multiprocessing.active_children()) - set(others):
                    child.kill()
                raise
    except BrokenProcessPool as error:
        raise PlnerfError(
            f"The process of {function.__name__.strip('_')!r} ended without a result: "
            "the system may have been short of memory. Close other programs, or choose a larger --downscale."
        ) from error


def _begin() -> None:
    """Has a process end with the one that began it, even where that is killed, and say its warnings as the
    command line does, each once."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_after, args=(parent,), daemon=True).start()
    warnings.simplefilter("once", UserWarning)
    warnings.showwarning = lambda message, *_, **__: print(f"note: {message}", file=sys.stderr)


def _end_after(parent: BaseProcess) -> None:
    parent.join()
    os._exit(1)  # nobody is left to hear of an error
