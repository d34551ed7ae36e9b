"""The library's face: every name is there, whatever was imported before, and importing it is quick."""

import ast
import statistics
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

import pytest

import plnerf


def test_every_name_is_there_after_every_module_was_imported() -> None:
    """A submodule of the same name as a function would hide it."""
    for module in walk_packages(plnerf.__path__, "plnerf."):
        import_module(module.name)
    for name in plnerf.__all__:
        found = getattr(plnerf, name)
        assert callable(found), name
        assert found.__name__ == name


def test_the_stub_offers_the_same_names() -> None:
    stub = ast.parse(Path(plnerf.__file__).with_suffix(".pyi").read_text())
    offered = {
        (alias.asname, node.module)
        for node in stub.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert {name for name, _ in offered} == set(plnerf.__all__)
    for name, module in offered:
        assert getattr(import_module(str(module)), str(name)) is getattr(plnerf, str(name))


def test_dir_lists_them_and_others_are_refused() -> None:
    assert set(plnerf.__all__) <= set(dir(plnerf))
    with pytest.raises(AttributeError, match="has no attribute 'train_scenes'"):
        _ = plnerf.train_scenes


def test_importing_it_is_quick() -> None:
    """Processor time of the import alone: the interpreter's start is not counted."""
    code = "import time\nt = time.process_time()\nimport plnerf\nprint(time.process_time() - t)"
    taken = [
        float(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout)
        for _ in range(3)
    ]
    assert statistics.median(taken) < 0.2
