"""Settings changed by short texts, path.to.key=JSON, and the same as options of the command line."""

import json
from collections.abc import Sequence
from typing import Any, TypeVar

from plnerf.train.settings import from_json, to_json

T = TypeVar("T")


def changed(settings: T, assignments: Sequence[str]) -> T:
    """Settings with some values replaced; an item of a tuple has its index as key."""
    data = to_json(settings)
    for path, value in map(_parts, assignments):
        place: Any = data
        for key in path[:-1]:
            place = place[int(key) if isinstance(place, list) else key]
        last = path[-1]
        place[int(last) if isinstance(place, list) else last] = value
    return from_json(type(settings), data, "the test's settings")


def options(assignments: Sequence[str]) -> list[str]:
    """The command line's options for the same, of two alike the later."""
    words: list[str] = []
    later = {tuple(path): value for path, value in map(_parts, assignments)}
    for path, value in later.items():
        name = ".".join(path).replace("_", "-")
        if isinstance(value, bool):
            head, _, last = name.rpartition(".")
            words.append(f"--{name}" if value else f"--{head}.no-{last}")
        else:
            words += [f"--{name}", *(map(str, value) if isinstance(value, list) else [str(value)])]
    return words


def _parts(assignment: str) -> tuple[list[str], Any]:
    path, _, text = assignment.partition("=")
    try:
        return path.strip().split("."), json.loads(text)
    except json.JSONDecodeError:
        return path.strip().split("."), text.strip()
