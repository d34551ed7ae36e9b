"""Numba's `njit` for kernels, and where compiled kernels are kept: by a hash of their source.

Numba's own cache knows a kernel by the file that defines it.  A kernel calls others of other files, which are
compiled into it: after an edit there, the old machine code would still run.  Here the hash covers every file
of `ops/` and every other file of the package that defines a kernel, so that an edit to any of them compiles
all anew; every kernel takes `njit` from here.  The places are Numba's, in its order: NUMBA_CACHE_DIR,
`__pycache__` beside the file, the user's cache folder; the next is taken where one is not writable.  After
them, as for a container's user without a home, comes a folder among the temporary files; where that is not
writable either, every process compiles for itself.  A warning reports both.
"""

import gc
import hashlib
import inspect
import os
import shutil
import stat
import tempfile
import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import caching, event

__all__ = ["INNER", "inlined", "njit"]

PACKAGE = Path(__file__).resolve().parent.parent
PREFIX = "kernels-"
INNER: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of a function that only kernels call: what Python would call is not compiled."""
_MADE: list[Any] = []
"""Every kernel that is to be kept."""
KEPT_S = 14 * 24 * 3600.0
"""Kernels of other sources are removed after two weeks, when those of new ones are first kept."""


@cache
def kernel_hash() -> str:
    """Hash of the source of all kernels and of what `ops/` gives them."""
    digest = hashlib.sha256()
    for path in kernel_files(PACKAGE):
        digest.update(path.relative_to(PACKAGE).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def kernel_files(package: Path) -> list[Path]:
    """The files whose source decides what is compiled, in a fixed order."""
    everything = sorted(package.rglob("*.py"))
    return [path for path in everything if path.parent == package / "ops" or b"njit" in path.read_bytes()]


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Numba's `njit`, always with options; what it compiles is not kept where no place for it is writable.

    A kernel runs without Python's lock, so that threads can share its work (`threads.py`).
    """

    def compiled(function: Callable[..., Any]) -> Any:
        kept = options.get("cache", False) and _can_be_kept(function)
        kernel = numba.njit(**{"nogil": True, "no_cfunc_wrapper": True, **options, "cache": kept})(function)
        if options.get("cache", False):
            _MADE.append(kernel)
        if kept:
            _tolerate_faults(kernel._cache)
        return kernel

    return compiled


