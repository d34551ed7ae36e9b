"""Long calls of COLMAP in a process of their own, which an interrupt ends at once.

COLMAP looks for interrupts between images, which are seconds apart, and finishes what it has begun: many
seconds of work on large photos.  What a call leaves on disk is whole after any end (SQLite's journal, folders
that are renamed when they are complete), so the process is killed.  A crash of native code ends that process
only.

Messages are pickled, over pipes between the two.  The process waits after each report until it was heard, and
ends itself where its parent is gone.
"""

import os
import pickle
import queue
import re
import signal
import sqlite3
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import IO, Any

from plnerf.capture.mapping import Tell
from plnerf.errors import CaptureError

_HEARD = "heard"
_THROWN = re.compile(rb"what\(\):\s*([^\n]{1,200})")
"""What is printed of the C++ exception that ended the process."""


class ColmapProcess:
    """Calls functions of modules in one other process, which is started by the first call."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._printed = tempfile.TemporaryFile()  # noqa: SIM115 (closed by __exit__)

    def __enter__(self) -> "ColmapProcess":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            for pipe in (self._process.stdin, self._process.stdout):
                if pipe is not None:
                    pipe.close()
        self._printed.close()

    def call(self, function: Callable[..., Any], *arguments: object, tell: Tell) -> Any:
        """What the function returns, called with the arguments and then a `Tell`, whose reports come here.

        Its errors are raised here.  Raises CaptureError for those of COLMAP and SQLite, and where the process
        ends without a result.
        """
        process = self._process = self._process or _start(self._printed)
        assert process.stdin is not None and process.stdout is not None
        try:
            _send(process.stdin, (function, arguments))
            while True:
                what, content = pickle.load(process.stdout)
                if what == "done":
                    return content
                if what == "failed":
                    raise _in_words(content)
                tell(*content)
                _send(process.stdin, _HEARD)
        except (EOFError, BrokenPipeError, pickle.UnpicklingError) as error:
            raise CaptureError(
                f"COLMAP's process ended without a result ({self._end()}): the disk may be full, the system "
                "short of memory, or a photo damaged in a way that COLMAP does not survive. What was done is "
                "kept: the same command goes on from there."
            ) from error

    def _end(self) -> str:
        """Its signal or exit status, and the exception that it printed, without the native stack."""
        assert self._process is not None
        code = self._process.wait()
        self._printed.seek(0)
        thrown = _THROWN.search(self._printed.read())
        try:
            ended = signal.Signals(-code).name if code < 0 else f"status {code}"
        except ValueError:
            ended = f"signal {-code}"
        return ended if thrown is None else f"{ended}, {thrown[1].decode(errors='replace')}"


def _in_words(error: Exception) -> Exception:
    """The error; for COLMAP's own, which are bare RuntimeErrors, and SQLite's, what can be done about it."""
    if type(error) is not RuntimeError and not isinstance(error, sqlite3.Error):
        return error
    own = CaptureError(
        f"COLMAP could not go on ({error}). Make room on the disk if it is full, and give the same command "
        "again: what was done is kept. If it ends so again, remove the scene's folder sfm: it is made anew."
    )
    own.__cause__ = error
    return own


def _not_loaded(error: Exception) -> CaptureError:
    return CaptureError(
        f"COLMAP could not be loaded ({type(error).__name__}: {error}). The system may be short of memory: "
        "close other programs or raise its limit (ulimit -v), and give the same command again."
    )


def _start(printed: IO[bytes]) -> "subprocess.Popen[bytes]":
    """A process in a group of its own, so that Ctrl-C reaches the parent alone, which then ends it.

    printed: a file for what it prints.
    """
    source = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join(filter(None, (source, os.environ.get("PYTHONPATH"))))
    return subprocess.Popen(
        [sys.executable, "-m", "plnerf.capture.colmap_process"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=printed,
        env={**os.environ, "PYTHONPATH": path},
        process_group=0,
    )


def _send(pipe: IO[bytes], content: object) -> None:
    pickle.dump(content, pipe)
    pipe.flush()


def _serve() -> None:
    """The other process: answers calls until its parent closes the pipe or is gone."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # so that nothing that COLMAP prints comes among the answers
    received: queue.Queue[Any] = queue.Queue()

    def listen() -> None:
        try:
            while True:
                received.put(pickle.load(sys.stdin.buffer))
        except (EOFError, OSError):
            os._exit(1)  # also in the middle of a long call: nobody waits for it any more
        except Exception as error:  # of importing the function, as where memory is short
            _send(answers, ("failed", _not_loaded(error)))
            os._exit(1)

    def tell(stage: str, done: int, of: int) -> None:
        _send(answers, ("progress", (stage, done, of)))
        received.get()

    threading.Thread(target=listen, daemon=True).start()
    while True:
        function, arguments = received.get()
        try:
            answer = ("done", function(*arguments, tell))
        except Exception as error:
            answer = ("failed", error)
        _send(answers, answer)


if __name__ == "__main__":
    _serve()
