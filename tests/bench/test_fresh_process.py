"""A process of a suite ends with the one that began it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from plnerf.bench.fresh_process import in_fresh_process
from plnerf.cli.stop import stoppable


def wait_for_ever(told: Path) -> None:
    told.write_text(str(os.getpid()))
    time.sleep(600)


def running(pid: int) -> bool:
    status = Path(f"/proc/{pid}/stat")
    return status.exists() and status.read_text().rpartition(")")[2].split()[0] != "Z"


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="asks Linux which processes run")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_it_does_not_outlive_its_parent(tmp_path: Path, number: signal.Signals) -> None:
    told = tmp_path / "pid"
    parent = subprocess.Popen([sys.executable, __file__, str(told)])
    until = time.monotonic() + 60
    while not (told.exists() and told.read_text()):
        assert time.monotonic() < until and parent.poll() is None
        time.sleep(0.05)
    child = int(told.read_text())
    assert child != parent.pid and running(child)
    parent.send_signal(number)
    assert parent.wait(20) != 0
    until = time.monotonic() + 20
    while running(child):
        assert time.monotonic() < until
        time.sleep(0.05)


if __name__ == "__main__":
    with stoppable():
        in_fresh_process(wait_for_ever, Path(sys.argv[1]))
