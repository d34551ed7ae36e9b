"""Kernels compile for a user who can write neither beside the package nor at home; only the user's own
folder for temporary files is trusted, since what is kept there is executed."""

import errno
import os
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from numba.core.caching import IndexDataCacheFile, NullCache, _CacheLocator

from plnerf.ops import kernel_cache

KERNEL = """
from plnerf.ops.kernel_cache import njit

@njit(cache=True, error_model="numpy")
def twice(x):
    return 2 * x
"""


@pytest.fixture
def unwritable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder for temporary files, of a system on which nothing else can be written."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    inside = _CacheLocator.ensure_cache_path

    def only_there(self: Any) -> None:
        if not Path(self.get_cache_path()).is_relative_to(temporary):
            raise PermissionError(13, "Permission denied", self.get_cache_path())
        inside(self)

    monkeypatch.setattr(_CacheLocator, "ensure_cache_path", only_there)
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    _forget()
    yield temporary
    _forget()


def _forget() -> None:
    kernel_cache._temporary_folder.cache_clear()
    kernel_cache._warn.cache_clear()


def kernel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A kernel of a file that is taken for one of the package."""
    file = tmp_path / "package" / "kernels.py"
    file.parent.mkdir(exist_ok=True)
    file.write_text(KERNEL)
    monkeypatch.setattr(kernel_cache, "PACKAGE", tmp_path / "package")
    names: dict[str, Any] = {"__name__": "kernels"}
    exec(compile(KERNEL, str(file), "exec"), names)
    return names["twice"]


def test_kernels_are_kept_among_temporary_files(
    unwritable: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.warns(UserWarning) as said:
        twice = kernel(tmp_path, monkeypatch)
    (folder,) = unwritable.iterdir()
    assert folder.stat().st_mode & 0o777 == 0o700
    assert [str(one.message) for one in said] == [
        f"Compiled kernels are kept in {folder}: no other place for them is writable. Set NUMBA_CACHE_DIR to "
        "a folder that is there for long."
    ]
    assert twice(4) == 8 and len(list(folder.rglob("*.nbc"))) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        again = kernel(tmp_path, monkeypatch)  # said once
    assert again(4) == 8 and sum(again.stats.cache_hits.values()) == 1


@pytest.mark.parametrize("fault", ["others_may_write", "a_link", "a_file"])
def test_a_folder_of_others_is_not_trusted(
    fault: str, unwritable: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kernel_cache._temporary_folder()
    _forget()
    (folder,) = unwritable.iterdir()
    if fault == "others_may_write":
        folder.chmod(0o777)
    else:
        folder.rmdir()
        (tmp_path / "elsewhere").mkdir()
        folder.write_text("") if fault == "a_file" else folder.symlink_to(tmp_path / "elsewhere")
    with pytest.warns(UserWarning, match=r"not kept, and every start compiles them anew\. Set NUMBA"):
        twice = kernel(tmp_path, monkeypatch)
    assert isinstance(twice._cache, NullCache) and twice(4) == 8
    assert not list(tmp_path.rglob("*.nbc"))


def test_a_folder_that_only_looks_like_home_is_not_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where a user has no home, "~" stays what it is, and would be a folder of the current one."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)
    place = kernel_cache.PLACES[2]
    assert place.from_function(kernel_cache._remove_old, kernel_cache.__file__) is None
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_and_damaged_kernels_end_no_run(
    unwritable: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.warns(UserWarning, match="kept in"):
        twice = kernel(tmp_path, monkeypatch)
    with monkeypatch.context() as patch, pytest.warns(UserWarning, match="No space left on device"):
        patch.setattr(IndexDataCacheFile, "_save_data", full)
        assert twice(4) == 8
    assert kernel(tmp_path, monkeypatch)(4) == 8  # and writes it
    for suffix in ("nbc", "nbi"):
        (file,) = unwritable.rglob(f"*.{suffix}")
        file.write_bytes(file.read_bytes()[:50])
        for _ in range(2):  # a damaged index is emptied first, and written to by the next process
            assert kernel(tmp_path, monkeypatch)(4) == 8
        again = kernel(tmp_path, monkeypatch)
        assert again(4) == 8 and not again.stats.cache_misses
