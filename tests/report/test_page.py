"""A survey's report is complete in one file and says what the survey says; no name breaks it."""

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import surveys
from tests.support.read_html import Read

from plnerf.errors import SurveyError
from plnerf.report.data import Clearance, Picture, Report
from plnerf.report.page import html_page, write_report
from plnerf.report.profile import profile
from plnerf.report.scene_view import scene
from plnerf.report.survey_json import survey_json
from plnerf.report.words import caveats, judged
from plnerf.survey.model import CONDUCTOR, Cloud

NASTY = """<script>alert("1")</script> & 'q' </script><img src=x onerror=alert(2)> \\u003c"""
MADE = {
    "short": lambda: surveys.short(0.1),
    "long": lambda: surveys.long(0.7),
    "unscaled": surveys.unscaled,
    "empty": surveys.empty,
}


@cache
def report(name: str) -> Report:
    return MADE[name]()


@cache
def page(name: str) -> str:
    return html_page(report(name))


def plus(value: float, sigma: float, digits: int) -> str:
    return f"{value:,.{digits}f}\u202f±\u202f{1.96 * sigma:.{digits}f}"


@pytest.mark.parametrize("name", MADE)
def test_a_page_needs_nothing_from_elsewhere(name: str) -> None:
    text, read = page(name), Read(page(name))
    for tag, attribute, value in read.attributes:
        if attribute in ("src", "href", "action", "data", "srcset", "poster", "xlink:href"):
            assert value.startswith(("#", "data:")), f"<{tag} {attribute}={value[:60]}>"
            if value.startswith("#"):
                assert value[1:] in read.ids
        assert "url(" not in value
    style = re.search("<style>(.*?)</style>", text, re.DOTALL)
    assert style and "url(" not in style[1] and "@import" not in style[1]
    assert not re.search(r"https?:|//[a-z]+\.|fetch\(|XMLHttpRequest|import\(|WebSocket", text)
    assert len(read.ids) == len(set(read.ids))


@pytest.mark.parametrize("name", MADE)
def test_a_page_is_small(name: str) -> None:
    assert len(page(name).encode()) < 2_000_000


def test_the_tables_hold_the_survey() -> None:
    told, read = report("long"), Read(page("long"))
    rows = {row["id"]: row for row in read.table("kind")}
    known = {row["id"]: row for row in read.table("coverage")}
    assert len(rows) == len(known) == 12
    for one in told.survey.conductors:
        row, curve = rows[str(one.id)], one.fit.curve
        assert row["sag, m ± 95 %"] == plus(curve.sag_m, one.fit.sag_sigma_m, 3)
        assert row["p = H/w, m"] == f"{curve.p_m:,.1f}" and row["wire length, m"] == f"{curve.length_m:.2f}"
        assert (row["span"], row["kind"]) == (str(one.span + 1), one.kind)
        dense = curve.points(np.linspace(0, curve.span_m, 20_001))
        assert float(row["its height, m"]) == pytest.approx(dense[:, 2].min(), abs=0.006)
        row = known[str(one.id)]
        assert row["coverage"] == f"{100 * one.coverage:.0f} %"
        assert row["longest gap, m"] == f"{one.longest_gap_m:.2f}" and row["evidence"] == one.source
        assert row["residual across, m"] == f"{one.fit.residual_across_m:.3f}"
        assert row["note"] == (one.note or "–")


def test_clearances_come_by_need_with_words() -> None:
    told, rows = report("long"), Read(page("long")).table("verdict")
    assert len(rows) == len(told.clearances) == 24
    margins = [float(row["margin, m"].replace("−", "-")) for row in rows]
    assert margins == sorted(margins)
    by_key = {(str(one.conductor), one.to): one for one in told.clearances}
    for row in rows:
        one = by_key[row["conductor"], row["to"]]
        assert row["distance, m ± 95 %"] == plus(one.distance_m, one.sigma_m, 2)
        assert row["verdict"].split(maxsplit=1)[1] == one.verdict
        obstacle = [float(x) for x in row["on the obstacle x, y, z"].split(", ")]
        assert np.abs(obstacle - one.on_obstacle).max() < 0.006
    worst = told.worst()
    assert {one.to for one in worst} == {"ground", "vegetation"}
    for one in worst:
        assert one.margin_m == min(other.margin_m for other in told.clearances if other.to == one.to)


