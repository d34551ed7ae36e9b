"""A survey's report is complete in one file and says what the survey says; no name breaks it."""

import base64
import json
import re
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import surveys
from plnerf.errors import SurveyError
from plnerf.survey.model import CONDUCTOR, GROUND, HIGH_VEGETATION, Cloud
from plnerf.survey.overlay import ASIDE, LEAST_ASIDE_PX, overlay
from plnerf.survey.report import html_page, write_report
from plnerf.survey.report_data import Clearance, Picture, Profile, Report
from plnerf.survey.report_json import survey_json
from plnerf.survey.report_profile import profile
from plnerf.survey.report_side import below, fitting, runs, side_of, ticks
from plnerf.survey.report_view import MOST_POINTS, scene, thinned
from plnerf.survey.report_words import caveats, judged
from plnerf.wires.catenary import hang

NASTY = """<script>alert("1")</script> & 'q' </script><img src=x onerror=alert(2)> \\u003c"""
VOID = {"meta", "link", "img", "input", "br"}
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


class Read(HTMLParser):
    """A page's elements, whose tags must match; its texts, tables, attributes and scripts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.texts: list[str] = []
        self.tables: list[list[list[str]]] = []
        self.attributes: list[tuple[str, str, str]] = []
        self.scripts: list[str] = []
        self.ids: list[str] = []
        self.feed(text)
        self.close()
        assert not self.open, f"never closed: {self.open}"

    def handle_starttag(self, tag: str, attrs: list) -> None:
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        self.ids += [value for name, value in attrs if name == "id"]
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self.tables[-1][-1].append("")
        elif tag == "script":
            self.scripts.append("")
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        last = self.open.pop()
        assert last == tag, f"</{tag}> closes <{last}> at {self.getpos()}"

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "script":
            self.scripts[-1] += data
        elif not self.open or self.open[-1] != "style":
            self.texts.append(data)
            if {"td", "th"} & set(self.open):
                self.tables[-1][-1][-1] += data.replace("\u00a0", " ")

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.texts).split())

    def table(self, column: str) -> list[dict[str, str]]:
        """Rows, by their columns' names, of the first table with such a column."""
        rows = next(rows for rows in self.tables if column in rows[0])
        return [dict(zip(rows[0], row, strict=True)) for row in rows[1:]]


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
        if one.before is None:
            assert row["note"] == one.note and row["change, m"] == "–"
        else:
            before = one.before.curve.sag_m
            assert row["sag before refinement, m ± 95 %"] == plus(before, one.before.sag_sigma_m, 3)
            change = float(row["change, m"].replace("−", "-"))
            assert change == pytest.approx(curve.sag_m - before, abs=6e-4)


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
        told.survey, conductors=conductors, source=NASTY, crs=NASTY, notes=(NASTY,), extra={NASTY: 1.0}
    )
    clearances = (replace(told.clearances[0], to=NASTY, verdict=NASTY),)
    picture = Picture(NASTY, np.zeros((20, 30, 3), np.uint8))
    nasty = Report(survey, clearances, told.profiles, (picture,), (NASTY, "b"), {NASTY: NASTY})
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
        assert (row["before_refinement"] is None) == (one.before is None)
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
    assert "55\u00a0% of its length" in third and "18.00\u00a0m" in third and "4.1 px across" in third
    refused = "Conductors 6, 9 and 12: not refined: the views do not fix it (4.1 px across)."
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


# The view in space


def positions(data: dict) -> np.ndarray:
    """What the page's script makes of the points: counted from the middle of the box."""
    steps = np.frombuffer(base64.b64decode(data["xyz"]), "<u2").reshape(-1, 3)
    return data["corner"] + steps * data["step"]


def test_points_come_out_where_they_are() -> None:
    told = report("short")  # far fewer than are drawn at most: none is left out
    data = scene(told)
    held = np.concatenate([one.fit.curve.points(np.linspace(0, 1, 9) * one.fit.curve.span_m)
                           for one in told.survey.conductors])  # fmt: skip
    assert data["count"] == len(told.survey.cloud.xyz) < MOST_POINTS
    shift = told.survey.cloud.xyz - positions(data)
    assert np.ptp(shift, axis=0).max() < 0.002  # of a box of 100 m
    wire = np.array(data["wires"][0]["points"]) + shift.mean(0)
    assert np.abs(wire[[0, -1]] - held[[0, 8]]).max() < 0.002
    mark, worst = data["marks"][0], told.worst()[0]
    apart = np.linalg.norm(np.subtract(*mark["points"]))
    assert apart == pytest.approx(worst.distance_m, abs=1e-4) and f"{worst.distance_m:.2f}" in mark["text"]


