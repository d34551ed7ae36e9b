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


COMPILED = """
import torch
from plnerf.ops.cpu_adam import adam_rows
param, grad, m, v = torch.zeros(64, 2), torch.ones(64, 2), torch.zeros(64, 2), torch.zeros(64, 2)
adam_rows(param, grad, m, v, rate=0.1, betas=(0.9, 0.99), eps=1e-15, step=1)
print(float(param.mean()))
"""


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """In which no program is found but Python."""
    programs = tmp_path / "bin"
    programs.mkdir()
    (programs / "python").symlink_to(sys.executable)
    found = {key: value for key, value in os.environ.items() if key not in {"CC", "CXX", "CUDACXX"}}
    found["PATH"] = str(programs)
    assert shutil.which("python", path=found["PATH"]) is not None
    assert [name for name in COMPILERS if shutil.which(name, path=found["PATH"])] == []
    return found


@pytest.mark.slow
def test_a_machine_without_a_compiler_trains(
    environment: dict[str, str], built_tiny_scene: Path, tmp_path: Path
) -> None:
    """With the kernels that are on disk; `benchmarks/no_compiler.sh` has all of them compiled anew."""
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


@pytest.mark.slow
def test_a_machine_without_a_compiler_compiles_kernels(environment: dict[str, str], tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", COMPILED], env=environment | {"NUMBA_CACHE_DIR": str(tmp_path / "numba")},
        text=True, capture_output=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) < 0
    assert list((tmp_path / "numba").rglob("*.nbc"))  # compiled here, by nothing on the PATH
