"""A survey's report is complete in one file and shows what the survey holds; no name breaks it."""

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from tests.support import many_spans, surveys
from tests.support.catenary_surveys import corridor
from tests.support.read_html import Read

from plnerf.errors import SurveyError
from plnerf.findings import Finding, harms, note
from plnerf.line.clearances import Clearances, Requirement
from plnerf.line.cloud import CONDUCTOR, Cloud
from plnerf.line.ends import Attached, Open, Quantity
from plnerf.line.files import survey_json
from plnerf.line.survey import Picture, Survey
from plnerf.line.wire import Wire
from plnerf.report.figures import Units, runs_of, wires_named
from plnerf.report.line_tables import span_table
from plnerf.report.nearest import by_need, worst
from plnerf.report.page import html_page, write_report
from plnerf.report.scene_view import scene
from plnerf.report.words import caveats, judged, merged, sorted_caveats
from plnerf.survey.clearance import measure_clearances
from plnerf.survey.config_ground import ClearanceConfig

NASTY = """<script>alert("1")</script> & 'q' </script><img src=x onerror=alert(2)> \\u003c"""
MADE = {
    "short": lambda: surveys.short(0.1),
    "long": lambda: surveys.long(0.7),
    "unscaled": surveys.unscaled,
    "empty": surveys.empty,
    "open_ended": lambda: surveys.open_ended(0.1),
    "two_lines": surveys.two_lines,
    "bent": many_spans.bent,
    "eight": many_spans.eight,
}
ABOUT = ("Heights are above the ellipsoid.",)


@cache
def report(name: str) -> Survey:
    return MADE[name]()


@cache
def page(name: str) -> str:
    return html_page(report(name), surveys.FILES, ABOUT)


def plus(one: Quantity | None, digits: int) -> str:
    assert one is not None
    return f"{one.value:,.{digits}f}\u202f±\u202f{1.959964 * one.sigma:.{digits}f}"


def clearances(survey: Survey) -> Clearances:
    assert survey.clearances is not None
    return survey.clearances


def with_wires(survey: Survey, wires: tuple[Wire, ...]) -> Survey:
    """The survey's first span with other wires."""
    line = survey.lines[0]
    return replace(survey, lines=(replace(line, spans=(replace(line.spans[0], wires=wires),)),))


@pytest.mark.slow
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
    assert text.startswith("<!doctype html>\n") and text.endswith("</html>\n")


@pytest.mark.slow
@pytest.mark.parametrize("name", MADE)
def test_a_page_is_small(name: str) -> None:
    assert len(page(name).encode()) < 2_000_000


def test_the_tables_hold_the_survey() -> None:
    survey, read = report("long"), Read(page("long"))
    rows = {row["wire"]: row for row in read.table("kind")}
    known = {row["wire"]: row for row in read.table("coverage")}
    assert len(rows) == len(known) == 12
    for span, wire in [(of, wire) for of in survey.spans for wire in of.wires]:
        row, seen = rows[str(wire.id)], wire.evidence
        assert row["sag, m ± 95 %"] == plus(wire.sag, 3)
        assert row["span length, m ± 95 %"] == plus(wire.span_m, 2)
        assert row["wire length, m ± 95 %"] == plus(wire.arc_m, 2)
        assert row["p, m ± 95 %"] == plus(wire.p_m, 1)
        assert (row["span"], row["kind"]) == (str(span.id), wire.kind)
        dense = survey.frame.to_world(wire.points(np.linspace(0, wire.base.length_m, 20_001)))
        lowest = float(row["its height, m ± 95 %"].split("\u202f")[0])
        assert lowest == pytest.approx(dense[:, 2].min(), abs=0.006)
        row = known[str(wire.id)]
        assert row["coverage"] == f"{100 * seen.coverage:.0f} %"
        assert row["longest gap, m"] == f"{seen.longest_gap_m:.2f}" and row["evidence"] == seen.source
        assert row["residual across, m"] == f"{seen.residual_across_m:.3f}"
        assert row["notes"] == (" ".join(wire.notes) or "–")
        assert (row["first end"], row["last end"]) == (f"structure {span.id}", f"structure {span.id + 1}")


