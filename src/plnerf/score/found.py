"""A survey read back from its survey.json: conductors with their covariance, and clearances."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from plnerf.errors import SurveyError
from plnerf.report.data import Clearance
from plnerf.report.survey_json import FORMAT_VERSION
from plnerf.survey.fit import Base, CatenaryFit
from plnerf.survey.model import Conductor


@dataclass(frozen=True, eq=False)
class FoundSurvey:
    """What a survey in metres states."""

    path: Path
    conductors: tuple[Conductor, ...]
    clearances: tuple[Clearance, ...]
    """Of every conductor, to every class of things."""


def read_survey(path: Path) -> FoundSurvey:
    """Raises SurveyError for a file that is no survey.json of this format, or of an unscaled survey."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SurveyError(
            f"The survey {path} cannot be read ({error.strerror or error}). Give the folder that `plnerf "
            "survey` wrote, or its survey.json."
        ) from error
    except ValueError as error:  # of JSON, or of the encoding
        raise SurveyError(f"{path} is not valid JSON ({error}). Survey again.") from error
    version = data.get("format_version") if isinstance(data, dict) else None
    if version != FORMAT_VERSION:
        raise SurveyError(
            f"{path} has the format version {version}, but {FORMAT_VERSION} is needed, whose conductors "
            "have a covariance. Survey again with this version of plnerf, or give the wires.ply beside it."
        )
    if data.get("unit") != "m":
        raise SurveyError(
            f"The survey {path} has the unit {data.get('unit')!r}, so that its conductors cannot be compared "
            "with true ones in metres. Give the photos' positions or control points, and survey again."
        )
    try:
        conductors = tuple(_conductor(row) for row in data["conductors"])
        clearances = tuple(_clearance(row) for row in data["clearances"])
    except (KeyError, TypeError, ValueError) as error:
        raise SurveyError(
            f"{path} is not what `plnerf survey` writes ({error!r}). Survey again, and leave the file as it "
            "is."
        ) from error
    return FoundSurvey(path, conductors, clearances)


def _conductor(row: dict[str, Any]) -> Conductor:
    before = row["before_refit"]
    return Conductor(
        row["id"], row["span"], row["kind"], _fit(row), float(row["coverage"]), float(row["longest_gap"]),
        row["evidence"], row["source"], row["note"], None if before is None else _fit(before),
    )  # fmt: skip


def _fit(row: dict[str, Any]) -> CatenaryFit:
    base, ends = row["base"], _array(row["end_sigma"], 2)
    return CatenaryFit(
        Base(_array(base["o"], 2), _array(base["u"], 2), float(base["length"])),
        _array(row["q"], 5),
        _array(row["covariance"], 5, 5),
        np.ones(0, np.bool_),  # the points are not in the file
        float(row["residual_across"]),
        float(row["residual_up"]),
        (float(ends[0]), float(ends[1])),
    )


def _clearance(row: dict[str, Any]) -> Clearance:
    return Clearance(
        row["conductor"], row["to"], float(row["distance"]), row["sigma"], float(row["at"]),
        _array(row["on_wire"], 3), _array(row["on_obstacle"], 3), row["required"], row["verdict"],
    )  # fmt: skip


def _array(value: Any, *shape: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    array = np.array(value, dtype=np.float64)
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"expected finite numbers of the shape {shape}, but found {str(value)[:60]}")
    return array
