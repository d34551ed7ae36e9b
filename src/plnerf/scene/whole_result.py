"""A result of several files that is replaced as a whole: the earlier one stays until the new one is complete.

New files are written into a folder inside that of the result.  Once they are complete the folder gets another
name, by one renaming, and from then on counts: its files are moved to their places, which whoever comes next
goes on with where it was interrupted.
"""

import json
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from plnerf.errors import PlnerfError
from plnerf.scene.only_writer import only_writer

NEW, COMPLETE = ".new", ".complete"
"""Folders of files that are being written, and of complete ones that are being moved to their places."""
LIST = ".files.json"
"""In these: the patterns of all that such a result may hold, and the files that this one holds."""


@contextmanager
def whole_result(folder: Path, patterns: Sequence[str]) -> Iterator[Path]:
    """A folder to write a result into, which replaces the earlier one in `folder` when the block ends well.

    patterns: what such a result may hold, below the folder (as of `Path.glob`); other files are left alone.
    The caller is the only writer of the folder.  Raises PlnerfError where files cannot be written or moved.
    """
    new = folder / NEW
    with _writing(folder):
        _move(folder)
        shutil.rmtree(new, ignore_errors=True)  # of one that was killed
        new.mkdir(parents=True)
    try:
        yield new
        with _writing(folder):
            names = sorted(path.relative_to(new).as_posix() for path in new.rglob("*") if path.is_file())
            (new / LIST).write_text(json.dumps({"patterns": list(patterns), "files": names}))
            new.rename(folder / COMPLETE)
    finally:
        shutil.rmtree(new, ignore_errors=True)
    with _writing(folder):
        _move(folder)


@contextmanager
def _writing(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise PlnerfError(
            f"The result in {folder} cannot be written ({error}). Make room on the disk, or check that you "
            "may write there, and give the command again."
        ) from error


def finish_exchange(folder: Path) -> None:
    """Finishes an exchange that was interrupted, before files of the folder are read.

    Raises PlnerfError where another process is at it, or files cannot be moved.
    """
    if (folder / COMPLETE).is_dir():
        with only_writer(folder), _writing(folder):
            _move(folder)


def _move(folder: Path) -> None:
    """Removes what is left of the earlier result and moves the complete one to its place; can be repeated."""
    complete = folder / COMPLETE
    if not complete.is_dir():
        return
    if (complete / LIST).exists():  # it is removed last, when nothing is left to move
        listed = json.loads((complete / LIST).read_text())
        files = set(listed["files"])
        for old in (path for pattern in listed["patterns"] for path in folder.glob(pattern)):
            if old.relative_to(folder).as_posix() not in files:
                old.unlink()
        for name in listed["files"]:
            if (complete / name).exists():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                (complete / name).replace(folder / name)
    shutil.rmtree(complete)
