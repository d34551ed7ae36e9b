"""The rules by which a checkout's structure is counted, and that every setting is read."""

import ast
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from safetensors.numpy import save_file
from tests.conftest import ROOT


def load() -> ModuleType:
    spec = importlib.util.spec_from_file_location("house", ROOT / "benchmarks" / "house.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["house"] = module
    spec.loader.exec_module(module)
    return module


house = load()


def write(src: Path, **files: str) -> Path:
    """A package of a few files; `__` in a name stands for a folder."""
    for name, text in files.items():
        path = src / "plnerf" / (name.replace("__", "/") + ".py")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return src


@pytest.mark.slow
def test_every_setting_of_the_package_is_read() -> None:
    assert house.unread_settings(ROOT / "src") == []


SETTINGS = """
from dataclasses import dataclass

@dataclass(frozen=True)
class FitSettings:
    width_px: float = 3.0
    height_px: float = 3.0

    def __post_init__(self):
        if self.height_px < 0:
            raise ValueError

    @property
    def half_px(self):
        return self.height_px / 2
"""


@pytest.mark.parametrize(
    ("user", "unread"),
    [
        ("", {"width_px", "height_px"}),
        ("settings.width_px = settings.height_px", {"width_px"}),  # written, not read
        ("print(settings.width_px, settings.half_px)", set()),
        ("class Other:\n    def f(self): return self.width_px + self.height_px", {"width_px", "height_px"}),
        ("class Heir(FitSettings):\n    def f(self): return self.width_px", {"height_px"}),
        ("class Other: ...\ndef f(s: Other): return s.width_px + s.height_px", {"width_px", "height_px"}),
        ("def f(s: FitSettings | None): return s.width_px, s.part.height_px", set()),
        ("def f(s: FitSettings): return [getattr(s, k) for k in ('width_px',)]", {"height_px"}),
        (
            "class Fit: ...\ndef f(s: Fit): return [getattr(s, k) for k in ('width_px',)]",
            {"width_px", "height_px"},
        ),
    ],
)
def test_a_setting_that_nothing_reads_is_listed(tmp_path: Path, user: str, unread: set[str]) -> None:
    src = write(tmp_path, line__fit=SETTINGS, line__user=user)
    assert house.unread_settings(src) == [
        f"plnerf/line/fit.py: FitSettings.{name}" for name in ("width_px", "height_px") if name in unread
    ]


def test_only_frozen_dataclasses_are_settings(tmp_path: Path) -> None:
    for changed in ("@dataclass", "@dataclass(frozen=False)"):
        assert (
            house.unread_settings(write(tmp_path, fit=SETTINGS.replace("@dataclass(frozen=True)", changed)))
            == []
        )
    assert house.unread_settings(write(tmp_path, fit=SETTINGS.replace("FitSettings", "Fit"))) == []


@pytest.mark.parametrize(
    ("text", "numbers", "tuples"),
    [
        ("A = 1", 1, 0),
        ("A: float = -2.5e-3", 1, 0),
        ("A, B = 60 * 60, 'm'", 1, 0),
        ("A = B = 2**19", 2, 0),
        ("A = (1, -2.0)", 0, 1),
        ("A, B = (1, 2), ()", 0, 1),
        ("A = True\nB = 1j\nC = '1'\nD = float('inf')\nE: int", 0, 0),
        ("class Settings:\n    a: int = 1", 0, 0),
    ],
)
def test_names_bound_to_numbers_are_constants(text: str, numbers: int, tuples: int) -> None:
    counts = house.count_constants({Path("plnerf/survey/fit.py"): ast.parse(text)})
    assert counts == ({"survey": {"numbers": numbers, "tuples": tuples}} if numbers + tuples else {})


def test_reach_follows_imports_of_modules_and_of_names_in_functions(tmp_path: Path) -> None:
    src = write(
        tmp_path,
        survey__run="import math\nfrom plnerf.line import wire\ndef f():\n    from plnerf.scene.io import g",
        line__wire="import plnerf.errors",
        line____init__="from plnerf.unused import x",
        scene__io="from plnerf.survey.run import f",  # in a circle
        errors="",
        unused="",
    )
    reached = house.reached_files(house.parse(src), Path("plnerf/survey/run.py"))
    assert {str(path.relative_to("plnerf")) for path in reached} == {
        "survey/run.py", "line/wire.py", "scene/io.py", "errors.py"
    }  # fmt: skip


def test_classes_of_a_wire_are_counted_where_they_may_hold_one(tmp_path: Path) -> None:
    text = "class Wire: ...\nclass Wires: ...\nclass Outer:\n    class Fit: ..."
    trees = house.parse(write(tmp_path, line__a=text, ops__b=text, survey__export__c=text))
    assert house.wire_classes(trees, set(house.WIRE_CLASSES)) == [
        "plnerf/line/a.py: Wire", "plnerf/line/a.py: Fit"
    ]  # fmt: skip


def save_run(run: Path, step: int, **tensors: np.ndarray) -> Path:
    folder = run / "checkpoints"
    folder.mkdir(parents=True, exist_ok=True)
    save_file(
        {name.replace("__", "."): array for name, array in tensors.items()},
        folder / f"step-{step}.safetensors",
    )
    return run


def test_runs_are_the_same_where_their_newest_models_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    weights, other = np.arange(3, dtype=np.float32), np.array([0, 1.5, 2], np.float32)
    a = save_run(tmp_path / "a", 900, model__w=other)
    save_run(a, 1000, model__w=weights, adam__w=weights)
    b = save_run(tmp_path / "b", 10, model__w=weights, adam__w=other)
    assert house.same_runs(a, b)
    c = save_run(tmp_path / "c", 10, model__w=other, model__new=other)
    capsys.readouterr()
    assert not house.same_runs(a, c)
    out = capsys.readouterr().out
    assert "model.w: 0.5\n" in out
    assert "model.new: shapes None and (3,)\n" in out
