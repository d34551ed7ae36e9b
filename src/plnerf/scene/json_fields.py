"""Typed values out of parsed JSON, each with an error text that names the file and the key."""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

from plnerf.errors import SceneError
from plnerf.scene.strict_json import shown

Json = Mapping[str, object]


def section_of(data: Json, key: str, path: Path) -> Json:
    """An object; an absent one is empty."""
    section = data.get(key, {})
    if not isinstance(section, dict):
        raise SceneError(
            f'In {path} the key "{key}" must be an object, but is {shown(section)}. Correct or remove it.'
        )
    return section


def number_of(values: Json, key: str, where: str) -> float | None:
    """A finite number, or None when absent."""
    value = values.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise SceneError(f"{where}: {key} must be a finite number, but is {shown(value)}. Correct the file.")
    return float(value)


def numbers_of(value: object) -> Float[np.ndarray, "..."]:
    """Nested lists of numbers as an array; empty where they are ragged, or anything else than numbers."""
    try:
        array = np.array(value)
    except (TypeError, ValueError, OverflowError, RecursionError):
        return np.zeros(0)
    return array.astype(np.float64) if array.dtype.kind in "iuf" else np.zeros(0)


def text_of(values: Json, key: str, where: str) -> str | None:
    """A text, or None when absent."""
    value = values.get(key)
    if value is not None and not isinstance(value, str):
        raise SceneError(f"{where}: {key} must be a text, but is {shown(value)}. Correct the file.")
    return value


def is_file(path: Path) -> bool:
    """Whether a file is there; a name that no file can have names none."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def is_folder(path: Path) -> bool:
    """Whether a folder is there; a name that no folder can have names none."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def file_of(root: Path, values: Json, key: str, where: str) -> Path | None:
    """An existing file, named relative to ``root``, or None when absent."""
    name = text_of(values, key, where)
    if name is None:
        return None
    path = root / name
    if not is_file(path):
        raise SceneError(
            f"{where}: {key} names {path}, which is not there. Copy the file into the scene folder, or take "
            "the key out."
        )
    return path


def vector_of(values: Json, key: str, path: Path) -> Float[np.ndarray, "3"] | None:
    """Three finite numbers, or None when absent; the direction "up" must not be zero."""
    value = values.get(key)
    if value is None:
        return None
    vector = numbers_of(value)
    zero_direction = key == "up" and not vector.any()
    if vector.shape != (3,) or not np.isfinite(vector).all() or zero_direction:
        raise SceneError(
            f"{path}: plnerf.{key} must be three finite numbers{', not all zero' if zero_direction else ''}, "
            f"but is {shown(value)}. Correct or remove it."
        )
    return vector