def test_a_grid_far_from_the_origin_keeps_its_millimetres() -> None:
    told, move = report("short"), np.array([5e5, 5.7e6, 300.0])
    cloud = replace(told.survey.cloud, xyz=told.survey.cloud.xyz + move)
    conductors = tuple(
        replace(one, fit=replace(one.fit, base=replace(one.fit.base, o=one.fit.base.o + move[:2]),
                                 q=one.fit.q + move[2] * np.array([0, 0, 1, 1, 0])))
        for one in told.survey.conductors
    )  # fmt: skip
    towers = tuple(replace(one, foot=one.foot + move) for one in told.survey.towers)
    near = scene(Report(replace(told.survey, towers=towers, conductors=conductors, cloud=cloud)))
    here = scene(Report(told.survey))
    assert np.abs(positions(near) - positions(here)).max() < 0.004
    for a, b in zip(near["wires"], here["wires"], strict=True):
        assert np.abs(np.subtract(a["points"], b["points"])).max() < 1e-5


def test_points_are_thinned_evenly_and_every_class_stays() -> None:
    random = np.random.default_rng(0)
    n = 3 * MOST_POINTS
    xyz = random.uniform([0, 0, 0], [200, 60, 0.1], (n, 3))
    xyz[: n // 2, 0] /= 10  # a dense end
    label = np.full(n, GROUND, np.uint8)
    label[:40] = CONDUCTOR
    xyz[40:50] += 1e5
    cloud = Cloud(xyz, label, np.zeros(n, np.int64))
    wire = np.column_stack([np.linspace(0, 200, 41), np.full(41, 30.0), np.full(41, 20.0)])
    kept, edge = thinned(cloud, wire, 50.0)
    assert MOST_POINTS / 2 < len(kept) <= MOST_POINTS and len(set(kept.tolist())) == len(kept)
    assert not set(range(40, 50)) & set(kept.tolist())  # far from everything
    assert (label[kept] == CONDUCTOR).sum() > 20
    ground = xyz[kept][label[kept] == GROUND]
    counts = [((ground[:, 0] >= x) & (ground[:, 0] < x + 10)).sum() for x in (0, 10)]
    apart = np.abs(xyz[kept][:, None, :2] - wire[None, :, :2])
    assert np.hypot(*np.moveaxis(apart, 2, 0)).min(1).max() <= 50.0
    most = 600 / edge**2  # cubes in 10 m x 60 m
    assert all(0.6 * most < count <= 2.2 * most for count in counts)


# Profiles


def test_profiles_of_a_span_are_put_together() -> None:
    told = report("short")
    conductors = told.spans[0]
    under = below(side_of(conductors), conductors, list(told.profiles))
    assert (under.lowest <= under.highest + 1e-9)[np.isfinite(under.lowest)].all()
    every = np.concatenate([one.ground_m for one in told.profiles])
    assert np.nanmin(under.lowest) == pytest.approx(np.nanmin(every), abs=0.02)
    tops = np.concatenate([one.vegetation_m for one in told.profiles])
    assert np.nanmax(under.vegetation) == pytest.approx(np.nanmax(tops), abs=0.1)
    alone = below(side_of(conductors), conductors, [told.profiles[0]])
    assert ((under.lowest <= alone.lowest + 1e-9) | np.isnan(alone.lowest)).all()


def test_wires_fitted_from_either_end_share_an_axis() -> None:
    told = report("short")
    first, second = told.spans[0][:2]
    base = second.fit.base
    q = second.fit.q[[1, 0, 3, 2, 4]] * [-1, -1, 1, 1, 1]
    back = replace(base, o=base.o + base.length_m * base.u, u=-base.u)
    turned = replace(second, fit=replace(second.fit, base=back, q=q))
    assert np.abs(np.subtract(turned.fit.curve.a, second.fit.curve.b)).max() < 1e-9
    one, other = side_of([first, second]), side_of([first, turned])
    assert np.abs(one.u - other.u).max() < 1e-12 and one.length == pytest.approx(other.length)
    assert one.length == pytest.approx(40.0, abs=0.2)


@pytest.mark.parametrize("corners", [(0.0, 40.0, -1.0, 16.0), (-5.0, 320.0, 0.0, 50.0), (0.0, 9e2, 3.0, 4.0)])
def test_a_drawing_fits_and_says_how_it_is_stretched(corners: tuple[float, float, float, float]) -> None:
    first, last, low, high = corners
    scale = fitting(first, last, low, high)
    assert scale.x(last) <= 1100 and scale.height <= 440.001
    assert scale.bottom <= low and scale.top >= high
    up = (scale.y(low) - scale.y(high)) / (high - low)
    along = (scale.x(last) - scale.x(first)) / (last - first)
    assert up / along == pytest.approx(scale.exaggeration)


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (-3.2, 17.0), (1e-3, 4e-3), (0.0, 812.0)])
def test_ticks_are_round_and_inside(low: float, high: float) -> None:
    found = ticks(low, high, 6.0)
    step = np.diff(found)
    assert 3 <= len(found) <= 13 and found[0] >= low - 1e-9 and found[-1] <= high + 1e-9
    assert f"{step[0]:.12e}"[0] in "125" and np.allclose(step, step[0])