@pytest.mark.parametrize(
    ("distance", "sigma", "required", "standing"),
    [
        (2.97, 0.01, 3.0, "short"),
        (2.99, 0.01, 3.0, "doubtful"),
        (3.01, 0.01, 3.0, "doubtful"),
        (3.03, 0.01, 3.0, "kept"),
        (3.001, None, 3.0, "kept"),
        (0.1, 0.2, None, "open"),
    ],
)
def test_a_clearance_is_judged_with_its_uncertainty(
    distance: float, sigma: float | None, required: float | None, standing: str
) -> None:
    one = Clearance(1, "trees", distance, sigma, 0.0, np.zeros(3), np.zeros(3), required, "words")
    assert one.standing == standing
    told = replace(report("short"), clearances=(replace(one, conductor=1),))
    counts = {"short": "1 falls short", "doubtful": "1 is too near to it", "kept": "1 is kept"}
    assert all((text in judged(told)) == (kind == standing) for kind, text in counts.items())


def test_names_from_outside_are_shown_as_they_are() -> None:
    told = report("short")
    conductors = (replace(told.survey.conductors[0], source=NASTY, note=NASTY), *told.survey.conductors[1:])
    survey = replace(
        told.survey, conductors=conductors, source=NASTY, crs=NASTY, notes=(NASTY,)
    )
    clearances = (replace(told.clearances[0], to=NASTY, verdict=NASTY),)
    picture = Picture(NASTY, np.zeros((20, 30, 3), np.uint8))
    nasty = Report(survey, clearances, told.profiles, (picture,), (NASTY, "b"), {NASTY: NASTY}, (NASTY,))
    text = html_page(nasty)
    read = Read(text)
    assert len(read.scripts) == len(Read(page("short")).scripts) == 2
    assert not [tag for tag, name, _ in read.attributes if name == "onerror"]
    assert "alert(2)" not in re.sub("&lt;img.*?&gt;|\\\\u003cimg.*?>", "", text)
    assert read.text.count('<script>alert("1")</script>') > 8
    assert json.loads(read.scripts[0])["marks"][0]["text"].startswith(NASTY)


def test_a_survey_without_conductors_says_so() -> None:
    read = Read(page("empty"))
    assert "No conductor was found among" in read.text
    assert "No conductor was found, so that there is none to list." in read.text
    assert "Without conductors there is no span to draw." in read.text
    assert read.tables == []
    assert survey_json(report("empty"))["conductors"] == []
    nothing = Cloud(np.zeros((0, 3)), np.zeros(0, np.uint8), np.zeros(0, np.int64))
    bare = Report(replace(report("empty").survey, cloud=nothing))
    assert "There are neither points nor conductors to draw." in Read(html_page(bare)).text


def test_an_unscaled_survey_names_no_metres() -> None:
    read = Read(page("unscaled"))
    assert "units, unscaled" in read.text and "Units, unscaled" in read.text
    words = read.text + " ".join(value for _, name, value in read.attributes if name in ("aria-label", "alt"))
    assert not re.search(r"\bm\b|metre|\bcm\b|\bmm\b", words), re.search(r".{30}(\bm\b|metre).{20}", words)
    assert scene(report("unscaled"))["unit"] == "units"
    curve = report("unscaled").survey.conductors[0].fit.curve
    assert read.table("kind")[0]["span length, units"] == f"{curve.span_m:.4f}"
    assert survey_json(report("unscaled"))["unit"] == "unscaled"


