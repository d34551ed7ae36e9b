"""Spans, phases, attachments and strings as tables, with the names of structures and wires."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.support import surveys

from plnerf.export.crs import crs_transform
from plnerf.export.exports import write_exports
from plnerf.line.phases import InsulatorString


def test_tables_of_a_line_hold_what_it_is_made_of(tmp_path: Path) -> None:
    survey = surveys.short(0.05)
    (line,) = survey.lines
    wires = tuple(replace(wire, bundle=1 if wire.id < 3 else None, name="A") for wire in line.wires)
    masts = tuple(replace(one, name=f"M{one.id}") for one in line.structures)
    line = replace(line, structures=masts, spans=(replace(line.spans[0], wires=wires),), name="L 1")
    string = InsulatorString(1, (1,), "suspension", np.array([[-20.0, -3, 11.5], [-20.0, -3, 10.0]]), 0.2, 7)
    survey = replace(survey, lines=(line,), strings=(string,))
    files = write_exports(survey, tmp_path).files

    def table(name: str) -> list[dict[str, str]]:
        with files[name].open(newline="", encoding="utf-8") as file:
            return list(csv.DictReader(file))

    (span,) = table("spans.csv")
    assert (span["line_name"], span["name_a"], span["name_b"], span["phases"]) == ("L 1", "M1", "M2", "3")
    assert float(span["length_m"]) == pytest.approx(40.8, abs=0.1)
    phases = table("phases.csv")
    assert [one["wires"] for one in phases] == ["1 2", "3", "4", "5"] and phases[0]["subconductors"] == "2"
    assert float(phases[0]["spacing_m"]) == pytest.approx(3.1, abs=0.1) and phases[1]["spacing_m"] == ""
    ends = table("attachments.csv")
    assert len(ends) == 10 and ends[0]["structure_name"] == "M1"
    place = np.array([[float(ends[0][f"attachment_{axis}"]) for axis in "xyz"]])
    back = crs_transform(survey).from_map(place)[0]
    assert back == pytest.approx(survey.wires[0].ends[0].point, abs=1e-3)  # type: ignore[union-attr]
    assert float(ends[0]["along_95_m"]) == pytest.approx(1.96 * 0.03, abs=1e-4)
    (one,) = table("strings.csv")
    assert (one["kind"], one["length_m"], one["points"]) == ("suspension", "1.5", "7")
