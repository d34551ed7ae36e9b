"""What a report shows of what was not seen, and of what may be there."""

import re
from dataclasses import replace

import numpy as np
import pytest
from tests.support import surveys
from tests.support.read_html import Read

from plnerf.line.clearances import Possible
from plnerf.line.survey import Crop, Survey
from plnerf.report.nearest import by_need
from plnerf.report.page import html_page
from plnerf.report.plan import plan
from plnerf.report.profile import profiles


def text(survey: Survey) -> str:
    return Read(html_page(survey)).text.replace("\u00a0", " ")


def test_a_report_says_which_stretches_were_not_seen() -> None:
    """In numbers, beside the figures that hold only for what was seen, in the profile and on the plan."""
    survey = surveys.half_seen()
    shown = text(survey)
    assert "10 to 30 m" in shown and "of its span 10 to 30 m not seen" in shown
    assert "ground not seen and air not seen" in shown and "55 %" in shown and "68 %" in shown
    (drawing,) = profiles(survey, by_need(survey))
    bars = re.findall(r'<rect [^>]*height="([\d.]+)"[^>]*class="unseen"', drawing.svg)
    assert len(bars) == 3 and sorted(map(float, bars))[:2] == [8.0, 8.0] and "Grey behind" in drawing.about
    above = plan(survey)
    assert above is not None and above.svg.count("<polygon") == 3 and "grey" in above.about


def test_nothing_is_marked_where_all_was_seen() -> None:
    survey = surveys.half_seen()
    (one,) = survey.coverage
    survey = replace(survey, coverage=(replace(one, ground=one.ground * 0 + 1, air=one.air * np.nan),))
    (drawing,) = profiles(survey, by_need(survey))
    above = plan(survey)
    assert "unseen" not in drawing.svg and above is not None and "<polygon" not in above.svg
    assert "not seen at stations" in text(survey) and "of its span" not in text(survey)


@pytest.mark.parametrize("crops", [0, 2])
def test_what_is_possible_stands_apart_with_its_pictures(crops: int) -> None:
    survey = surveys.short(0.1)
    assert survey.clearances is not None and "Possible, look here" not in text(survey)
    place = replace(survey.clearances.wires[0].places["vegetation"][0], distance_m=0.77)
    found = replace(survey.clearances, possible=(Possible(place, 2, 7),))
    parts = tuple(
        Crop(0, f"photo {k}.jpg", np.full((60, 80, 3), 9, np.uint8), np.full(2, 30.0), np.full(2, 9.0))
        for k in range(crops)
    )
    page = html_page(replace(survey, clearances=found, crops=parts))
    shown = Read(page).text.replace("\u00a0", " ")
    assert "Possible, look here" in shown and "0.77" in shown and page.count("photo ") >= 2 * crops
    assert ('class="crops"' in page) == bool(crops)
    least = min(one.places["vegetation"][0].distance_m for one in found.wires if one.places["vegetation"])
    assert least > 0.77 and "something may be 0.77 m from wire" in shown
    farther = replace(found, possible=(Possible(replace(place, distance_m=least + 0.1), 2, 7),))
    assert "something may be" not in text(replace(survey, clearances=farther))
