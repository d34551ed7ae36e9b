"""An edited kernel is compiled anew, even where the edit is in another file than the kernel that runs."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import plnerf
from plnerf.ops import kernel_cache

PACKAGE = Path(plnerf.__file__).parent
SERVER = """
import json, os, sys, traceback
import numba, scipy.spatial, torch

for line in sys.stdin:
    folder, environment = json.loads(line)
    child = os.fork()
    if child:
        os.waitpid(child, 0)
        continue
    os.environ.update(environment)
    numba.core.config.reload_config()
    sys.path.insert(0, folder)
    try:
        from plnerf.ops import cpu_volume
        w = cpu_volume.weights_from_density(torch.ones(1, 4), torch.linspace(0, 1, 5)[None])
        hits = sum(cpu_volume._weights.stats.cache_hits.values())
        print(f"{cpu_volume.__file__} {float(w.sum()):.6f} {hits}", flush=True)
    except BaseException:
        print(traceback.format_exc().replace("\\n", " | "), flush=True)
    os._exit(0)
"""
"""Of each line, a folder and an environment, it prints the summed weights of a ray by the package in the
folder, and how often the kernel came from the cache: in a process of its own, forked before the package is
imported."""
EXACT = "(one - scale) - scale * p"
Run = Callable[..., tuple[float, int]]


@pytest.fixture(scope="module")
def run_copy() -> Iterator[Run]:
    if not hasattr(os, "fork"):
        pytest.skip("needs a system with fork")
    bare = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-I", "-c", SERVER], env=bare, **pipes) as server:
        assert server.stdin is not None and server.stdout is not None

        def run(folder: Path, **environment: str) -> tuple[float, int]:
            line = json.dumps([str(folder), {"NUMBA_CACHE_DIR": "", **environment}])
            server.stdin.write(f"{line}\n")
            server.stdin.flush()
            answer = server.stdout.readline()
            path, total, hits = answer.split() if answer.startswith(str(folder)) else (answer, "", "")
            assert hits, path
            return float(total), int(hits)

        yield run
        server.stdin.close()


def copy_package(folder: Path) -> Path:
    copy = folder / "plnerf"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("data", "__pycache__"))
    return copy


@pytest.mark.slow
def test_an_edit_to_a_kernel_of_another_file_is_compiled(run_copy: Run, tmp_path: Path) -> None:
    copy = copy_package(tmp_path)
    first, hits = run_copy(tmp_path)
    assert abs(first - 0.632121) < 1e-5 and hits == 0  # 1 - exp(-1)
    math = copy / "ops" / "cpu_math.py"
    source = math.read_text()
    assert EXACT in source
    math.write_text(source.replace(EXACT, f"{EXACT} - scale * _f32(0.25)"))
    edited, hits = run_copy(tmp_path)
    assert edited < first - 0.1 and hits == 0
    math.write_text(source)
    assert run_copy(tmp_path) == (first, 1)  # what was compiled before the edit is still there


@pytest.mark.slow
def test_the_places_are_numbas(run_copy: Run, tmp_path: Path) -> None:
    """The folder that the user names; else beside the file; else the user's cache folder."""
    copy = copy_package(tmp_path)
    named = tmp_path / "named"
    run_copy(tmp_path, NUMBA_CACHE_DIR=str(named))
    assert list(named.glob(f"ops_*/{kernel_cache.PREFIX}*/cpu_volume.*.nbc"))
    beside = copy / "ops" / "__pycache__"
    assert not list(beside.glob(kernel_cache.PREFIX + "*"))
    shutil.rmtree(beside, ignore_errors=True)
    beside.write_text("a file in the place of the folder, so that nobody can write there")
    run_copy(tmp_path, XDG_CACHE_HOME=str(tmp_path / "user"))
    assert list((tmp_path / "user").glob(f"numba/ops_*/{kernel_cache.PREFIX}*/cpu_volume.*.nbc"))


def test_every_file_of_kernels_counts_and_takes_njit_from_one_place() -> None:
    counted = set(kernel_cache.kernel_files(kernel_cache.PACKAGE))
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        if "@njit" in text:
            assert path in counted
            assert re.search(r"from plnerf\.ops\.kernel_cache import .*\bnjit\b", text), path
    assert PACKAGE / "ops" / "grid.py" in counted


def test_importing_the_package_loads_no_numba() -> None:
    code = "import sys, plnerf; print(sorted({'numba', 'torch'} & set(sys.modules)))"
    found = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert found.stdout.strip() == "[]"
