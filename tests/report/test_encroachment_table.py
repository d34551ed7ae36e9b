"""Encroachments in the report: each a row by priority, with its figures, and what was not examined."""

from dataclasses import replace

import numpy as np
from tests.support import surveys
from tests.support.encroaching import with_encroachments

from plnerf.line.encroachments import Encroachments
from plnerf.line.survey import Crop, Survey
from plnerf.report.encroachment_table import (
    about_encroachments,
    encroachment_crops,
    encroachment_summary,
    encroachment_tables,
)
from plnerf.report.page import html_page
from plnerf.report.page_tables import wire_tables
from plnerf.report.plan import plan
from plnerf.report.plan_encroachments import COLOURS
from plnerf.report.quality import quality_table
from plnerf.report.tables import Verdict


def test_a_row_for_each_with_its_way_and_its_figures() -> None:
    survey = with_encroachments(surveys.short(0.1))
    (table,) = encroachment_tables(survey)
    heads, (tree, wires) = list(table.columns), table.rows
    cells = dict(zip(heads, tree, strict=True))
    assert cells["how"] == Verdict("fall-in", "short") and cells["what"] == "plant"
    (to,) = (value for name, value in cells.items() if name.startswith("comes to"))
    (years,) = (value for name, value in cells.items() if name.startswith("years"))
    assert (to, years) == ("−0.75\u202f±\u202f0.39", "2.0\u202f±\u202f1.0")
    assert cells["also"] == "grow-in" and cells["wire"] == "1"
    assert wires[1:3] == [Verdict("blow-out", "short"), "storm <b>"] and wires[5] == "1, 2"
    assert table.groups == {
        0: "Priority 3: too near when falling", 1: "Priority 2: too near in another state"
    }  # fmt: skip
    assert encroachment_summary(survey).startswith("2 encroachments: 1 too near in another state")


def test_the_page_has_them_and_what_was_not_examined_escaped() -> None:
    page = html_page(with_encroachments(surveys.short(0.1)))
    assert "storm &lt;b&gt;" in page and "Growth of &lt;i&gt; is not examined." in page
    bare = surveys.short(0.1)
    assert encroachment_summary(bare) == "" and "Nothing is required" in about_encroachments(bare)
    none = replace(bare, encroachments=Encroachments((), ("a matrix",)))
    assert "No encroachment was found" in html_page(none)


def with_swing(survey: Survey) -> Survey:
    """Of its first wire, 0.1 rad with a deviation of 0.01."""
    (line,), (first, *rest) = survey.lines, survey.wires
    spread = first.covariance.copy()
    spread[5, 5] = 1e-4
    first = replace(first, theta=first.theta + np.array([0, 0, 0, 0, 0, 0.1]), covariance=spread)
    return replace(survey, lines=(replace(line, spans=(replace(line.spans[0], wires=(first, *rest)),)),))


def test_lengths_are_in_feet_where_they_are_asked_for() -> None:
    survey = with_encroachments(surveys.short(0.1))
    survey = replace(survey, report_units="feet")
    (table,) = encroachment_tables(survey)
    cells = dict(zip(table.columns, table.rows[0], strict=True))
    assert cells["required,\u00a0ft"] == "9.84" and cells["station,\u00a0ft"] == "68.9"
    assert cells["comes to,\u00a0ft ±\u00a095\u00a0%"] == "−2.46\u202f±\u202f1.29"
    assert cells["years until then ±\u00a095\u00a0%"] == "2.0\u202f±\u202f1.0"
    page = html_page(survey)
    table = wire_tables(with_swing(survey))[0]
    cells = dict(zip(table.columns, table.rows[0], strict=True))
    assert cells["swing,\u00a0° ±\u00a095\u00a0%"] == "5.7\u202f±\u202f1.1"  # degrees stay degrees
    assert "sag,\u00a0ft" in page and "in feet" in page
    assert "sag,\u00a0ft" not in html_page(replace(survey, report_units="metres"))


def test_the_plan_marks_them_by_priority() -> None:
    drawn = plan(with_encroachments(surveys.short(0.1)))
    assert drawn is not None and "encroachment 1: too near when falling" in drawn.svg
    assert COLOURS[3] in drawn.svg and COLOURS[2] in drawn.svg and "encroachments" in drawn.about


def test_quality_is_stated_and_judges_nothing() -> None:
    survey = with_encroachments(surveys.half_seen())
    table = quality_table(survey)
    assert table is not None
    figures = {row[1]: row[2] for row in table.rows}
    assert figures["stretches not seen"] == "1" and figures["ground seen"] == "55\u00a0%"
    assert figures["within their uncertainty"] == "0 of 2" and figures["structures with a name"] == "0 of 2"
    assert quality_table(surveys.empty()) is None


def test_crops_stand_below_their_encroachment() -> None:
    survey = with_encroachments(surveys.short(0.1))
    crop = Crop(1, "DJI_1.JPG", np.zeros((40, 40, 3), np.uint8), np.array([20.0, 20]), np.array([5.0, 5]))
    (one,) = encroachment_crops(replace(survey, encroachment_crops=(crop,)))
    assert one.title.startswith("2: crossing wire") and one.crops[0].caption == "DJI_1.JPG"
