"""The command line in processes of their own, forked from a server that has imported everything.

A process that a shell would start imports PyTorch and Numba first, which takes seconds; in all else these are
the same: they share no memory, can be killed, and have standard streams and an environment of their own.
"""

import multiprocessing
import os
import signal
import sys
import tempfile
from collections.abc import Mapping
from multiprocessing import forkserver
from pathlib import Path

LIMIT_S = 100.0
ONE_THREAD = {name: "1" for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
"""Read when libraries are loaded: of the server, and so of all."""


class Forked:
    """`plnerf ARGUMENTS`, begun."""

    def __init__(self, *arguments: str | Path, **environment: str) -> None:
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(["tests.faults.preloaded"])
        before = dict(os.environ)
        os.environ.update(ONE_THREAD)
        try:
            forkserver.ensure_running()
        finally:
            os.environ.clear()
            os.environ.update(before)
        self._streams = tempfile.TemporaryDirectory()
        environment = {"COLUMNS": "100", "NO_COLOR": "1", **environment}
        self._process = context.Process(
            target=_main, args=([*map(str, arguments)], self._streams.name, environment)
        )
        self._process.start()

    def status(self) -> int | None:
        """Exit status, or minus the signal that ended it; None while it runs."""
        return self._process.exitcode

    def kill(self) -> None:
        """By SIGKILL: no handler, no clean-up."""
        self._process.kill()
        self._process.join(LIMIT_S)

    def wait(self) -> tuple[int, str, str]:
        """Exit status, standard output and standard error, once it has ended."""
        self._process.join(LIMIT_S)
        out, err = (Path(self._streams.name, name).read_text() for name in ("out", "err"))
        if self._process.exitcode is None:
            self.kill()
            raise AssertionError(f"still runs after {LIMIT_S:g} s: {out}{err}")
        return self._process.exitcode, out, err


def _main(arguments: list[str], streams: str, environment: Mapping[str, str]) -> None:
    for number, name in ((1, "out"), (2, "err")):
        os.dup2(os.open(Path(streams, name), os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
    os.environ.update(environment)
    from plnerf.cli.main import main

    sys.argv = ["plnerf", *arguments]
    main()
