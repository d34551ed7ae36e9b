"""Compiled kernels are found again by a later process.

Numba's cache on disk knows a function by its file, its line, its arguments' types and what its closure holds.
A compiled function held there differs from process to process: the kernel would never be found again, each
process would wait for the compiler and leave one more file.
"""

import gc
import inspect
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba.core.caching import FunctionCache
from numba.core.dispatcher import Dispatcher

import plnerf.ops

PLAIN = (bool, int, float, np.generic)
"""What is pickled to the same bytes by every process."""
FILES = sorted(Path(plnerf.ops.__path__[0]).glob("cpu_*.py"))


def makers(file: Path) -> list[Callable[..., Any]]:
    """The functions of a module that make kernels when they are called."""
    module = import_module(f"plnerf.ops.{file.stem}")
    cached = [value for value in vars(module).values() if hasattr(value, "cache_info")]
    own = [value for value in cached if value.__module__ == module.__name__]
    return [value for value in own if "@njit" in inspect.getsource(value)]


def kernels() -> dict[str, Dispatcher]:
    """All that Numba compiles in plnerf.ops, its makers of kernels called once."""
    kept = [
        maker(*(2 for _ in inspect.signature(maker).parameters)) for file in FILES for maker in makers(file)
    ]
    found = [obj for obj in gc.get_objects() if isinstance(obj, Dispatcher)]
    assert kept
    names = {f"{d.py_func.__module__}.{d.py_func.__qualname__}": d for d in found}
    return {name: d for name, d in names.items() if name.startswith("plnerf.ops.")}


KERNELS = kernels()


@pytest.mark.parametrize("name", sorted(KERNELS))
def test_closures_hold_plain_values(name: str) -> None:
    for cell in KERNELS[name].py_func.__closure__ or ():
        assert isinstance(cell.cell_contents, PLAIN), f"{name} holds {cell.cell_contents!r}"


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_no_kernel_was_overlooked(file: Path) -> None:
    """Those made inside of functions too: each `njit` in the file is one that the tests here have seen."""
    decorated = sum(
        line.strip().startswith("@njit") for line in file.read_text(encoding="utf-8").splitlines()
    )
    assert sum(d.py_func.__code__.co_filename == str(file) for d in KERNELS.values()) >= decorated


def test_kernels_are_kept_on_disk_and_run_without_pythons_lock() -> None:
    kept = {name: d for name, d in KERNELS.items() if not d.targetoptions.get("forceinline")}
    assert len(kept) >= 40
    for name, dispatcher in kept.items():
        if dispatcher.targetoptions.get("cache"):
            assert isinstance(dispatcher._cache, FunctionCache), name
        assert dispatcher.targetoptions["nogil"] and not dispatcher.targetoptions.get("parallel"), name
