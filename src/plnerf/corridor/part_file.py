"""The part of a corridor that a block's survey is about, as JSON in the block's folder."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plnerf.errors import SurveyError
from plnerf.scene.files import write_text
from plnerf.scene.strict_json import read_json
from plnerf.scene.typed_json import from_json
from plnerf.survey.part import Cells, Part, SpanNumber

PART = "part.json"


@dataclass(frozen=True)
class _Row:
    axes: tuple[tuple[tuple[float, float, float], tuple[float, float, float]], ...]
    numbers: tuple[SpanNumber, ...]
    mine: tuple[int, ...]
    side: float | None
    keys: tuple[tuple[int, int], ...]


def write_part(path: Path, part: Part) -> None:
    """Writes a part."""
    numbers = [
        {"line": one.line, "span": one.span, "structures": list(one.structures), "from_m": one.from_m}
        for one in part.numbers
    ]
    content = {
        "axes": part.axes.tolist(), "numbers": numbers, "mine": list(part.mine),
        "side": None if part.cells is None else part.cells.side,
        "keys": [] if part.cells is None else part.cells.keys.tolist(),
    }  # fmt: skip
    write_text(path, json.dumps(content) + "\n")


def read_part(path: Path) -> Part:
    """What `write_part` wrote.  Raises SurveyError where it is not that."""
    do = "Remove it: the corridor is planned again."
    row = from_json(_Row, read_json(path, SurveyError, do), str(path), SurveyError)
    cells = None if row.side is None else Cells(row.side, np.array(row.keys, np.int64).reshape(-1, 2))
    return Part(np.array(row.axes).reshape(-1, 2, 3), row.numbers, row.mine, cells)
