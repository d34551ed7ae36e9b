"""One command at a time writes into a folder: a lock that ends with its process and names its holder."""

import json
import os
import shlex
import socket
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from textwrap import shorten

from filelock import BaseFileLock, FileLock, Timeout

from plnerf.errors import PlnerfError
from plnerf.scene.files import check_folder

LOCK = ".lock"
"""In the folder while it is held, empty."""
HOLDER = ".lock.json"
"""Who holds the lock: process, host, command, and since when."""


@contextmanager
def only_writer(folder: Path) -> Iterator[None]:
    """Holds a folder, which is made, while the block runs.

    Raises PlnerfError where another process, or another part of this one, holds it.  A process that is killed
    holds nothing any more.  Where the disk knows no locks, nothing is held, with a warning.
    """
    check_folder(folder)
    new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    lock, holder = FileLock(folder / LOCK), folder / HOLDER
    held = _acquire(lock, folder)
    try:
        with suppress(OSError):  # a full disk: the lock itself needs no room
            holder.write_text(json.dumps(_about_this_process()), encoding="utf-8")
        yield
    finally:
        with suppress(OSError):  # some systems remove no open file, and none a folder that is not empty
            holder.unlink(missing_ok=True)
            (folder / LOCK).unlink(missing_ok=True)  # while it is held: nobody waits for it
            if new:
                folder.rmdir()  # where nothing came of it
        if held:
            lock.release()


def _acquire(lock: BaseFileLock, folder: Path) -> bool:
    """Whether the disk knows locks; raises PlnerfError where another process holds this one."""
    try:
        lock.acquire(timeout=0)
    except Timeout:
        raise PlnerfError(
            f"{folder} is being written by {_who(folder / HOLDER)}. Wait until it has ended, or name another "
            "folder: -o."
        ) from None
    except (NotImplementedError, OSError) as error:
        warnings.warn(
            f"{folder} cannot be locked ({error}). Take care that no other command writes into it.",
            stacklevel=4,
        )
        return False
    return True


def _about_this_process() -> dict[str, str | int]:
    return {
        "process": os.getpid(),
        "host": socket.gethostname(),
        "command": shorten(shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]), 200),
        "since": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    }


def _who(holder: Path) -> str:
    """The holder in words; its file may be removed already, or not there yet."""
    try:
        about = json.loads(holder.read_text(encoding="utf-8"))
        return (
            f"process {about['process']} on {about['host']} since {about['since']} (`{about['command']}`)"
        )
    except (OSError, ValueError, KeyError, TypeError):
        return "another process"