def test_heights_and_places_are_those_of_the_world() -> None:
    survey, read = report("short"), Read(page("short"))
    for row, wire in zip(read.table("kind"), survey.wires, strict=True):
        ends = survey.frame.to_world(wire.points(np.array([0.0, wire.base.length_m])))
        shown = [row[f"height of {end} end, m ± 95 %"] for end in ("first", "last")]
        assert [float(text.split("\u202f")[0]) for text in shown] == pytest.approx(ends[:, 2], abs=0.006)
    for row, one in zip(read.table("structure"), survey.structures, strict=True):
        foot = [float(x) for x in row["foot x, y, z"].split(", ")]
        assert np.abs(foot - survey.frame.to_world(one.foot)).max() < 0.006
        assert (row["structure"], row["evidence"]) == (str(one.id), one.evidence)
        assert row["along the line, m ± 95 %"] == f"±\u202f{1.96 * one.sigma_m:.2f}"


def test_clearances_come_by_need_with_words() -> None:
    survey, rows = report("long"), Read(page("long")).table("verdict")
    places = clearances(survey).least_places()
    assert len(rows) == len(places) == 36
    margins = [float(row["margin, m"].replace("−", "-")) for row in rows]
    assert margins == sorted(margins)
    by_key = {(row.place.wire, row.to): row for row in by_need(survey)}
    for row in rows:
        one = by_key[int(row["wire"]), row["to"]]
        assert row["distance, m ± 95 %"] == plus(one.distance, 2)
        assert row["verdict"].split(maxsplit=1)[1] == clearances(survey).verdict(one.place)
        obstacle = [float(x) for x in row["on the obstacle x, y, z"].split(", ")]
        assert np.abs(obstacle - survey.frame.to_world(one.place.on_obstacle)).max() < 0.006
    least = worst(by_need(survey))
    assert {one.to for one in least} == {"ground", "vegetation", "ground, straight down"}
    for one in least:
        assert one.margin_m == min(other.margin_m for other in by_need(survey) if other.to == one.to)


@pytest.mark.parametrize(
    ("distance", "sigma", "required", "standing"),
    [
        (2.97, 0.01, 3.0, "short"),
        (2.99, 0.01, 3.0, "doubtful"),
        (3.01, 0.01, 3.0, "doubtful"),
        (3.03, 0.01, 3.0, "kept"),
        (3.001, 0.0, 3.0, "kept"),
        (0.1, 0.2, None, "open"),
    ],
)
def test_a_clearance_is_judged_with_its_uncertainty(
    distance: float, sigma: float, required: float | None, standing: str
) -> None:
    survey = report("short")
    found = clearances(survey).wires[0]
    place = replace(found.places["vegetation"][0], distance_m=distance, sigma_m=sigma)
    one = replace(found, places={**found.places, "vegetation": (place,), "ground": ()}, vertical=None)
    needed = None if required is None else Requirement(required, ("vegetation",), "3 m", "a table")
    rows = by_need(replace(survey, clearances=Clearances((one,), needed)))
    assert [row.standing for row in rows] == [standing]
    counts = {"short": "1 falls short", "doubtful": "1 is within its uncertainty", "kept": "1 is kept"}
    assert all((text in judged(rows)) == (kind == standing) for kind, text in counts.items())


def test_nothing_is_required_of_shield_wires_and_other_groups() -> None:
    survey = report("short")
    only = replace(clearances(survey), requirement=Requirement(5.0, ("vegetation",), "5 m", "a table"))
    rows = by_need(replace(survey, clearances=only))
    assert {row.standing == "open" for row in rows if row.place.wire == 5 or row.place.to == "ground"} == {
        True
    }
    assert "nothing is required" in Read(page("short")).text and len(rows) == 15
    is_open = [row.standing == "open" for row in rows]
    assert is_open == sorted(is_open)  # however near, they come last
    every = [row.place.distance_m for row in by_need(survey)]
    assert every != sorted(every)


