"""The house: imports go downwards, in no circle; files stay short; the way to the rendering sum is short."""

import ast
from itertools import pairwise
from pathlib import Path

import pytest

SOURCE = Path(__file__).resolve().parent.parent / "src" / "plnerf"
FLOORS = {
    "errors": 0,
    "findings": 0,
    "ops": 1,
    "scene": 1,
    "rays": 2,
    "capture": 2,
    "line": 2,
    "detect": 2.5,
    "field": 3,
    "render": 4,
    "train": 5,
    "presets": 6,
    "synth": 6,
    "survey": 6,
    "export": 6,
    "report": 6,
    "score": 7,
    "doctor": 7,
    "pipeline": 8,
    "reconstruct": 8.5,
    "bench": 9,
    "cli": 10,
}
MAX_LINES = 400
# From the command line to the rendering sum: (file, function, the name by which it calls the next one).
CHAIN = [
    ("cli/main.py", "train", "train_scene"),
    ("pipeline.py", "train_scene", "train"),
    ("train/loop.py", "train", "Training"),
    ("train/step.py", "Training.step", "model"),  # calling a module runs its forward
    ("render/model.py", "PLNeRF.forward", "composite"),
    ("render/volume.py", "composite", None),
]
MAX_HOPS = 5

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


GRAPH = {module: imports(path) for module, path in MODULES.items()}


def test_every_room_has_its_floor() -> None:
    rooms = {room(module) for module in MODULES if module != "plnerf.__init__"}
    assert rooms <= FLOORS.keys()


@pytest.mark.parametrize("module", [module for module in MODULES if not module.endswith("__init__")])
def test_imports_go_downwards(module: str) -> None:
    mine = FLOORS[room(module)]
    for other in GRAPH[module] - {"plnerf"}:
        below = FLOORS[room(other)] <= mine
        assert below or room(other) == room(module), f"{module} (floor {mine}) imports {other}"


def test_packages_import_nothing() -> None:
    """So that `plnerf --help` loads none of the rooms."""
    for module, path in MODULES.items():
        if path.name == "__init__.py":
            assert not GRAPH[module], module


def test_no_circles() -> None:
    """By taking away, again and again, the modules that import none of those left."""
    left = {module: {other for other in others if other in MODULES} for module, others in GRAPH.items()}
    while free := {module for module, others in left.items() if not others & left.keys()}:
        left = {module: others for module, others in left.items() if module not in free}
    assert not left, f"imports in a circle among {sorted(left)}"


def test_files_are_short() -> None:
    lengths = {str(path.relative_to(SOURCE)): len(path.read_text().splitlines()) for path in FILES}
    assert {name: length for name, length in lengths.items() if length > MAX_LINES} == {}


def function(path: Path, name: str) -> ast.FunctionDef:
    body: list[ast.stmt] = ast.parse(path.read_text(encoding="utf-8")).body
    for part in name.split("."):
        (node,) = [n for n in body if isinstance(n, ast.FunctionDef | ast.ClassDef) and n.name == part]
        body = node.body
    assert isinstance(node, ast.FunctionDef)
    return node


def bases(path: Path, name: str) -> set[str]:
    """What a class is a kind of; nothing for a function."""
    nodes = [n for n in ast.parse(path.read_text()).body if isinstance(n, ast.ClassDef) and n.name == name]
    return {base.id for node in nodes for base in node.bases if isinstance(base, ast.Name)}


def all_imported(tree: ast.Module) -> set[str]:
    return {alias.name for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) for alias in n.names}


def test_the_way_from_the_command_line_to_the_rendering_sum_is_short() -> None:
    assert len(CHAIN) - 1 <= MAX_HOPS
    for (file, name, calls), (next_file, next_name, _) in pairwise(CHAIN):
        node = function(SOURCE / file, name)
        called = {
            n.func.id for n in ast.walk(node) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)
        }
        assert calls in called, f"{file}:{name} does not call {calls}"
        next_module = "plnerf." + next_file.removesuffix(".py").replace("/", ".")
        owner = next_name.split(".", maxsplit=1)[0]
        tree = ast.parse((SOURCE / file).read_text(encoding="utf-8"))
        imported = {
            alias.name
            for n in ast.walk(tree)
            if isinstance(n, ast.ImportFrom) and n.module == next_module
            for alias in n.names
        }
        assert owner in imported or bases(SOURCE / next_file, owner) & all_imported(tree), (
            f"{file} does not import {owner} from {next_module}, nor what it is a kind of"
        )
    function(SOURCE / CHAIN[-1][0], CHAIN[-1][1])
