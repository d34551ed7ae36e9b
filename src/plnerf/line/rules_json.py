"""Clearances by rule as plain JSON values and back: a part of survey.json (`files.py`)."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from jaxtyping import Float

from plnerf.line.ends import Quantity
from plnerf.line.rules import Judged, NotJudged, Rule, RuleReport


def rules_row(found: RuleReport) -> dict[str, Any]:
    """NumPy's arrays are left for the caller to make plain."""
    judged = [
        asdict(one) | {"margin": asdict(found.margin(one)), "required_m": found.rule(one.rule).required_m}
        for one in found.judged
    ]
    return asdict(found) | {"judged": judged}


def rules_of(row: Mapping[str, Any]) -> RuleReport:
    """The inverse of `rules_row`.  Raises LookupError, TypeError or ValueError for what is none."""
    return RuleReport(
        name=row["name"],
        source=row["source"],
        date=row["date"],
        voltage_kv=float(row["voltage_kv"]),
        caveats=tuple(row["caveats"]),
        rules=tuple(Rule(**(one | {"states": tuple(one["states"])})) for one in row["rules"]),
        judged=tuple(_judged(one) for one in row["judged"]),
        not_judged=tuple(NotJudged(**one) for one in row["not_judged"]),
        objects=tuple((name, count) for name, count in row["objects"]),
    )


def _judged(row: Mapping[str, Any]) -> Judged:
    values = {name: value for name, value in row.items() if name not in {"margin", "required_m"}}
    points = {name: _point(values[name]) for name in ("on_wire", "on_object")}
    return Judged(**(values | points | {"distance": Quantity(**values["distance"])}))


def _point(value: Any) -> Float[np.ndarray, "3"]:
    found = np.array(value, np.float64).reshape(3)
    if not np.isfinite(found).all():
        raise ValueError("a place by rule holds numbers that are not finite")
    return found