def test_names_from_outside_are_shown_as_they_are() -> None:
    survey = report("short")
    first = survey.wires[0]
    named = replace(
        first, notes=(NASTY,), ends=(first.ends[0], Open(NASTY)), name=NASTY,
        evidence=replace(first.evidence, source=NASTY),
    )  # fmt: skip
    nasty = replace(
        with_wires(survey, (named, *survey.wires[1:])),
        source=NASTY, frame=replace(survey.frame, crs=NASTY), findings=(note("a", NASTY),),
        clearances=replace(clearances(survey), requirement=Requirement(5.0, ("ground",), NASTY, NASTY)),
        pictures=(Picture(NASTY, np.zeros((20, 30, 3), np.uint8), (np.zeros((0, 2)),) * 5),),
        made={NASTY: NASTY},
    )  # fmt: skip
    line = nasty.lines[0]
    masts = tuple(replace(one, name=NASTY, evidence=NASTY) for one in line.structures)
    nasty = replace(nasty, lines=(replace(line, structures=masts),))
    text = html_page(nasty, (NASTY, "b"), (NASTY,))
    read = Read(text)
    assert len(read.scripts) == len(Read(page("short")).scripts) == 2
    assert not [tag for tag, name, _ in read.attributes if name == "onerror"]
    assert "alert(2)" not in re.sub("&lt;img.*?&gt;", "", text)
    assert read.text.count('<script>alert("1")</script>') > 14


def test_the_drawing_s_numbers_cannot_end_its_script() -> None:
    survey = report("short")
    read = Read(page("short"))
    assert json.loads(read.scripts[0]) == scene(survey, by_need(survey))
    assert "<" not in read.scripts[0]


def test_a_survey_without_wires_says_so() -> None:
    read = Read(page("empty"))
    assert "No wire was found among" in read.text
    assert "No wire was found, so that there is none to list." in read.text
    assert "Without wires there is no span to draw." in read.text
    assert "No structure is known." in read.text and read.tables == []
    bare = replace(report("empty"), cloud=Cloud.empty())
    assert "There are neither points nor wires to draw." in Read(html_page(bare)).text


def test_an_unscaled_survey_names_no_metres() -> None:
    survey, read = report("unscaled"), Read(page("unscaled"))
    assert "units, unscaled" in read.text and "Units, unscaled" in read.text
    words = read.text + " ".join(value for _, name, value in read.attributes if name in ("aria-label", "alt"))
    words = words.replace("there are no distances in metres", "")
    assert not re.search(r"\bm\b|metre|\bcm\b|\bmm\b", words), re.search(r".{30}(\bm\b|metre).{20}", words)
    row = read.table("kind")[0]
    assert row["span length, units ± 95 %"] == plus(survey.wires[0].span_m, 2)
    lowest = float(row["its height, units ± 95 %"].split("\u202f")[0])
    assert lowest == pytest.approx(survey.wires[0].lowest[1], abs=0.006)


def test_open_ends_have_a_dash_and_the_reason() -> None:
    survey, read = report("open_ended"), Read(page("open_ended"))
    for row, wire in zip(read.table("kind"), survey.wires, strict=True):
        assert {row[f"{name}, m ± 95 %"] for name in ("sag", "span length", "wire length", "p")} == {"–"}
        assert row["no sag, span length and p, because"] == wire.open
    assert {row["last end"] for row in read.table("coverage")} == {"open: not filmed beyond it"}
    because = "because the last end is open (not filmed beyond it)"
    assert f"sag – 5 wires have none, {because}" in read.text
    assert f"Wires 1 to 5: no sag, span length and p, {because}." in read.text
    assert "of unknown length" in read.text
    assert "no sag" not in page("short")


def test_one_open_wire_is_named_beside_the_others_sag() -> None:
    survey = report("short")
    first = replace(survey.wires[0], ends=(Open("hidden"), survey.wires[0].ends[1]))
    read = Read(html_page(with_wires(survey, (first, *survey.wires[1:]))))
    assert "of 4 wires; 1 wire has none, because the first end is open (hidden)" in read.text
    reasons = [row["no sag, span length and p, because"] for row in read.table("kind")]
    assert reasons == ["the first end is open (hidden)", "–", "–", "–", "–"]


def test_lines_spans_and_structures_are_numbered_as_in_the_survey() -> None:
    read = Read(page("two_lines"))
    assert [row["line / span"] for row in read.table("kind")] == ["1 / 1"] * 5 + ["2 / 1"] * 5
    assert [row["wire"] for row in read.table("kind")] == [str(k) for k in range(1, 11)]
    numbers = [(row["line"], row["structure"]) for row in read.table("structure")]
    assert numbers == [("1", "1"), ("1", "2"), ("2", "1"), ("2", "2")]
    assert {row["line / span"] for row in read.table("verdict") if int(row["wire"]) > 5} == {"2 / 1"}
    assert "Line 2, span 1: structures 1 and 2, 40.8 m" in read.text.replace("\u00a0", " ")
    assert "2 spans of 2 lines" in read.text and "Line 2, span 1" in read.text
    assert [row["span"] for row in Read(page("long")).table("kind")] == ["1"] * 6 + ["2"] * 6


