"""Faults at a chosen change of the disk: Python's audit events report each before it is made."""

import errno
import os
import signal
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FAULTS: dict[str, signal.Signals | int] = {
    "kill": signal.SIGKILL,
    "terminate": signal.SIGTERM,
    "interrupt": signal.SIGINT,
    "full": errno.ENOSPC,
    "read-only": errno.EROFS,
}
"""A signal, which comes once, or an error, in which this and all further changes end."""
REMOVALS = {"os.remove", "os.rmdir"}
CHANGES = {"os.rename", "os.mkdir", "os.truncate", "os.link", "os.symlink"} | REMOVALS
WRITING = os.O_WRONLY | os.O_RDWR


@dataclass(frozen=True)
class Fault:
    """What goes wrong, and when."""

    at: int
    """The change of files, counted from 1; 0: never."""
    what: str = "kill"
    """Of `FAULTS`."""
    after_s: float = 0.0
    """A signal comes so much later."""
    stage: str = ""
    """Changes are counted from the beginning of this stage; "": from that of the command."""


NONE = Fault(0)


class Changes:
    """Counts openings for writing, renamings, removals, new folders and links below a folder.

    A hook for `sys.addaudithook`, which brings the fault.
    """

    def __init__(self, folder: Path, fault: Fault = NONE) -> None:
        self.folder, self.fault, self.count = os.path.abspath(folder), fault, 0
        self._at = 0 if fault.stage else fault.at

    def begin(self, stage: str) -> None:
        """A stage of the command begins."""
        if stage == self.fault.stage:
            self._at = self.count + self.fault.at

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event not in CHANGES and event != "open":
            return
        path, *others = arguments
        if not isinstance(path, str) or not os.path.abspath(path).startswith(self.folder + os.sep):
            return
        if event == "open" and not (isinstance(others[1], int) and others[1] & WRITING):
            return
        self.count += 1
        if 0 < self._at <= self.count:
            self._fail(event)

    def _fail(self, event: str) -> None:
        what, after_s = FAULTS[self.fault.what], self.fault.after_s
        if isinstance(what, signal.Signals):
            if self.count > self._at:
                return
            if after_s:
                threading.Timer(after_s, os.kill, (os.getpid(), what)).start()
            else:
                os.kill(os.getpid(), what)
        elif what != errno.ENOSPC or event not in REMOVALS:  # a full disk lets files be removed
            raise OSError(what, os.strerror(what))
