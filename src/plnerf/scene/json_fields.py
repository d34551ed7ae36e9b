"""Typed values out of parsed JSON, each with an error text that names the file and the key."""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

from plnerf.errors import SceneError

Json = Mapping[str, object]


def section_of(data: Json, key: str, path: Path) -> Json:
    """An object; an absent one is empty."""
    section = data.get(key, {})
    if not isinstance(section, dict):
        raise SceneError(
            f'In {path} the key "{key}" must be an object, but is {section!r}. Correct or remove it.'
        )
    return section


def number_of(values: Json, key: str, where: str) -> float | None:
    """A finite number, or None when absent."""
    value = values.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise SceneError(f"{where}: {key} must be a finite number, but is {value!r}. Correct the file.")
    return float(value)


def file_of(root: Path, values: Json, key: str, where: str) -> Path | None:
    """An existing file, named relative to ``root``, or None when absent."""
    name = values.get(key)
    if name is None:
        return None
    path = root / str(name)
    if not path.is_file():
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
    try:
        vector = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        vector = np.zeros(0)
    zero_direction = key == "up" and not vector.any()
    if vector.shape != (3,) or not np.isfinite(vector).all() or zero_direction:
        raise SceneError(
            f"{path}: plnerf.{key} must be three finite numbers{', not all zero' if zero_direction else ''}, "
            f"but is {value!r}. Correct or remove it."
        )
    return vector