@pytest.mark.parametrize("name", MADE)
def test_the_json_is_strict_and_holds_the_survey(name: str) -> None:
    told = report(name)
    content = survey_json(told)
    assert json.loads(json.dumps(content, allow_nan=False)) == content
    for one, row in zip(told.survey.conductors, content["conductors"], strict=True):
        curve = one.fit.curve
        assert (row["sag"], row["sag_sigma"], row["p"]) == (curve.sag_m, one.fit.sag_sigma_m, curve.p_m)
        assert row["q"] == one.fit.q.tolist() and tuple(row["end_b"]) == curve.b
    for one, row in zip(told.profiles, content["profiles"], strict=True):
        known = np.isfinite(one.vegetation_m)
        assert [value is not None for value in row["vegetation"]] == known.tolist()
        assert row["wire"] == one.wire_m.tolist()
    assert content["caveats"] == caveats(told)
    assert sum(row["points"] for row in content["points_by_class"]) == content["points"]


def test_what_is_not_known_is_null() -> None:
    told = report("short")
    first = told.survey.conductors[0]
    unknown = replace(first, fit=replace(first.fit, covariance=np.full((5, 5), np.nan)))
    survey = replace(told.survey, conductors=(unknown,), temperature_c=None, origin=None, crs=None)
    content = survey_json(Report(survey))
    json.dumps(content, allow_nan=False)
    row = content["conductors"][0]
    assert row["sag_sigma"] is None and row["covariance"][0] == [None] * 5
    assert content["temperature_c"] is content["crs"] is content["origin_lon_lat_height"] is None
    assert "nan" not in profile(Report(survey), 0)
    read = Read(html_page(Report(survey)))
    assert read.table("kind")[0]["sag, m ± 95 %"].endswith("±\u202f?")
    assert "the place on the earth is not known" in read.text and "temperature: not given" in read.text


def test_caveats_say_what_is_missing() -> None:
    texts = caveats(report("short"))
    assert texts[0].startswith("As surveyed: ") and "31 °C" in texts[0]
    assert report("short").survey.notes[0] in texts
    (third,) = [text for text in texts if text.startswith("Conductor 3")]
    assert "55\u00a0% of its length" in third and "18.00\u00a0m" in third
    assert "its support is not seen" in third
    refused = "Conductors 6, 9 and 12: its support is not seen."
    assert refused in caveats(report("long"))
    told = report("short")
    assert not [text for text in texts if "ground" in text]
    some = tuple(replace(one, ground_m=np.full_like(one.ground_m, np.nan)) for one in told.profiles[:2])
    assert "No ground is known below conductors 1 and 2." in caveats(replace(told, profiles=some))
    cloud = replace(told.survey.cloud, label=np.full_like(told.survey.cloud.label, CONDUCTOR))
    bare = caveats(Report(replace(told.survey, cloud=cloud)))
    assert "No ground is known: heights above ground cannot be told." in bare


def test_parts_of_different_surveys_are_told() -> None:
    told = report("short")
    with pytest.raises(SurveyError, match=r"A clearance is of conductor 9, .* has \[1, 2, 3, 4, 5\]"):
        replace(told, clearances=(replace(told.clearances[0], conductor=9),))
    with pytest.raises(SurveyError, match=r"A profile is of conductor 1, but .* has none"):
        replace(report("empty"), profiles=told.profiles)
    with pytest.raises(SurveyError, match=r"unscaled, so that .* 3\.0 m are required to vegetation"):
        replace(report("unscaled"), clearances=told.clearances)
    with pytest.raises(SurveyError, match=r"The 2 conductors of .* share ids"):
        Report(replace(told.survey, conductors=told.survey.conductors[:1] * 2))
    with pytest.raises(SurveyError, match="'flat' has 5 x 0 pixels"):
        html_page(Report(told.survey, pictures=(Picture("flat", np.zeros((0, 5, 3), np.uint8)),)))


def test_both_files_are_written(tmp_path: Path) -> None:
    write_report(tmp_path / "report.html", tmp_path / "survey.json", report("short"))
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == page("short")
    assert json.loads((tmp_path / "survey.json").read_text()) == survey_json(report("short"))
