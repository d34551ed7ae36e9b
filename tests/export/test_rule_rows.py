"""The table of clearances by rule has every verdict, and every rule that was not judged with the reason."""

import csv
from pathlib import Path

import numpy as np
import pytest
from tests.support import surveys
from tests.support.rules import with_rules

from plnerf.export.crs import crs_transform
from plnerf.export.exports import write_exports
from plnerf.export.rule_rows import RULES


def test_the_table_holds_verdicts_margins_and_places(tmp_path: Path) -> None:
    survey = with_rules(surveys.short(0.05))
    assert RULES in write_exports(survey, tmp_path).files
    with (tmp_path / RULES).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["rule"], row["state"], row["verdict"]) for row in rows] == [
        ("1", "as surveyed", "clear"), ("1", "75 °C", "closer than required"),
        ("1", "75 °C", "within its uncertainty"), ("2", "as surveyed", "clear"), ("3", "", ""),
    ]  # fmt: skip
    last = [rows[-1][name] for name in ("object", "direction", "why")]
    assert last == ["rail", "vertical", "no rail of a map is given (--objects)"] and rows[0]["why"] == ""
    one = rows[1]
    assert (one["required_m"], one["margin_m"], one["verified"]) == ("6.5", "-0.25", "false")
    place = crs_transform(survey).to_map(np.array([[1.0, 2.0, 9.0]]))[0]
    assert [float(one[f"on_wire_{axis}"]) for axis in "xyz"] == pytest.approx(place, abs=1e-3)


def test_without_rules_there_is_no_table(tmp_path: Path) -> None:
    assert RULES not in write_exports(surveys.short(0.05), tmp_path).files
