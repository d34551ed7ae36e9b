"""One process writes into a folder; the next one learns who does, and a killed one holds nothing."""

import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from filelock import FileLock

from plnerf.errors import PlnerfError
from plnerf.scene.only_writer import HOLDER, LOCK, only_writer

HOLD = """
import sys, time
from pathlib import Path
from plnerf.scene.only_writer import only_writer
sys.argv = ["/usr/bin/plnerf", "train", "a scene", "-o", "run"]
with only_writer(Path(sys.stdin.readline().strip())):
    print("held", flush=True)
    time.sleep(60)
"""


def test_another_process_is_named_and_holds_nothing_once_it_is_killed(tmp_path: Path) -> None:
    run = tmp_path / "run"
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", HOLD], text=True, **pipes) as process:
        try:
            assert process.stdin is not None and process.stdout is not None
            process.stdin.write(f"{run}\n")
            process.stdin.flush()
            assert process.stdout.readline() == "held\n"
            with pytest.raises(PlnerfError) as caught, only_writer(run):
                pass
        finally:
            process.kill()
    text = str(caught.value)
    assert text.startswith(f"{run} is being written by process {process.pid} on ")
    assert "(`plnerf train 'a scene' -o run`). Wait until it has ended, or name another folder: -o." in text
    assert {path.name for path in run.iterdir()} == {LOCK, HOLDER}
    with only_writer(run):
        assert json.loads((run / HOLDER).read_text())["process"] == os.getpid()
    assert list(run.iterdir()) == []


def test_an_error_frees_the_folder_and_a_folder_made_in_vain_goes(tmp_path: Path) -> None:
    for folder in (tmp_path / "new", tmp_path):
        with pytest.raises(ValueError, match="wrong"), only_writer(folder):
            raise ValueError("wrong")
        with only_writer(folder):
            pass
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("content", [None, "", "[]", "{}"])
def test_a_holder_that_is_not_known_is_another_process(content: str | None, tmp_path: Path) -> None:
    with only_writer(tmp_path):
        (tmp_path / HOLDER).unlink()
        if content is not None:
            (tmp_path / HOLDER).write_text(content)
        with pytest.raises(PlnerfError, match="is being written by another process"), only_writer(tmp_path):
            pass


def test_a_disk_without_locks_gives_a_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unable(*_: object, **__: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(FileLock, "acquire", unable)
    with pytest.warns(UserWarning, match="No locks available"), only_writer(tmp_path):
        pass
