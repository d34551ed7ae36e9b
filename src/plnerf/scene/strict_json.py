"""JSON files read strictly: UTF-8, whole, no deeper and no larger than plnerf's own ever are.

Python's reader takes NaN, infinity, numbers of any length and a key that is there twice; each of these would
end in a traceback or a wrong value far away from the file.
"""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from plnerf.errors import PlnerfError

MAX_BYTES, MAX_DEPTH, MAX_DIGITS = 512 << 20, 32, 40
"""Of a file; of lists and objects within each other; of a number as it is written."""
_TEXTS = re.compile(rb'"(?:[^"\\]|\\.)*"', re.DOTALL)


class _Refused(ValueError):
    """What JSON allows and no file of plnerf holds."""


def read_json(path: Path, error: type[PlnerfError], do: str = "Write the file again.") -> Any:
    """The value that a JSON file holds.  A byte order mark at its beginning is passed over.

    error: what is raised where the file is absent or unreadable, no JSON, deeper than `MAX_DEPTH`, or holds a
    number that is not finite or longer than `MAX_DIGITS`, or a key twice.  do: what the error tells to do.
    """
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise error(f"{path} has {size:,} bytes, more than the {MAX_BYTES:,} that are read as JSON. {do}")
        data = path.read_bytes()
    except FileNotFoundError as cause:
        raise error(f"There is no file {path}. Give one that is there.") from cause
    except OSError as cause:
        raise error(f"{path} cannot be read ({cause.strerror or cause}). {do}") from cause
    return parse_json(data, str(path), error, do)


def parse_json(data: bytes, where: str, error: type[PlnerfError], do: str = "Write the file again.") -> Any:
    """The value that bytes hold; as `read_json`.  where: names the bytes in errors."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as cause:
        raise error(f"{where} cannot be read as UTF-8 text ({cause}). {do}") from cause
    if (depth := _depth(data)) > MAX_DEPTH:
        raise error(
            f"{where} has {depth:,} lists and objects within each other, where {MAX_DEPTH} are read. {do}"
        )
    try:
        return json.loads(
            text, parse_constant=_constant, parse_int=_whole, parse_float=_real, object_pairs_hook=_object
        )
    except json.JSONDecodeError as cause:
        raise error(
            f"{where} is not valid JSON: {cause.msg} at line {cause.lineno}, column {cause.colno}. {do}"
        ) from cause
    except _Refused as cause:
        raise error(f"{where} {cause}. {do}") from cause


def object_of(value: Any, where: str, error: type[PlnerfError], do: str = "Write the file again.") -> Any:
    """The value, once it is known to be an object."""
    if not isinstance(value, dict):
        raise error(f"{where} must hold a JSON object, but holds {shown(value)}. {do}")
    return value


def shown(value: object, most: int = 80) -> str:
    """A value in an error, not longer than a line."""
    text = repr(value)
    return text if len(text) <= most else f"{text[:most]}..."


def _depth(data: bytes) -> int:
    """Most lists and objects within each other; those in texts do not count."""
    marks = np.frombuffer(_TEXTS.sub(b"", data), np.uint8)
    steps = np.isin(marks, list(b"[{")).astype(np.int32) - np.isin(marks, list(b"]}"))
    return int(np.cumsum(steps[steps != 0]).max(initial=0))


def _constant(text: str) -> None:
    raise _Refused(f"holds {text}, which is no number of JSON")


def _whole(text: str) -> int:
    if len(text) > MAX_DIGITS:
        raise _Refused(f"holds a whole number of {len(text)} digits, {text[:20]}...")
    return int(text)


def _real(text: str) -> float:
    number = float(text)
    if number in {float("inf"), float("-inf")}:
        raise _Refused(f"holds the number {shown(text, 20)}, which is too large")
    return number


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise _Refused(f"holds the key {shown(twice)} twice in one object")
    return content