def inlined(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Numba's `njit` for a small function that only kernels call: LLVM puts it in the place of every call.

    Numba's own `inline="always"` does so before types are inferred, anew for every call, and takes twice as
    long.  The flags of fast mathematics are not those of the caller: name them.
    """
    return numba.njit(**INNER, forceinline=True, **options)


def kept_kernels() -> dict[str, list[str]]:
    """The kernels that were defined so far: index files by the folder in which they are kept ("": none).

    An index is there once its kernel was compiled.
    """
    found: dict[str, list[str]] = {}
    for kernel in _MADE:
        cache = kernel._cache
        folder, index = getattr(cache, "_cache_path", ""), getattr(cache, "_impl", None)
        found.setdefault(folder, []).append(f"{index.filename_base}.nbi" if index is not None else "")
    return found


def _tolerate_faults(kept: Any) -> None:
    """Has a kernel compiled that cannot be read, and used where it cannot be kept: neither ends a run."""
    load, save = kept.load_overload, kept.save_overload

    def load_overload(*args: Any) -> Any:
        try:
            return load(*args)
        except Exception:  # what a damaged pickle raises is anything
            return None

    def save_overload(*args: Any) -> None:
        try:
            save(*args)
        except OSError as error:
            _warn(f"Compiled kernels could not be kept ({error.strerror})")
        except Exception:  # from a damaged index, which the next one would read again
            kept.flush()

    kept.load_overload, kept.save_overload = load_overload, save_overload


def _can_be_kept(function: Callable[..., Any]) -> bool:
    if getattr(numba.config, "CACHE_LOCATOR_CLASSES", ""):  # the user's own choice
        return True
    if any(place.from_function(function, inspect.getfile(function)) is not None for place in PLACES):
        return True
    _warn("No place for compiled kernels is writable: they are not kept, and every start compiles them anew")
    return False


class _NoCollection(event.Listener):
    """Leaves the search for cyclic garbage out while Numba compiles: its objects are many, and are in use.

    Every search through all that PyTorch and Numba hold takes a quarter of a second.
    """

    def __init__(self) -> None:
        self._depth, self._enabled = 0, False

    def on_start(self, event: Any) -> None:
        """A compilation begins, maybe within another one; only one thread at a time compiles."""
        if not self._depth:
            self._enabled = gc.isenabled()
            gc.disable()
        self._depth += 1

    def on_end(self, event: Any) -> None:
        """It has ended."""
        self._depth -= 1
        if not self._depth and self._enabled:
            gc.enable()


def _install() -> None:
    """Has Numba keep this package's kernels by their hash; those of other packages stay where they were.

    Numba chooses a kernel's folder when the kernel is defined, which is why this file is imported first.
    """
    event.register("numba:compile", _NoCollection())
    implementation = _numba("CacheImpl")
    known = implementation._locator_classes
    if not any(issubclass(locator, _ByHash) for locator in known):
        implementation._locator_classes = [*PLACES, *known]


class _ByHash:
    """Marks the locators of this file."""


def _by_hash(place: Any) -> Any:
    """One of Numba's locators, for this package alone and with a folder of the hash."""

    class Locator(_ByHash, place):  # type: ignore[misc]  # Numba is untyped
        @classmethod
        def from_function(cls, py_func: Any, py_file: str) -> Any:
            inside = Path(py_file).resolve().is_relative_to(PACKAGE)
            return super().from_function(py_func, py_file) if inside else None

        def get_cache_path(self) -> str:
            return os.path.join(super().get_cache_path(), PREFIX + kernel_hash())

        def get_source_stamp(self) -> str:
            return kernel_hash()

        def ensure_cache_path(self) -> None:
            folder = Path(self.get_cache_path())
            if not folder.is_absolute():  # "~" of a user without a home
                raise OSError(f"{folder} is no place to keep kernels in")
            new = not folder.is_dir()
            super().ensure_cache_path()
            if new:
                _remove_old(folder)

    return Locator


def _in_temporary_folder(place: Any) -> Any:
    """One of Numba's locators, with the user's own folder for temporary files."""

    class Locator(place):  # type: ignore[misc]  # Numba is untyped
        def get_cache_path(self) -> str:
            return str(_temporary_folder() / self.get_suitable_cache_subpath(self._py_file))

        @classmethod
        def from_function(cls, py_func: Any, py_file: str) -> Any:
            try:
                folder = _temporary_folder()
            except OSError:
                return None
            found = super().from_function(py_func, py_file)
            if found is not None:
                _warn(f"Compiled kernels are kept in {folder}: no other place for them is writable")
            return found

    return Locator


@cache
def _temporary_folder() -> Path:
    """A folder for temporary files into which nobody else can write: kernels from it are executed.

    Raises OSError where there is none.
    """
    user = os.getuid() if hasattr(os, "getuid") else os.getlogin()
    folder = Path(tempfile.gettempdir()) / f"plnerf-kernels-{user}"
    folder.mkdir(mode=0o700, exist_ok=True)
    about = folder.lstat()
    private = about.st_uid == user and not about.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    if not (stat.S_ISDIR(about.st_mode) and (private or os.name == "nt")):
        raise OSError(f"{folder} is not a folder of this user alone")
    return folder


@cache
def _warn(what: str) -> None:
    """A warning, once."""
    warnings.warn(f"{what}. Set NUMBA_CACHE_DIR to a folder that is there for long.", stacklevel=2)


def _remove_old(folder: Path) -> None:
    """Removes what is beside a folder of kernels and was not written to for long."""
    with suppress(OSError):  # another process may do the same
        for other in folder.parent.glob(PREFIX + "*"):
            if other != folder and time.time() - other.stat().st_mtime > KEPT_S:
                shutil.rmtree(other, ignore_errors=True)


def _numba(name: str) -> Any:
    """A class of Numba's cache; before Numba 0.62 their names began with an underscore."""
    found = getattr(caching, name, None)
    return getattr(caching, f"_{name}") if found is None else found


PLACES = (
    _by_hash(_numba("UserProvidedCacheLocator")),
    _by_hash(_numba("InTreeCacheLocator")),
    _by_hash(_numba("UserWideCacheLocator")),
    _by_hash(_in_temporary_folder(_numba("InTreeCacheLocator"))),
)
"""Where compiled kernels may be kept; the first that is writable is taken."""
_install()
