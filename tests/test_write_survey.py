"""A survey's folder: what is written of a survey, what is read back, and what an earlier one leaves."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.support import surveys
from tests.support.read_html import Read

from plnerf.errors import PlnerfError
from plnerf.line.files import read_survey, survey_json
from plnerf.line.survey import WirePoints
from plnerf.pipeline import write_survey
from plnerf.report.page import html_page
from plnerf.scene.ply import read_ply

ALWAYS = {"report.html", "survey.json", "cloud.laz", "cloud.ply", "conductors.dxf"}
ALL = ALWAYS | {
    "conductors.csv", "conductors.geojson", "conductors-projected.geojson", "clearances.csv",
    "clearances.geojson", "structures.csv", "structures.geojson",
}  # fmt: skip
MADE = {
    "short": ALL,
    "open_ended": ALL,
    "unscaled": ALWAYS | {"conductors.csv", "structures.csv"},
    "empty": ALWAYS,
}


@pytest.mark.parametrize("name", MADE)
def test_a_folder_holds_the_survey(name: str, tmp_path: Path) -> None:
    survey = getattr(surveys, name)(0.1)
    page = write_survey(survey, tmp_path / "new" / "survey")
    assert page == tmp_path / "new" / "survey" / "report.html"
    assert {path.name for path in page.parent.iterdir()} == MADE[name]
    read = read_survey(page.with_name("survey.json"))
    assert survey_json(replace(read, cloud=survey.cloud)) == survey_json(survey)
    text = page.read_text(encoding="utf-8")
    beside = re.search(r"files beside this report(.*?)about these files", Read(text).text)
    assert beside is not None
    listed = set(re.split(r", | and ", beside[1].strip()))
    assert listed == MADE[name] - {"report.html"}
    assert text[:500] == html_page(survey)[:500]


def test_what_a_field_shows_on_wires_lies_in_the_world(tmp_path: Path) -> None:
    survey = surveys.short(0.05)
    on = survey.wires[0].polyline(1.0)
    points = WirePoints(on, np.zeros(len(on), np.int64), np.ones(len(on)), 90)
    folder = write_survey(replace(survey, wire_points=points), tmp_path).parent
    vertex = read_ply(folder / "wires.ply")["vertex"]
    found = np.stack([vertex[axis] for axis in "xyz"], 1)
    assert np.array_equal(found, survey.frame.to_world(on)) and set(vertex.dtype.names) >= {"view", "solid"}
    assert "wires.ply" in Read((folder / "report.html").read_text()).text


def test_nothing_of_an_earlier_survey_stays(tmp_path: Path) -> None:
    write_survey(surveys.short(0.05), tmp_path)
    write_survey(surveys.empty(), str(tmp_path))
    assert {path.name for path in tmp_path.iterdir()} == ALWAYS
    assert json.loads((tmp_path / "survey.json").read_text())["lines"] == []


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(PlnerfError, match="is to be a folder, but it is a file"):
        write_survey(surveys.empty(), tmp_path / "file")
