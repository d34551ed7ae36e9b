"""Encroachments as plain JSON values and back: a part of survey.json (`files.py`)."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from plnerf.line.encroachments import Approach, Encroachment, Encroachments
from plnerf.line.ends import Quantity


def encroachments_row(found: Encroachments) -> dict[str, Any]:
    """NumPy's arrays are left for the caller to make plain."""
    return {
        "required": found.required,
        "not_examined": found.not_examined,
        "records": [asdict(one) for one in found.records],
    }


def encroachments_of(row: Mapping[str, Any]) -> Encroachments:
    """The inverse of `encroachments_row`.  Raises LookupError, TypeError or ValueError for what is none."""
    return Encroachments(
        tuple(_record(one) for one in row["records"]), tuple(row["required"]), tuple(row["not_examined"])
    )


def _record(row: Mapping[str, Any]) -> Encroachment:
    return Encroachment(
        **(
            dict(row)
            | {name: Quantity(**row[name]) for name in ("radial", "vertical", "horizontal")}
            | {name: _point(row[name]) for name in ("highest", "on_wire", "on_object")}
            | {"outline": np.array(row["outline"], dtype=np.float64).reshape(-1, 2)}
            | {"approaches": tuple(_approach(one) for one in row["approaches"])}
        )
    )


def _approach(row: Mapping[str, Any]) -> Approach:
    years = row["years"]
    return Approach(
        **(
            dict(row)
            | {"distance": Quantity(**row["distance"]), "years": None if years is None else Quantity(**years)}
            | {name: _point(row[name]) for name in ("on_wire", "on_object")}
        )
    )


def _point(value: Any) -> np.ndarray:
    return np.array(value, dtype=np.float64).reshape(3)