def test_spans_are_listed_with_stations_directions_swings_and_open_ends() -> None:
    survey, read = report("bent"), Read(page("bent"))
    rows = read.table("open ends")
    assert [row["line / span"] for row in rows] == ["1 / 1", "1 / 2", "1 / 3", "2 / 4"]
    assert [row["structures"] for row in rows] == ["1 to 2", "2 to 3", "3 to –", "4 to 5"]
    assert [row["from station, m"] for row in rows] == ["0.0", "80.6", "172.4", "0.0"]
    assert [row["swing, ° ± 95 %"] for row in rows] == ["–", "6.0\u202f±\u202f0.2", "–", "–"]
    assert [row["open ends"] for row in rows] == ["–", "–", "last", "–"]
    assert "Why ends are open: not filmed." in read.text and "Why ends" not in Read(page("short")).text
    assert [row["wires"] for row in rows] == ["1–4", "5–8", "9–12", "13–15"]
    swings = [row["swing, ° ± 95 %"] for row in read.table("wire length, m ± 95 %")]
    assert swings[4:8] == ["6.0\u202f±\u202f0.2"] * 4 and set(swings[:4] + swings[8:]) == {"–"}
    structures = read.table("line angle")
    assert [row["kind"] for row in structures] == [one.kind for one in survey.structures]
    assert [row["line angle"] for row in structures] == ["–", "0.4°", "27.1°", "–", "–"]
    assert [row["station, m"] for row in structures] == ["0.0", "80.6", "172.4", "0.0", "114.0"]
    assert "swing" not in page("short").split('<section id="wires">')[1]


def test_the_swing_of_a_wire_that_runs_against_its_chain_is_to_the_other_side() -> None:
    survey = report("bent")
    line = survey.lines[0]
    span = line.spans[1]

    def turned(wire: Wire) -> Wire:
        base = replace(wire.base, a=wire.base.b, b=wire.base.a)
        theta = wire.theta[[1, 0, 3, 2, 4, 5]] * [-1, -1, 1, 1, 1, -1]
        return replace(wire, base=base, theta=theta, ends=wire.ends[::-1])

    back = replace(span, structures=(3, 2), wires=tuple(map(turned, span.wires)))
    spans = (line.spans[0], back, line.spans[2])
    found = span_table(replace(survey, lines=(replace(line, spans=spans), survey.lines[1])))
    same = span_table(survey)
    assert found is not None and same is not None and found.rows == same.rows


def test_lines_that_cross_are_stated_and_nothing_is_required_of_them() -> None:
    survey, read = report("bent"), Read(page("bent"))
    least = clearances(survey).crossings[0]
    (row,) = read.table("wire below")
    assert (row["above: line / span"], row["wire"]) == ("1 / 2", str(least.upper))
    assert (row["below: line / span"], row["wire below"]) == ("2 / 4", str(least.lower))
    assert row["distance, m ± 95 %"] == plus(Quantity(least.distance_m, least.sigma_m), 2)
    assert "Crossing lines" not in page("two_lines") and "least between crossing lines" in read.text


def test_a_long_line_has_its_worst_clearances_first_and_all_of_them_folded() -> None:
    survey, read = report("eight"), Read(page("eight"))
    tables = [rows for rows in read.tables if "verdict" in rows[0]]
    every = by_need(survey)
    assert len(tables[1]) == len(every) + 1 and f"All {len(every)} least clearances" in read.text
    assert "All" not in Read(page("long")).text.split("Clearances")[1].split("Wires")[0]
    short = [dict(zip(tables[0][0], row, strict=True)) for row in tables[0][1:]]
    spans = {str(span.id) for span in survey.spans}
    for to in ("ground", "vegetation", "ground, straight down"):
        assert {row["span"] for row in short if row["to"] == to} == spans
    distances = {(one.place.wire, one.to): one.place.distance_m for one in every}
    for row in short:
        wires = next(span.wires for span in survey.spans if str(span.id) == row["span"])
        phases = [
            distance
            for (wire, to), distance in distances.items()
            if to == row["to"] and wire in {one.id for one in wires if one.kind == "phase"}
        ]
        assert row["distance, m ± 95 %"].startswith(f"{min(phases):.2f}") or "closer" in row["verdict"]
    headings = [row[0] for rows in read.tables for row in rows if len(row) == 1]
    assert headings[:8] == headings[8:] and headings[1] == "Span 2: structures 2 and 3, 310.0 m"


