"""The table of other states has a row for each state and wire, and is left out where none was computed."""

import csv
import math
from dataclasses import replace
from pathlib import Path

import pytest
from tests.support import surveys
from tests.support.states import with_states

from plnerf.export.exports import write_exports
from plnerf.export.state_rows import STATES, state_rows


def test_the_table_holds_loads_sags_and_curves(tmp_path: Path) -> None:
    survey = with_states(surveys.short(0.05))
    assert survey.states is not None and STATES in write_exports(survey, tmp_path).files
    with (tmp_path / STATES).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    phases = [wire for wire in survey.wires if wire.kind == "phase"]
    assert [(row["state"], int(row["wire"])) for row in rows] == [
        (state.load.name, wire.id) for state in survey.states.states for wire in phases
    ]
    hot, storm = rows[0], rows[len(phases)]
    one = survey.states.states[0].wires[0]
    assert float(hot["sag_m"]) == pytest.approx(one.sag.value, abs=1e-4)
    assert float(hot["sag_change_95_m"]) == pytest.approx(1.959964 * 0.03, abs=1e-4)
    assert float(hot["p_m"]) == pytest.approx(one.of(phases[0]).plane[2], abs=1e-3)
    assert float(storm["swing_deg"]) == pytest.approx(math.degrees(0.5), abs=1e-3)
    assert (storm["wind_pa"], storm["ice_mm"], hot["strength_share"]) == ("400.0", "10.0", "0.157")
    assert (hot["temperature_then_c"], hot["line"], hot["span"]) == ("31.0", "1", "1")


def test_without_states_there_is_no_table_and_an_earlier_one_goes(tmp_path: Path) -> None:
    survey = surveys.short(0.05)
    (tmp_path / STATES).write_text("of an earlier survey")
    assert state_rows(survey) == [] and STATES not in write_exports(survey, tmp_path).files
    assert not (tmp_path / STATES).exists()
    assert state_rows(replace(survey, states=None)) == []
