"""Structure of a checkout of plnerf in figures: size, reach, constants, classes of a wire, depth of calls.

    python benchmarks/house.py [--root CHECKOUT] [--json OUT] [--trace]
    python benchmarks/house.py --same RUN_A RUN_B

Needs the standard library only; `--trace` runs one training step and `--same` reads checkpoints, with what
plnerf needs for these.  The rules of counting hold for any layout:

- Reach: the files that the survey's run module imports, directly or through others, at the top of a file or
  in a function; without `__init__.py` and without modules whose names are made at run time.
- Classes reached: class statements in these files, nested ones included.
- Constants: names bound to a number by an assignment at the top level of a module.  A number is an int or a
  float, negative, or arithmetic of literals; a bool is none.  `A, B = 1, 2` binds two.  Names bound to a
  tuple of numbers count apart.  Fields of settings stand in classes and do not count.
- Classes of a wire: class statements with a name in WIRE_CLASSES outside of ops/, render/, rays/, train/ and
  export/ (whose Line is a polyline of a drawing).
- Repeated names: names of Python files that occur more than once; without `__init__.py`.
- Calls to the rendering sum: calls on the stack of a real training step, from the subcommand's function to
  the innermost one named in RENDERING_SUM.  Functions of other packages (tyro, torch) do not count, nor does
  the entry point, which parses the arguments.
"""

import argparse
import ast
import contextlib
import hashlib
import importlib
import json
import sys
import tempfile
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from traceback import walk_stack
from types import FrameType
from typing import Any

PACKAGE = "plnerf"
SURVEY_MODULES = ("survey/run.py", "survey/run_survey.py")
"""The survey's run module; the first that exists."""
WIRE_CLASSES = (
    "Base", "Catenary", "CatenaryFit", "Conductor", "Curve", "Fit", "Line", "Refined", "Refit", "Track",
    "TrueWire", "Wire",
)  # fmt: skip
NO_WIRES = {"ops", "render", "rays", "train", "export"}
"""Rooms whose classes of these names hold something else."""
SETTINGS_SUFFIXES = ("Config", "Settings", "Weights")
RENDERING_SUM = {"render_rays", "composite"}
"""Functions of render/ and ops/ that sum colours along rays."""
CALLS = "calls to the rendering sum"

Trees = dict[Path, ast.Module]


def parse(src: Path) -> Trees:
    """The syntax tree of every Python file, by its path relative to src."""
    files = sorted(src.rglob("*.py"))
    return {path.relative_to(src): ast.parse(path.read_text(encoding="utf-8")) for path in files}


