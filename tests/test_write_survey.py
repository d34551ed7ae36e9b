"""A survey's folder: what is written of a survey, what is read back, and what an earlier one leaves."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.support import surveys
from tests.support.read_html import Read

from plnerf import pipeline
from plnerf.errors import PlnerfError
from plnerf.line.files import read_survey, survey_json
from plnerf.line.survey import WirePoints
from plnerf.pipeline import write_survey
from plnerf.report.page import html_page
from plnerf.scene.ply import read_ply
from plnerf.score.places import find_survey

ALWAYS = {"report.html", "survey.json", "cloud.laz", "cloud.ply", "conductors.dxf"}
ALL = ALWAYS | {
    "conductors.csv", "conductors.geojson", "conductors-projected.geojson", "clearances.csv",
    "clearances.geojson", "structures.csv", "structures.geojson",
    "spans.csv", "phases.csv", "attachments.csv",
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


@pytest.mark.parametrize("stage", ["write_exports", "write_survey_json", "write_report"])
def test_an_earlier_survey_stays_until_the_new_one_is_complete(
    stage: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise PlnerfError("the disk is full")

    write_survey(surveys.short(0.05), tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    monkeypatch.setattr(pipeline, stage, full)
    with pytest.raises(PlnerfError, match="the disk is full"):
        write_survey(surveys.empty(), tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_reading_a_survey_ends_an_exchange_that_was_interrupted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def kill(*_: object) -> None:
        raise KeyboardInterrupt

    write_survey(surveys.short(0.05), tmp_path)
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(Path, "replace", only_from(".complete", kill))
        write_survey(surveys.empty(), tmp_path)
    assert (tmp_path / ".complete").is_dir() and find_survey(tmp_path) == tmp_path / "survey.json"
    assert read_survey(tmp_path / "survey.json").lines == ()
    assert {path.name for path in tmp_path.iterdir()} == ALWAYS


def only_from(folder: str, change: Callable[[Path, Path], None]) -> Callable[[Path, Path], None]:
    """A renaming that does something else with files of a folder of this name."""
    rename = Path.replace
    return lambda self, to: (change if self.parent.name == folder else rename)(self, to)


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(PlnerfError, match="is to be a folder, but it is a file"):
        write_survey(surveys.empty(), tmp_path / "file")
