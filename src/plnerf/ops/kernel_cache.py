"""Numba's `njit` and `prange` for kernels, and where compiled kernels are kept: by a hash of their source.

Numba's own cache knows a kernel by the file that defines it.  A kernel calls others of other files, which are
compiled into it: after an edit there, the old machine code would still run.  Here the hash covers every file
of `ops/` and every other file of the package that defines a kernel, so that an edit to any of them compiles
all anew; every kernel takes `njit` from here.  The places are Numba's, in its order: NUMBA_CACHE_DIR,
`__pycache__` beside the file, the user's cache folder; the next is taken where one is not writable.
"""

import hashlib
import os
import shutil
import time
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from numba import njit, prange
from numba.core import caching

__all__ = ["njit", "prange"]

PACKAGE = Path(__file__).resolve().parent.parent
PREFIX = "kernels-"
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


def _install() -> None:
    """Has Numba keep this package's kernels by their hash; those of other packages stay where they were.

    Numba chooses a kernel's folder when the kernel is defined, which is why this file is imported first.
    """
    implementation = _numba("CacheImpl")
    known = implementation._locator_classes
    if not any(issubclass(locator, _ByHash) for locator in known):
        names = ("UserProvidedCacheLocator", "InTreeCacheLocator", "UserWideCacheLocator")
        implementation._locator_classes = [*(_by_hash(_numba(name)) for name in names), *known]


class _ByHash:
    """Marks the locators of this file."""


def _by_hash(place: Any) -> type[_ByHash]:
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
            new = not folder.is_dir()
            super().ensure_cache_path()
            if new:
                _remove_old(folder)

    return Locator


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


_install()
