"""Long calls in another process: they report, end at once with an interrupt, and take nothing along."""

import importlib
import os
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from plnerf.capture.colmap_process import ColmapProcess
from plnerf.capture.mapping import Tell
from plnerf.errors import CaptureError

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def _other_processes_find_this_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))


def counts(most: int, tell: Tell) -> int:
    print("what a library prints comes among no answer")
    for done in range(most):
        tell("count", done, most)
    return os.getpid()


def fails(tell: Tell) -> None:
    raise CaptureError("as the function has it")


def fails_in_colmap(tell: Tell) -> None:
    raise RuntimeError("No registered database factory succeeded.")


def fails_in_sqlite(tell: Tell) -> None:
    raise sqlite3.OperationalError("database or disk is full")


def has_a_defect(tell: Tell) -> None:
    raise NotImplementedError("a kind of RuntimeError")


def crashes(tell: Tell) -> None:
    signal.signal(signal.SIGSEGV, signal.SIG_DFL)
    os.kill(os.getpid(), signal.SIGSEGV)


def throws(tell: Tell) -> None:
    text = "terminate called after throwing an instance of 'E'\n  what():  disk I/O error\n*** Aborted\n"
    os.write(2, text.encode())
    os.abort()


def hangs(tell: Tell) -> None:
    tell("hang", 0, 1)
    time.sleep(600)


def silent(stage: str, done: int, of: int) -> None:
    pass


def test_reports_results_and_errors_come_back() -> None:
    told: list[tuple[str, int, int]] = []
    with ColmapProcess() as colmap:
        first = colmap.call(counts, 3, tell=lambda *report: told.append(report))
        with pytest.raises(CaptureError, match="as the function has it"):
            colmap.call(fails, tell=silent)
        assert colmap.call(counts, 0, tell=silent) == first != os.getpid()  # one process for all calls
    assert told == [("count", 0, 3), ("count", 1, 3), ("count", 2, 3)]


def test_what_colmap_raises_is_an_error_with_what_to_do() -> None:
    with ColmapProcess() as colmap:
        for function, said in ((fails_in_colmap, "factory succeeded"), (fails_in_sqlite, "disk is full")):
            with pytest.raises(CaptureError, match=rf"could not go on \(.*{said}.*Make room on the disk"):
                colmap.call(function, tell=silent)
        with pytest.raises(NotImplementedError):
            colmap.call(has_a_defect, tell=silent)


def test_a_crash_is_an_error_and_an_interrupt_ends_the_call() -> None:
    with ColmapProcess() as colmap, pytest.raises(CaptureError, match=r"without a result \(SIGSEGV\)"):
        colmap.call(crashes, tell=silent)
    main = threading.main_thread().ident
    assert main is not None

    def press(*_: object) -> None:
        threading.Timer(0.1, signal.pthread_kill, (main, signal.SIGINT)).start()

    clock = time.perf_counter()
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # jobs in the background ignore it
    try:
        with pytest.raises(KeyboardInterrupt), ColmapProcess() as colmap:
            colmap.call(hangs, tell=press)
    finally:
        signal.signal(signal.SIGINT, before)
    assert colmap._process is not None and colmap._process.returncode == -signal.SIGKILL
    assert time.perf_counter() - clock < 60


def test_what_c_plus_plus_throws_is_in_the_error_and_no_stack_is_printed(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with (
        ColmapProcess() as colmap,
        pytest.raises(CaptureError, match=r"result \(SIGABRT, disk I/O error\): the disk may be full"),
    ):
        colmap.call(throws, tell=silent)
    assert capfd.readouterr().err == ""


def test_what_the_other_process_cannot_load_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As COLMAP's libraries where memory is short: nobody would answer."""
    (tmp_path / "only_here.py").write_text("def counts(tell):\n    return 0\n")
    monkeypatch.syspath_prepend(tmp_path)
    function = importlib.import_module("only_here").counts
    with ColmapProcess() as colmap, pytest.raises(CaptureError, match=r"could not be loaded .*only_here"):
        colmap.call(function, tell=silent)
    assert colmap._process is not None and colmap._process.returncode is not None  # it has ended


def test_it_ends_itself_where_its_parent_is_gone() -> None:
    def leave(*_: object) -> None:
        assert colmap._process is not None and colmap._process.stdin is not None
        colmap._process.stdin.close()
        assert colmap._process.wait(60) == 1
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), ColmapProcess() as colmap:
        colmap.call(hangs, tell=leave)


def test_sigterm_stays_the_programs_own() -> None:
    """COLMAP's logging takes it, and prints a stack."""
    code = (
        "import os, signal, sys\n"
        "signal.signal(signal.SIGTERM, lambda *_: sys.exit(7))\n"
        "import plnerf.scene.colmap\n"
        "os.kill(os.getpid(), signal.SIGTERM)\n"
    )
    path = os.pathsep.join([str(ROOT / "src"), os.environ["PYTHONPATH"]])
    environment = {**os.environ, "PYTHONPATH": path}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (7, "")