def test_what_is_not_known_is_shown_as_unknown() -> None:
    survey = report("short")
    unknown = replace(survey.wires[0], covariance=np.full((6, 6), np.nan))
    frame = replace(survey.frame, crs=None, origin_lon_lat_height=None)
    bare = replace(with_wires(survey, (unknown,)), frame=frame, clearances=None, pictures=())
    bare = replace(bare, temperature_c=None)
    text = html_page(bare)
    read = Read(text)
    drawn = text[text.index("<svg") : text.index("</svg>")]
    assert "nan" not in drawn and not re.search(r"\bnan\b", read.text)
    assert read.table("kind")[0]["sag, m ± 95 %"].endswith("±\u202f?")
    assert "the place on the earth is not known" in read.text and "temperature: not given" in read.text
    row = survey_json(bare)["lines"][0]["spans"][0]["wires"][0]
    assert row["sag"]["sigma"] is None and row["covariance"][0] == [None] * 6


def test_caveats_say_what_is_missing() -> None:
    survey = report("short")
    texts = caveats(survey)
    assert texts[0].startswith("As surveyed: ") and "31 °C" in texts[0]
    assert survey.findings[0].text in texts
    (third,) = [text for text in texts if "evidence" in text]
    assert third.startswith("Wire 3: ") and "55\u00a0% of its length" in third and "18.00\u00a0m" in third
    assert "Wires 3, 6, 9 and 12: its support is not seen." in caveats(report("long"))
    assert not [text for text in texts if "ground" in text]
    some = tuple(
        replace(one, profile=replace(one.profile, ground_z=np.full_like(one.profile.ground_z, np.nan)))
        for one in clearances(survey).wires[:2]
    )
    unknown = replace(survey, clearances=replace(clearances(survey), wires=some))
    assert "No ground is known below wires 1 and 2." in caveats(unknown)
    cloud = replace(survey.cloud, label=np.full_like(survey.cloud.label, CONDUCTOR))
    bare = caveats(replace(survey, cloud=cloud, clearances=None))
    assert "No ground is known, and so no height above ground." in bare


def test_what_limits_the_figures_stands_open_and_notes_are_folded_by_matter() -> None:
    found = (
        note("b", "One note."), harms("a", "It harms."), note("b", "Another."), harms("a", "It harms too."),
    )  # fmt: skip
    survey = replace(report("short"), findings=found)
    main, notes = sorted_caveats(survey)
    assert [one.texts for one in main if one.about == "a"] == [("It harms.", "It harms too.")]
    assert [(one.about, one.texts) for one in notes] == [("b", ("One note.", "Another."))]
    text = html_page(survey)
    folded = text[text.index("<details><summary>Notes") : text.index("</details>")]
    assert "One note. Another." in folded and "It harms." not in folded and "It harms." in text


def test_the_gravest_findings_come_first_and_each_once() -> None:
    survey, one = report("short"), note("a", "A note.")
    found = (one, harms("b", "Something harms.", "Do this."), one, Finding("c", "stops", "It stops."))
    texts = caveats(replace(survey, findings=found))
    at = [texts.index(one) for one in ("It stops.", "Something harms. Do this.", "A note.")]
    assert at == sorted(at) and texts[1] == "It stops." and texts.count("A note.") == 1


def test_that_figures_are_as_surveyed_is_said_once() -> None:
    survey = corridor(count=200)
    found, findings = measure_clearances(survey, ClearanceConfig())
    texts = caveats(replace(survey, clearances=found, findings=findings))
    assert len([text for text in texts if "as surveyed" in text.lower()]) == 1


def test_a_loose_sag_and_a_doubtful_wire_are_named() -> None:
    survey = report("short")
    loose = replace(survey.wires[0], covariance=np.diag([0, 0, 0, 0, 0.2, 0]) ** 2)
    doubtful = replace(survey.wires[1], evidence=replace(survey.wires[1].evidence, certain=False))
    texts = caveats(with_wires(survey, (loose, doubtful)))
    assert any(text.startswith("Wire 1: its sag is uncertain, 1.210") for text in texts)
    assert "Wire 2: what was seen does not fix its place." in texts


