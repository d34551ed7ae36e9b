"""The house: imports go downwards, in no circle; files stay short; the way to the rendering sum is short."""

import ast
import inspect
import re
import sys
import tempfile
from functools import cache
from pathlib import Path
from traceback import walk_stack
from types import FrameType

import pytest

from plnerf.cli.main import main
from plnerf.render import model, ray_ops

SOURCE = Path(__file__).resolve().parent.parent / "src" / "plnerf"
FLOORS = {
    "errors": 0,
    "findings": 0,
    "terminal": 0,
    "progress_lines": 0,
    "ops": 1,
    "scene": 1,
    "rays": 2,
    "capture": 2,
    "line": 2,
    "detect": 3,
    "field": 3,
    "mechanics": 3,
    "render": 4,
    "train": 5,
    "presets": 6,
    "synth": 6,
    "survey": 6,
    "export": 7,
    "change": 7,
    "report": 7,
    "score": 7,
    "doctor": 7,
    "view": 8,
    "pipeline": 8,
    "exporting": 8,
    "console": 8,
    "bench": 9,
    "corridor": 9,
    "reconstruct": 9,
    "cli": 10,
    "__main__": 11,
}
MAX_LINES = 400
MAX_CALLS = 6
"""From the entry point of the command line to the rendering sum, on the path that runs.

What `cli/` calls to parse the arguments counts as the entry point.
"""

FILES = sorted(path for path in SOURCE.rglob("*.py") if "data" not in path.relative_to(SOURCE).parts)
MODULES = {".".join(("plnerf", *path.relative_to(SOURCE).with_suffix("").parts)): path for path in FILES}


def imports(path: Path) -> set[str]:
    """The plnerf modules that a file imports, at its top or inside of a function."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            submodules = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {name if name in MODULES else str(node.module) for name in submodules}
    return {name for name in found if name.split(".")[0] == "plnerf"}


def room(module: str) -> str:
    return module.split(".")[1]


@cache
def graph() -> dict[str, set[str]]:
    """The modules that each one imports; every worker collects these tests, and one needs it."""
    return {module: imports(path) for module, path in MODULES.items()}


def test_every_room_has_its_floor() -> None:
    rooms = {room(module) for module in MODULES if module != "plnerf.__init__"}
    assert rooms <= FLOORS.keys()


@pytest.mark.parametrize("module", [module for module in MODULES if not module.endswith("__init__")])
def test_imports_go_downwards(module: str) -> None:
    mine = FLOORS[room(module)]
    for other in graph()[module] - {"plnerf"}:
        below = FLOORS[room(other)] < mine
        assert below or room(other) == room(module), f"{module} (floor {mine}) imports {other}"


def test_packages_import_nothing() -> None:
    """So that `plnerf --help` loads none of the rooms."""
    for module, path in MODULES.items():
        if path.name == "__init__.py":
            assert not graph()[module], module


def test_no_circles() -> None:
    """By taking away, again and again, the modules that import none of those left."""
    left = {module: {other for other in others if other in MODULES} for module, others in graph().items()}
    while free := {module for module, others in left.items() if not others & left.keys()}:
        left = {module: others for module, others in left.items() if module not in free}
    assert not left, f"imports in a circle among {sorted(left)}"


def test_files_are_short() -> None:
    lengths = {str(path.relative_to(SOURCE)): len(path.read_text().splitlines()) for path in FILES}
    assert {name: length for name, length in lengths.items() if length > MAX_LINES} == {}


def stack_at_the_rendering_sum(
    backend: str, scene: Path, out: Path, monkeypatch: pytest.MonkeyPatch
) -> list[str]:
    """Functions of plnerf from the entry point to the rendering sum in one training step; empty without one.

    Runs `plnerf train` in this process.  Calls of other packages on the way do not count.
    """
    steps = ["--steps", "1", "--device", "cpu", "--backend", backend]
    monkeypatch.setattr(sys, "argv", ["plnerf", "train", str(scene), "--out", str(out), *steps])
    code = inspect.unwrap(ray_ops.ray_ops(backend).render_rays).__code__  # type: ignore[arg-type]
    stack: list[str] = []

    def on_event(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and not stack and frame.f_code is code:
            codes = [each.f_code for each, _ in walk_stack(frame)]
            own = [each for each in codes if Path(each.co_filename).is_relative_to(SOURCE)]
            stack.extend(dict.fromkeys(f"{each.co_filename}:{each.co_qualname}" for each in own[::-1]))

    sys.setprofile(on_event)
    try:
        main()
    finally:
        sys.setprofile(None)
    return stack


@pytest.mark.parametrize("backend", ["torch", "numba"])
def test_the_way_from_the_command_line_to_the_rendering_sum_is_short(
    backend: str, tiny_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stack = stack_at_the_rendering_sum(backend, tiny_scene, tmp_path / "run", monkeypatch)
    assert stack and stack[0].endswith("main.py:main") and stack[-1].endswith(":render_rays"), stack
    subcommand = max(i for i, name in enumerate(stack) if Path(name).parent == SOURCE / "cli")
    assert len(stack[subcommand:]) <= MAX_CALLS, stack


def test_without_the_rendering_sum_nothing_is_trained(
    tiny_scene: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """So that the test above follows the sum that training really uses."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))  # for the crash report
    without = ray_ops.TORCH._replace(render_rays=None)  # type: ignore[arg-type]
    monkeypatch.setattr(model, "ray_ops", lambda backend: without)
    with pytest.raises(SystemExit) as ended:
        stack_at_the_rendering_sum("torch", tiny_scene, tmp_path / "run", monkeypatch)
    assert ended.value.code == 70 and "'NoneType' object is not callable" in capsys.readouterr().err


FRAME_INTERNALS = re.compile(
    r"R_scene_world|R_line_world|\bframes?\.scale\b|scene_per_unit|shift_world|origin_world|\._per_unit\b"
)
CHANGE_FRAMES = {"scene/transforms.py", "scene/orientation.py", "line/frame.py", "line/files.py"}
"""Where frames change; where they are chosen; and where they are written."""


def test_frames_change_in_two_files() -> None:
    found = {
        str(path.relative_to(SOURCE)): sorted(set(FRAME_INTERNALS.findall(path.read_text("utf-8"))))
        for path in FILES
    }
    assert {name: what for name, what in found.items() if what and name not in CHANGE_FRAMES} == {}
