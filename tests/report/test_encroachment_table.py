"""Encroachments in the report: each a row by priority, with its figures, and what was not examined."""

from dataclasses import replace

import numpy as np
from tests.support import surveys
from tests.support.encroaching import with_encroachments

from plnerf.line.encroachments import Encroachments
from plnerf.line.survey import Crop
from plnerf.report.encroachment_table import (
    about_encroachments,
    encroachment_crops,
    encroachment_summary,
    encroachment_tables,
)
from plnerf.report.page import html_page
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
    assert cells["also"] == "grow-in (within its uncertainty)"
    assert wires[1] == Verdict("blow-out, storm <b>", "short") and wires[4] == "1, 2"
    assert table.groups == {
        0: "Priority 3: comes too near where it falls", 1: "Priority 2: too near in another state"
    }  # fmt: skip
    assert encroachment_summary(survey).startswith("2 encroachments: 1 too near in another state")


def test_the_page_has_them_and_what_was_not_examined_escaped() -> None:
    page = html_page(with_encroachments(surveys.short(0.1)))
    assert "blow-out, storm &lt;b&gt;" in page and "Growth of &lt;i&gt; is not examined." in page
    bare = surveys.short(0.1)
    assert encroachment_summary(bare) == "" and "Nothing is required" in about_encroachments(bare)
    none = replace(bare, encroachments=Encroachments((), ("a matrix",)))
    assert "No encroachment was found" in html_page(none)


def test_crops_stand_below_their_encroachment() -> None:
    survey = with_encroachments(surveys.short(0.1))
    crop = Crop(1, "DJI_1.JPG", np.zeros((40, 40, 3), np.uint8), np.array([20.0, 20]), np.array([5.0, 5]))
    (one,) = encroachment_crops(replace(survey, encroachment_crops=(crop,)))
    assert one.title.startswith("2: crossing wire") and one.crops[0].caption == "DJI_1.JPG"
