"""Every example runs as its docstring says, on small inputs, and leaves what it promises."""

import os
import re
import runpy
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.conftest import ROOT

EXAMPLES = ROOT / "examples"
Run = Callable[..., str]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs an example as `python examples/NAME.py ARGUMENTS` would, in this process; gives what it prints.

    A process of its own would import everything anew, some seconds each: one test has it.
    """

    def of(name: str, *arguments: str | Path) -> str:
        script = path_of(name)
        monkeypatch.setattr(sys, "argv", [str(script), *map(str, arguments)])
        monkeypatch.setattr(sys, "path", [str(EXAMPLES), *sys.path])
        runpy.run_path(str(script), run_name="__main__")
        return capsys.readouterr().out

    return of


def path_of(name: str) -> Path:
    (script,) = EXAMPLES.glob(f"{name}_*.py")
    return script


def test_each_has_a_test_and_says_how_it_is_run() -> None:
    numbers = sorted(path.name[:2] for path in EXAMPLES.glob("[0-9]*.py"))
    tested = set(re.findall(r'\brun\("(\d\d)"', Path(__file__).read_text()))
    assert numbers == sorted(tested)
    for path in EXAMPLES.glob("[0-9]*.py"):
        assert f"python examples/{path.name} " in path.read_text()


def test_00_poses_as_a_colmap_model(tiny_scene: Path, tmp_path: Path, run: Run) -> None:
    assert "12 cameras" in run("00", tiny_scene, tmp_path / "colmap")
    assert (tmp_path / "colmap" / "sparse" / "0" / "images.bin").is_file()


@pytest.mark.slow
def test_01_one_image(tmp_path: Path, run: Run) -> None:
    said = run("01", tmp_path / "image.png", "--quick")
    assert float(re.findall(r"([\d.]+) dB with", said)[0]) > 20
    assert (tmp_path / "image.png").is_file()


@pytest.mark.slow
def test_02_a_nerf_of_ones_own(tmp_path: Path, run: Run) -> None:
    said = run("02", tmp_path / "view.png", "--quick")
    assert float(re.findall(r": ([\d.]+) dB; rendered", said)[0]) > 12
    assert (tmp_path / "view.png").is_file()


@pytest.mark.slow
def test_03_and_04_a_run_is_trained_rendered_and_asked(tmp_path: Path, run: Run) -> None:
    said = run("03", tmp_path / "run", "--quick")
    assert "held-out views: " in said and len(list((tmp_path / "run/renders/path/rgb").iterdir())) == 2
    assert "1/m" in run("04", tmp_path / "run", tmp_path / "asked")
    assert {path.name for path in (tmp_path / "asked").iterdir()} == {"density.npz", "view.png"}


def test_an_example_is_a_script(tiny_scene: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(path_of("00")), str(tiny_scene), str(tmp_path / "colmap")],
        env={**os.environ, "OMP_WAIT_POLICY": "PASSIVE"}, text=True, capture_output=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "12 cameras" in done.stdout


@pytest.mark.slow
def test_05_wires_without_training(tmp_path: Path, run: Run) -> None:
    assert f"report: {tmp_path}/report.html" in run("05", tmp_path, "--quick", "--voltage-kv", "230")


def test_06_a_cloud(tmp_path: Path, run: Run) -> None:
    said = run("06", tmp_path)
    assert "3 structures, 6 wires" in said and said.count(" ± ") == 6
    assert (tmp_path / "report.html").is_file() and (tmp_path / "conductors.csv").is_file()


@pytest.mark.slow
def test_07_photos_to_a_report(tmp_path: Path, run: Run) -> None:
    said = run("07", tmp_path, tmp_path / "out", "--quick")
    assert f"report: {tmp_path}/out/survey/report.html" in said
