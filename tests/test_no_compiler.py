"""Training needs no compiler: Numba brings its own LLVM, Triton comes with PyTorch."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from tests.support.changed import options
from tests.support.tiny_run import SMALL

COMPILERS = (
    "cc",
    "gcc",
    "g++",
    "c++",
    "clang",
    "clang++",
    "cl",
    "nvcc",
    "ld",
    "as",
    "cmake",
    "ninja",
    "make",
)


@pytest.mark.slow
def test_a_machine_without_a_compiler_trains(built_tiny_scene: Path, tmp_path: Path) -> None:
    """In a process that finds no program but Python, all kernels compiled anew."""
    programs = tmp_path / "bin"
    programs.mkdir()
    (programs / "python").symlink_to(sys.executable)
    environment = {key: value for key, value in os.environ.items() if key not in {"CC", "CXX", "CUDACXX"}}
    environment |= {"PATH": str(programs), "NUMBA_CACHE_DIR": str(tmp_path / "numba")}
    assert shutil.which("python", path=environment["PATH"]) is not None
    assert [name for name in COMPILERS if shutil.which(name, path=environment["PATH"])] == []
    run = tmp_path / "run"
    train = [sys.executable, "-m", "plnerf.cli.main", "train"]
    command = [*train, str(built_tiny_scene), "-o", str(run), *options(SMALL)]
    done = subprocess.run(
        [*command, "--steps", "20", "--device", "cpu", "--backend", "numba"],
        env=environment, text=True, capture_output=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    log = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    assert log[-1]["step"] == 20
    assert list((tmp_path / "numba").rglob("*.nbc"))  # compiled here, by nothing on the PATH