def test_runs_are_the_stretches_that_are_true() -> None:
    good = np.array([1, 1, 0, 1, 0, 0, 1, 1, 1], bool)
    assert runs(good) == [slice(0, 2), slice(6, 9)]
    assert runs(np.zeros(4, bool)) == [] and runs(np.ones(4, bool)) == [slice(0, 4)]


def test_a_profile_states_its_stretch_and_what_is_not_known() -> None:
    long = "".join(Read(profile(report("long"), 0)).texts)
    assert "heights exaggerated" in long and "no ground known" not in long
    told = report("short")
    unknown = tuple(replace(one, ground_m=np.full_like(one.ground_m, np.nan)) for one in told.profiles)
    text = "".join(Read(profile(replace(told, profiles=unknown), 0)).texts)
    assert "at the same scale" in text and "no ground known" in text
    worst = told.worst()[0]
    assert f"conductor {worst.conductor}" in text and worst.verdict in text


# Wires over photos


def test_lines_lie_beside_the_wire_and_leave_it_free() -> None:
    grey, x = np.full((300, 640, 3), 90, np.uint8), np.linspace(-30, 700, 80)
    line = np.column_stack([x, 80.5 + 0.002 * (x - 320) ** 2 / 4])
    drawn = overlay(grey, [line], [(255, 0, 0)])
    assert (grey == 90).all()
    aside = max(LEAST_ASIDE_PX, 640 * ASIDE)
    for column in (5, 320, 600):
        rows = np.flatnonzero(drawn[:, column, 0] > 150)
        slope = np.interp(column + 0.5, x, np.gradient(line[:, 1], x))
        middle = np.interp(column + 0.5, x, line[:, 1])
        weight = drawn[:, column, 0].astype(float) - 90
        assert np.average(np.arange(300) + 0.5, weights=weight) == pytest.approx(middle, abs=0.3)
        assert np.ptp(rows) == pytest.approx(2 * aside * np.hypot(1, slope), abs=2.0)
        around = slice(round(middle - 0.5) - 1, round(middle - 0.5) + 2)
        assert (drawn[around, column] == 90).all()
    assert (drawn[..., 2] <= 90).all()


@pytest.mark.parametrize("degrees", [0, 35, 90, 125, 200])
def test_lines_keep_their_distance_whichever_way_the_wire_runs(degrees: int) -> None:
    u = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    line = [150.0, 150.0] + np.linspace(-100, 100, 30)[:, None] * u
    drawn = overlay(np.zeros((300, 300, 3), np.uint8), [line], [(255, 255, 255)])
    row, column = np.nonzero(drawn[..., 0] > 100)
    across = (np.column_stack([column, row]) + 0.5 - 150) @ [-u[1], u[0]]
    assert np.abs(np.abs(across) - LEAST_ASIDE_PX).max() < 0.8
    assert abs((across > 0).mean() - 0.5) < 0.05


def test_what_cannot_be_seen_is_not_drawn() -> None:
    grey = np.full((200, 300, 3), 90, np.uint8)
    line = np.column_stack([np.linspace(0, 300, 61), np.full(61, 100.0)])
    line[20:41] = np.nan
    line[-1] = [1e12, -1e12]
    drawn = overlay(grey, [line], [(0, 0, 255)])
    painted = (drawn != 90).any((0, 2))
    assert painted[5:90].all() and not painted[105:198].any() and painted[210:285].all()
    assert (overlay(grey, [np.zeros((0, 2))], [(1, 2, 3)]) == grey).all()


def test_the_helper_draws_the_wires_that_it_says() -> None:
    told = report("short")
    assert len(told.survey.conductors) == 5 and len(report("long").survey.conductors) == 12
    true = hang((-20.0, -3.1, 10.0), (20.0, -2.7, 10.9), 1.21)
    assert told.survey.conductors[0].fit.curve.sag_m == pytest.approx(true.sag_m, abs=0.02)
    assert (told.survey.cloud.label == HIGH_VEGETATION).any()
    assert isinstance(told.profiles[0], Profile)
