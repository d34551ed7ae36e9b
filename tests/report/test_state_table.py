"""A report shows other states as tables and as curves in the profile, or says what is missing for them."""

import re
from dataclasses import replace

from tests.support import surveys
from tests.support.states import with_states

from plnerf.findings import note
from plnerf.line.survey import Survey
from plnerf.report.page import html_page
from plnerf.report.profile import profiles
from plnerf.report.state_table import state_tables

SURVEY: Survey = with_states(surveys.short(0.05))


def test_every_wire_has_a_row_in_every_state() -> None:
    hot, storm = state_tables(SURVEY)
    phases = [wire for wire in SURVEY.wires if wire.kind == "phase"]
    assert [row[0] for row in hot.rows] == [str(wire.id) for wire in phases]
    state = SURVEY.states.states[0].wires[0]  # type: ignore[union-attr]
    assert hot.rows[0][4] == f"{state.sag.value:.2f}\u202f±\u202f{1.959964 * 0.04:.2f}"
    assert hot.rows[0][6] == "12.3\u202f±\u202f0.5" and hot.rows[0][8] == "16\u00a0%"
    assert hot.caption.startswith("75 °C. Sag") and "Blown out" not in hot.caption
    assert storm.caption.startswith("storm <b>, to the left: 5 °C, 10 mm of ice of 600 kg/m³, wind of 400 Pa")
    column = storm.columns.index("blown out,\u00a0m")
    assert 0.3 < float(str(storm.rows[0][column])) < 1.0  # sin(0.5) of a sag of 1.2 m


def test_the_profile_has_a_dashed_curve_of_every_state_and_holds_it() -> None:
    (drawing,) = profiles(SURVEY, [])
    count = sum(len(one.wires) for one in SURVEY.states.states)  # type: ignore[union-attr]
    curves = re.findall(r'<polyline class="state" points="([^"]*)"[^>]*>', drawing.svg)
    assert len(curves) == count and "Thin dashed curves: the same wires in other states" in drawing.about
    legend = re.findall(r'stroke-dasharray="([^"]*)"/><text [^>]*>([^<]*)</text>', drawing.svg)
    assert legend == [("2 3", "75 °C"), ("8 3 2 3", "storm &lt;b&gt;, to the left")]
    assert "<title>wire 1, storm &lt;b&gt;, to the left</title>" in drawing.svg
    surveyed = re.findall(r'<polyline points="([^"]*)"', drawing.svg)
    lowest = max(float(point.split(",")[1]) for point in surveyed[0].split())
    assert max(float(point.split(",")[1]) for point in curves[0].split()) > lowest + 1  # hangs lower


def test_winds_from_both_sides_share_their_dashes() -> None:
    assert SURVEY.states is not None
    hot, left = SURVEY.states.states
    right = replace(left, load=replace(left.load, name="to the right", wind_pa=-left.load.wind_pa))
    survey = replace(SURVEY, states=replace(SURVEY.states, states=(left, right, hot)))
    (drawing,) = profiles(survey, [])
    legend = re.findall(r'stroke-dasharray="([^"]*)"/><text [^>]*>([^<]*)</text>', drawing.svg)
    assert legend == [("2 3", "storm &lt;b&gt;, to the left / to the right"), ("8 3 2 3", "75 °C")]


def test_the_page_escapes_names_and_states_the_temperature() -> None:
    page = html_page(SURVEY)
    assert "storm &lt;b&gt;, to the left" in page and "storm <b>" not in page
    assert "conductors at 31.0 ± 5.9 °C (95\u00a0%) when surveyed, given; phase: a conductor" in page


def test_without_states_the_page_says_what_is_missing() -> None:
    missing = note("other states", "Not computed: no conductor is given.", "Give --conductor.")
    survey = replace(SURVEY, states=None, findings=(missing,))
    section = html_page(survey).split('<section id="states">')[1].split("</section>")[0]
    assert "Not computed: no conductor is given. Give --conductor." in section
    bare = replace(SURVEY.states, states=tuple(replace(one, wires=()) for one in SURVEY.states.states))  # type: ignore[arg-type, type-var, union-attr]
    missing = note("other states", "Of wire 1 no other state is known: the last end is open.")
    section = html_page(replace(survey, states=bare, findings=(missing,))).split('<section id="states">')[1]
    assert "Of wire 1 no other state is known: the last end is open." in section.split("</section>")[0]
    assert "Without a scale no other state is known." in html_page(surveys.unscaled(0.05))