def imported_names(tree: ast.Module) -> set[str]:
    """Dotted names that a file imports; of `from a import b` both a and a.b, since b may be a module."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            found |= {str(node.module)} | {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def reached_files(trees: Trees, start: Path) -> set[Path]:
    """The files of the package that `start` imports, directly or through others, and itself."""
    modules = {".".join(path.with_suffix("").parts): path for path in trees if path.name != "__init__.py"}
    reached, waiting = set(), [start]
    while waiting:
        path = waiting.pop()
        if path not in reached:
            reached.add(path)
            waiting += [modules[name] for name in imported_names(trees[path]) & modules.keys()]
    return reached


def is_number(node: ast.expr | None) -> bool:
    """True for an int or float literal and for arithmetic of such."""
    match node:
        case ast.Constant(value):
            return type(value) in {int, float}
        case ast.UnaryOp(operand=operand):
            return is_number(operand)
        case ast.BinOp(left=left, right=right):
            return is_number(left) and is_number(right)
    return False


def bound_values(tree: ast.Module) -> Iterator[ast.expr | None]:
    """The value of every name that is assigned at the top level of a module."""
    for node in tree.body:
        if isinstance(node, ast.AnnAssign):
            yield node.value
        elif isinstance(node, ast.Assign):
            for target in node.targets:
                apart = isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple)
                yield from node.value.elts if apart else [node.value]


def count_constants(trees: Trees) -> dict[str, dict[str, int]]:
    """Names bound to numbers, and to tuples of numbers, in each room that has any."""
    numbers: Counter[str] = Counter()
    tuples: Counter[str] = Counter()
    for path, tree in trees.items():
        room = path.parts[1].removesuffix(".py")
        for value in bound_values(tree):
            numbers[room] += is_number(value)
            tuples[room] += isinstance(value, ast.Tuple) and set(map(is_number, value.elts)) == {True}
    rooms = sorted(room for room in numbers | tuples if numbers[room] + tuples[room])
    return {room: {"numbers": numbers[room], "tuples": tuples[room]} for room in rooms}


def classes(tree: ast.AST) -> list[ast.ClassDef]:
    """Every class statement, nested ones included."""
    return [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]


def wire_classes(trees: Trees, names: set[str]) -> list[str]:
    """`file: name` of every class statement that holds a wire."""
    files = {path: tree for path, tree in trees.items() if not NO_WIRES & set(path.parts)}
    return [f"{p}: {node.name}" for p, tree in files.items() for node in classes(tree) if node.name in names]


def repeated_file_names(trees: Trees) -> list[str]:
    """File names that occur more than once."""
    counts = Counter(path.name for path in trees if path.name != "__init__.py")
    return sorted(name for name, count in counts.items() if count > 1)


def is_settings(node: ast.ClassDef) -> bool:
    """True for a frozen dataclass named as settings are."""
    return node.name.endswith(SETTINGS_SUFFIXES) and any(
        isinstance(call, ast.Call)
        and ast.unparse(call.func).endswith("dataclass")
        and any(keyword.arg == "frozen" and ast.unparse(keyword.value) == "True" for keyword in call.keywords)
        for call in node.decorator_list
    )


def reads(node: ast.AST, types: dict[str, str]) -> Iterator[tuple[ast.AST, str, str]]:
    """(node, attribute, class that it is read of) of every read below a node; "" for a class not known.

    `types` has the classes of names in scope: of `self`, and of arguments as they are annotated.  A getattr
    of a computed name reads every string of its function.
    """
    if isinstance(node, ast.ClassDef):
        types = types | {"self": node.name}
    elif isinstance(node, ast.FunctionDef):
        given = [a for a in (*node.args.args, *node.args.kwonlyargs) if a.annotation is not None]
        types = types | {a.arg: ast.unparse(a.annotation or a).removesuffix(" | None") for a in given}
        computed = [
            part for part in ast.walk(node)
            if isinstance(part, ast.Call) and isinstance(part.func, ast.Name) and part.func.id == "getattr"
        ]  # fmt: skip
        strings = {str(part.value) for part in ast.walk(node) if computed and isinstance(part, ast.Constant)}
        for a in given:
            if any(isinstance(part.args[0], ast.Name) and part.args[0].id == a.arg for part in computed):
                yield from ((node, name, types[a.arg]) for name in strings)
    elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load):
        yield node, node.attr, types.get(node.value.id, "") if isinstance(node.value, ast.Name) else ""
    for child in ast.iter_child_nodes(node):
        yield from reads(child, types)


def unread_settings(src: Path) -> list[str]:
    """`file: Class.field` of every field of a frozen settings dataclass that nothing in src reads.

    A field is read where an attribute of its name is, outside of the class statement, of the class, its bases
    or its heirs, or of what no annotation of an argument gives a class of the package; or in a method of its
    own that is itself read so.  Checks in `__post_init__` are no reads.
    """
    trees = parse(src)
    statements = [(path, node) for path, tree in trees.items() for node in classes(tree)]
    bases = {node.name: set(map(ast.unparse, node.bases)) for _, node in statements}
    all_reads = [read for tree in trees.values() for read in reads(tree, {})]
    counts = Counter((name, of) for _, name, of in all_reads)
    of_node = defaultdict[int, list[tuple[str, str]]](list)
    for node, name, of in all_reads:
        of_node[id(node)].append((name, of))
    unread = []
    for path, owner in statements:
        if not is_settings(owner):
            continue
        strangers = {n for n in bases if owner.name not in bases[n] | {n} and n not in bases[owner.name]}
        inside = Counter(one for node in ast.walk(owner) for one in of_node.get(id(node), ()))
        read = {one[0] for one, times in counts.items() if one[1] not in strangers and times > inside[one]}
        methods = [node for node in owner.body if isinstance(node, ast.FunctionDef)]
        own = {node.name: {name for _, name, _ in reads(node, {})} for node in methods}
        while more := {name for method in own.keys() & read for name in own[method]} - read:
            read |= more
        fields = [ast.unparse(node.target) for node in owner.body if isinstance(node, ast.AnnAssign)]
        unread += [f"{path}: {owner.name}.{field}" for field in fields if field not in read]
    return unread


def trace_calls(root: Path) -> list[str]:
    """The functions on the stack at the rendering sum of one training step, from the entry point inwards.

    Runs `plnerf train` in this process, from the sources of the checkout, on its bundled span at an eighth
    of the size.
    """
    package = root / "src" / PACKAGE
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    module, name = project["scripts"][PACKAGE].split(":")
    sys.path.insert(0, str(root / "src"))
    main = getattr(importlib.import_module(module), name)
    loaded = Path(str(sys.modules[PACKAGE].__file__))
    if not loaded.is_relative_to(package):
        raise SystemExit(f"{PACKAGE} was loaded from {loaded.parent}, not from {package}.")
    scene = next(package.rglob("span/transforms.json")).parent
    stack: list[str] = []
    sum_frame: FrameType | None = None  # the outermost function of the first sum; the innermost is wanted

    def on_event(frame: FrameType, event: str, _: object) -> None:
        nonlocal sum_frame, stack
        if frame is sum_frame and event == "return":
            sys.setprofile(None)
        if event == "call" and frame.f_code.co_name in RENDERING_SUM:
            codes = [f.f_code for f, _ in walk_stack(frame)][::-1]
            ours = [(Path(code.co_filename), code.co_qualname) for code in codes]
            ours = [(path.relative_to(package), name) for path, name in ours if path.is_relative_to(package)]
            if ours[-1][0].parts[0] in {"render", "ops"}:
                sum_frame = sum_frame or frame
                stack = [f"{path}:{name}" for path, name in ours]

    with tempfile.TemporaryDirectory() as out, contextlib.redirect_stdout(sys.stderr):
        sys.argv = [PACKAGE, "train", str(scene), "--out", out, "--steps", "1", "--downscale", "8"]
        sys.setprofile(on_event)
        try:
            main()
        finally:
            sys.setprofile(None)
    if not stack:
        raise SystemExit(f"One training step called none of {', '.join(sorted(RENDERING_SUM))}.")
    return stack


def model_tensors(run: Path) -> dict[str, Any]:
    """The `model.*` arrays of a run's newest checkpoint, in order of their names."""
    from safetensors.numpy import load_file

    found = list((run / "checkpoints").glob("step-*.safetensors"))
    if not found:
        raise SystemExit(f"{run} holds no checkpoints/step-N.safetensors.")
    tensors = load_file(max(found, key=lambda path: int(path.stem.removeprefix("step-"))))
    return {name: tensors[name] for name in sorted(tensors) if name.startswith("model.")}


