"""Files that are complete or absent: written beside their place, then renamed into it."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from plnerf.errors import PlnerfError, advice_on

MAX_NAME, SHORT = 255, 20
"""Bytes of a name that file systems take, and characters that are kept of one that gets too long."""


@contextmanager
def complete_file(path: Path) -> Iterator[Path]:
    """A path beside `path`, with the same suffix; it becomes `path` when the block ends well.

    Makes the folder.  Raises PlnerfError where the file cannot be written, such as on a full disk.
    """
    beside = path.with_name(f"{path.stem}.partial{path.suffix}")
    if len(os.fsencode(beside.name)) > MAX_NAME:  # though the name itself may fit
        beside = path.with_name(f"{path.stem[:SHORT]}.partial{path.suffix[:SHORT]}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield beside
            beside.replace(path)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        raise PlnerfError(
            f"The file {path} cannot be written ({error.strerror or error}). {advice_on(error)} No "
            "half-written file is left behind."
        ) from error


def write_text(path: Path, text: str) -> None:
    """A text file in UTF-8."""
    with complete_file(path) as beside:
        beside.write_text(text, encoding="utf-8")


def check_folder(folder: Path) -> None:
    """Raises PlnerfError where files cannot be written into a folder, which need not be there yet.

    Called before a long computation, whose result would be lost.
    """
    place = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not place.is_dir():
        it = "it" if place == folder else str(place)
        raise PlnerfError(f"{folder} is to be a folder, but {it} is a file. Name another place: -o.")
    if not os.access(place, os.W_OK | os.X_OK):
        raise PlnerfError(f"{folder} is to be written, but {place} is read-only. Name another place: -o.")