def test_notes_that_differ_in_figures_become_one() -> None:
    texts = ["bows 0.24 m at structure 2", "bows 1,000.5 m at structure 2", "bows 3.10 m at structure 2"]
    assert merged(texts) == "bows 0.24 to 1,000.5 m at structure 2" and merged(texts[:1]) == texts[0]
    survey = report("short")
    notes = ("It bows 0.24 m.", "It bows 0.31 m.", "It ends at structure 1.", "It ends at structure 2.")
    wires = tuple(replace(wire, notes=(text,)) for wire, text in zip(survey.wires, notes, strict=False))
    texts = caveats(with_wires(survey, wires))
    assert "Wires 1 and 2: it bows 0.24 to 0.31 m." in texts
    assert {"Wire 3: it ends at structure 1.", "Wire 4: it ends at structure 2."} <= set(texts)


def test_an_interval_is_never_rounded_to_nothing() -> None:
    units = Units("m")
    assert units.interval(Quantity(0.1712, 0.002)) == "0.171\u202f±\u202f0.004"
    assert units.interval(Quantity(0.1712, 0.02)) == "0.17\u202f±\u202f0.04"
    assert units.interval(Quantity(12.0, 0.0), 1) == "12.000\u202f±\u202f0.000"  # exact, as if given
    assert units.interval(None) == "–" and units.interval(Quantity(1.0, np.nan)).endswith("?")


def test_where_nothing_is_required_nothing_is_judged() -> None:
    survey = report("short")
    free = Read(html_page(replace(survey, clearances=replace(clearances(survey), requirement=None))))
    rows = free.table("to")
    assert len(rows) == 15 and "verdict" not in rows[0] and "required, m" not in rows[0]
    assert "Nothing is required: give a voltage" in free.text and "nothing is required" not in free.text
    distances = [float(row["distance, m ± 95 %"].split("\u202f")[0]) for row in rows]
    assert distances == sorted(distances)


def test_wires_are_named_by_runs() -> None:
    assert wires_named([4]) == "wire 4" and wires_named([2, 1]) == "wires 1 and 2"
    assert wires_named([1, 2, 3, 5, 8, 9, 10, 11]) == "wires 1 to 3, 5 and 8 to 11"
    assert runs_of([1, 2, 3, 5, 8, 9]) == "1–3, 5, 8, 9"


def test_a_world_whose_z_is_not_up_is_not_shown() -> None:
    survey = report("short")
    lying = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
    read = Read(html_page(replace(survey, frame=replace(survey.frame, R_line_world=lying))))
    assert "Metres in the survey's own frame, z up." in read.text
    lowest = float(read.table("kind")[0]["its height, m ± 95 %"].split("\u202f")[0])
    assert lowest == pytest.approx(survey.wires[0].lowest[1], abs=0.006)


def test_parts_of_different_surveys_are_refused() -> None:
    survey = report("short")
    strange = replace(clearances(survey).wires[0], wire=9)
    with pytest.raises(SurveyError, match=r"A clearance is of wire 9, .* has \[1, 2, 3, 4, 5\]"):
        html_page(replace(survey, clearances=Clearances((strange,))))
    with pytest.raises(SurveyError, match=r"A clearance is of wire 1, but .* has none"):
        html_page(replace(report("empty"), clearances=clearances(survey)))
    with pytest.raises(SurveyError, match=r"unscaled, so that .* 5\.0 m are required \(5 m\)"):
        html_page(replace(report("unscaled"), clearances=clearances(survey)))
    with pytest.raises(SurveyError, match=r"The 2 wires of .* share ids"):
        html_page(with_wires(survey, survey.wires[:1] * 2))
    with pytest.raises(SurveyError, match="'flat' has 5 x 0 pixels"):
        flat = Picture("flat", np.zeros((0, 5, 3), np.uint8), (np.zeros((0, 2)),) * 5)
        html_page(replace(survey, pictures=(flat,)))


def test_the_protocol_says_how_it_was_made() -> None:
    survey, read = report("short"), Read(page("short"))
    for name, value in survey.made.items():
        assert f"{name} {value}" in read.text
    assert "5 m (given by the user)" in read.text and ABOUT[0] in read.text
    assert "cloud.laz, conductors.geojson, conductors.csv and clearances.csv" in read.text
    assert isinstance(survey.wires[0].ends[0], Attached)


def test_the_page_is_written(tmp_path: Path) -> None:
    write_report(tmp_path / "report.html", report("short"), surveys.FILES, ABOUT)
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == page("short")
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
