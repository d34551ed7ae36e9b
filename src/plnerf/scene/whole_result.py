"""A result of several files that is replaced as a whole: the earlier one stays until the new one is complete.

New files are written into a folder inside that of the result.  Once they are complete the folder gets another
name, by one renaming, and from then on counts: its files are moved to their places, which whoever comes next
goes on with where it was interrupted.
"""

import json
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from plnerf.errors import PlnerfError
from plnerf.scene.only_writer import only_writer
from plnerf.scene.strict_json import read_json
from plnerf.scene.typed_json import from_json

NEW, COMPLETE = ".new", ".complete"
"""Folders of files that are being written, and of complete ones that are being moved to their places."""
LIST = ".files.json"
"""In these: the patterns of all that such a result may hold, and the files that this one holds."""


@dataclass(frozen=True)
class _List:
    """What such a file holds."""

    patterns: tuple[str, ...]
    files: tuple[str, ...]


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
            (new / LIST).write_text(json.dumps(asdict(_List(tuple(patterns), tuple(names)))))
            new.rename(folder / COMPLETE)
            _move(folder)
    except KeyboardInterrupt:
        with _writing(folder):
            _move(folder)  # what is complete counts, and is not left between two places
        raise
    finally:
        shutil.rmtree(new, ignore_errors=True)


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
        listed, old = _read_list(folder)
        for path in old:
            path.unlink()
        for name in listed.files:
            if (complete / name).exists():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                (complete / name).replace(folder / name)
    shutil.rmtree(complete)


def _read_list(folder: Path) -> tuple[_List, list[Path]]:
    """The list of a complete result, and the files of earlier ones that it has no more.

    Raises PlnerfError where it is damaged, or names what is not inside the folder: that may come from others.
    """
    path = folder / COMPLETE / LIST
    do = f"Remove {path.parent}, and give the command again."
    listed = from_json(_List, read_json(path, PlnerfError, do), str(path), PlnerfError)
    files, root = {folder / name for name in listed.files}, folder.resolve()
    try:
        found = {one for pattern in listed.patterns for one in folder.glob(pattern)}
        outside = [one for one in found | files if not one.parent.resolve().is_relative_to(root)]
    except (ValueError, NotImplementedError) as error:  # no name of a file, or no pattern
        raise PlnerfError(f"{path} is damaged ({error}). {do}") from error
    if outside:
        raise PlnerfError(f"{path} names {outside[0]}, which is not inside the folder. {do}")
    return listed, sorted(found - files)