def same_runs(run_a: Path, run_b: Path) -> bool:
    """Prints the SHA-256 of two runs' model tensors (names and bytes), and what differs; True where equal."""
    a, b = model_tensors(run_a), model_tensors(run_b)
    hashes = []
    for run, tensors in ((run_a, a), (run_b, b)):
        content = b"".join(name.encode() + array.tobytes() for name, array in tensors.items())
        hashes.append(hashlib.sha256(content).hexdigest())
        print(f"{hashes[-1]}  {run} ({len(tensors)} tensors)")
    equal = hashes[0] == hashes[1]
    print("equal" if equal else "different; largest absolute differences:")
    for name in () if equal else sorted(a.keys() | b.keys()):
        shapes = [tensors[name].shape if name in tensors else None for tensors in (a, b)]
        if shapes[0] == shapes[1]:
            print(f"  {name}: {abs(a[name].astype(float) - b[name]).max(initial=0.0):.3g}")
        else:
            print(f"  {name}: shapes {shapes[0]} and {shapes[1]}")
    return equal


def measure(root: Path, wire_names: set[str]) -> dict[str, Any]:
    """All figures that need no run."""
    src = root / "src"
    trees = parse(src)
    start = next(Path(PACKAGE, name) for name in SURVEY_MODULES if Path(PACKAGE, name) in trees)
    reached = reached_files(trees, start)
    return {
        "files": len(trees),
        "lines": sum(len((src / path).read_text(encoding="utf-8").splitlines()) for path in trees),
        "files reached by the survey": len(reached),
        "classes reached by the survey": sum(len(classes(trees[path])) for path in reached),
        "constants": count_constants(trees),
        "classes of a wire": wire_classes(trees, wire_names),
        "repeated file names": repeated_file_names(trees),
        "unread settings": unread_settings(src),
    }


def markdown(figures: dict[str, Any]) -> str:
    """A table of the figures, and below it the lists behind them."""
    rows, lists = [], []
    for name, value in figures.items():
        if name == "constants":
            rooms = sorted(value, key=lambda room: -value[room]["numbers"])
            rows.append((name, sum(room["numbers"] for room in value.values())))
            rows.append(("constants that are tuples", sum(room["tuples"] for room in value.values())))
            rows += [(f"constants in {room}/", value[room]["numbers"]) for room in rooms]
        elif name == CALLS:
            rows.append((name, len(value) - 2))  # without the entry point; n functions are n - 1 calls
        else:
            rows.append((name, value if isinstance(value, int) else len(value)))
        if isinstance(value, list):
            lists += ["", f"{name[0].upper()}{name[1:]}:", "", *(f"- {item}" for item in value or ["none"])]
    return "\n".join(["| | |", "| --- | ---: |", *(f"| {name} | {n:,} |" for name, n in rows), *lists])


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", maxsplit=1)[0])
    parser.add_argument("--root", type=Path, default=Path(__file__).parent.parent, help="a checkout")
    parser.add_argument("--json", type=Path, help="write the figures here")
    parser.add_argument("--trace", action="store_true", help="count the calls of a real training step")
    parser.add_argument("--wire", action="append", default=[], help="one more name of a class of a wire")
    parser.add_argument("--same", type=Path, nargs=2, metavar="RUN", help="compare the models of two runs")
    arguments = parser.parse_args()
    if arguments.same:
        return 0 if same_runs(*arguments.same) else 1
    root = arguments.root.resolve()
    figures = measure(root, {*WIRE_CLASSES, *arguments.wire})
    if arguments.trace:
        figures[CALLS] = trace_calls(root)
    print(markdown(figures))
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
