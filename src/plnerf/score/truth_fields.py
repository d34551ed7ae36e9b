"""What stands in a truth.json, read with errors that say where it is wrong."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from plnerf.errors import SurveyError
from plnerf.scene.json_fields import numbers_of
from plnerf.scene.strict_json import object_of, read_json, shown


def load_truth(path: Path) -> Mapping[str, Any]:
    """The object in a truth.json, as yet unchecked.  Raises SurveyError where it holds none."""
    do = "Give the truth.json of the scene, or make the truth again."
    content: Mapping[str, Any] = object_of(read_json(path, SurveyError, do), str(path), SurveyError, do)
    return content


def objects(data: Mapping[str, Any], key: str, path: Path) -> list[Mapping[str, Any]]:
    """A list of objects; an absent one is empty."""
    found = data.get(key) or []
    if not isinstance(found, list) or not all(isinstance(entry, dict) for entry in found):
        raise SurveyError(
            f"{path}: {key} must be a list of objects, but is {shown(found)}. Correct the file."
        )
    return found


def name_of(entry: Mapping[str, Any], key: str, default: str, where: str) -> str:
    """A text, or the default where there is none."""
    name = entry.get(key, default)
    if not isinstance(name, str):
        raise SurveyError(f"{where}: its {key} must be a text, but is {shown(name)}. Correct the file.")
    return name


def points_of(value: Any, where: str, least: int = 1) -> Float[np.ndarray, "n 3"]:
    """So many points or more."""
    points = numbers_of(value)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < least or not np.isfinite(points).all():
        raise SurveyError(
            f"{where}: expected {least} or more points of three finite numbers, but found "
            f"{str(value)[:80]}. Correct the file, or make the truth again."
        )
    return points


def number_of(value: Any, where: str) -> float:
    """A finite one."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise SurveyError(f"{where}: expected a finite number, but found {shown(value)}. Correct the file.")
    return float(value)
