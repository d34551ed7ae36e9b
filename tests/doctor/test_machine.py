"""The doctor reports what this machine brings, and which kernels are compiled already."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from plnerf.cli.main import main
from plnerf.doctor.machine import _megabytes

CODE = """
import numpy as np
from plnerf.detect.parabola import curve_point
from plnerf.doctor.machine import examine_machine
before = examine_machine()
curve_point(np.zeros(6), 0.5)
after = examine_machine()
folder = lambda machine: next(one for one in machine.kernels if "detect" in one.path)
print(folder(before).compiled, folder(after).compiled, folder(after).files, folder(after).megabytes > 0)
print(folder(after).path)
"""


@pytest.mark.slow
def test_what_is_compiled_is_counted(tmp_path: Path) -> None:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", CODE]
    done = subprocess.run(command, env=environment, text=True, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    counts, folder = done.stdout.splitlines()
    assert counts == "0 1 1 True" and Path(folder).is_relative_to(tmp_path)


def test_kernels_that_another_process_removes_meanwhile_are_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "kernel.nbc").write_bytes(b"12")
    stat = Path.stat

    def then_removed(path: Path, **options: bool) -> os.stat_result:
        about = stat(path, **options)
        if path.suffix == ".nbc":
            path.unlink()
        return about

    monkeypatch.setattr(Path, "stat", then_removed)
    assert _megabytes([tmp_path]) == pytest.approx(2e-6)


def test_the_command_needs_no_scene(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "machine.json"
    monkeypatch.setattr(sys, "argv", ["plnerf", "doctor", "--machine", "-o", str(out)])
    main()
    said, machine = capsys.readouterr().out, json.loads(out.read_text())
    places = " ".join(one["path"] for one in machine["kernels"])
    assert machine["usable_cores"] >= 1 and all(room in places for room in ("detect", "ops", "survey"))
    assert f"backend    {machine['backend']} on {machine['device']}" in said
    assert all(one["path"] in said for one in machine["kernels"])


def test_without_a_scene_it_says_what_to_give(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["plnerf", "doctor"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    assert "needs a scene or a folder of photos, or --machine" in capsys.readouterr().err
