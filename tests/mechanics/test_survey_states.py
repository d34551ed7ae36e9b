"""A survey holds the states that the command line asks for."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from tests.support import surveys

from plnerf.cli import survey as survey_module
from plnerf.cli.main import main
from plnerf.mechanics.config import MechanicsConfig
from plnerf.survey.config import SurveyConfig
from plnerf.survey.config_rules import RulesConfig
from plnerf.survey.run import _finished

ALST = Path("243-al1-39-st1a")


def test_a_survey_has_states_of_its_phases_and_findings_about_them() -> None:
    pytest.importorskip("mechaphlowers", reason="plnerf[mechanics] is not installed")
    survey = replace(surveys.short(0.05), clearances=None, findings=())
    found = _finished(survey, SurveyConfig(temperature_c=20.0, mechanics=MechanicsConfig(ALST)))
    assert found.states is not None and [one.load.name for one in found.states.states] == [
        "50 °C", "75 °C", "100 °C"
    ]  # fmt: skip
    phases = [wire.id for wire in found.wires if wire.kind == "phase"]
    assert phases and [one.wire for one in found.states.states[1].wires] == phases
    for one in found.states.states[1].wires:
        wire = next(wire for wire in found.wires if wire.id == one.wire)
        assert wire.sag is not None and wire.sag.value < one.sag.value < wire.sag.value + 0.4
    assert any("Other states hold for these conductors" in one.text for one in found.findings)


def test_without_a_conductor_a_survey_says_so() -> None:
    found = _finished(replace(surveys.short(0.05), clearances=None, findings=()), SurveyConfig())
    assert found.states is None
    assert any("no conductor is given. Give --conductor" in one.text for one in found.findings)


def test_the_command_line_hands_on_rules_maps_and_voltage(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The voltage is the matrix's: 110 kV is no class of the table that counts where no rules are given."""
    pytest.importorskip("pyogrio", reason="plnerf[gis] is not installed")
    asked = []
    monkeypatch.setattr(survey_module, "survey_shown", lambda *given: asked.append(given[3]) or True)
    maps = [tmp_path / name for name in ("roads.geojson", "rail.geojson")]
    for path in maps:
        line = {"type": "LineString", "coordinates": [[8.0, 47.0], [8.001, 47.0]]}
        kind = {"class": path.stem.removesuffix("s")}
        row = {"type": "Feature", "properties": kind, "geometry": line}
        path.write_text(json.dumps({"type": "FeatureCollection", "features": [row]}))
    words = ["--rules", "gb-50545", "--voltage-kv", "110", "--rules.areas", "residential"]
    words += ["--objects", *map(str, maps)]
    monkeypatch.setattr(sys, "argv", ["plnerf", "survey", str(tmp_path), *words])
    main()
    (config,) = asked
    assert config.rules == RulesConfig(Path("gb-50545"), 110.0, tuple(maps), areas=("residential",))
    assert config.clearance.voltage_kv is None
    words = ["--rules", "fac-003-5", "--voltage-kv", "345", "--thresholds", "nerc-fac-003-4.toml"]
    monkeypatch.setattr(sys, "argv", ["plnerf", "survey", str(tmp_path), *words])
    main()
    assert asked[1].rules.voltage_kv == asked[1].clearance.voltage_kv == 345.0


def test_a_survey_is_judged_by_the_rules_it_is_given() -> None:
    config = SurveyConfig(rules=RulesConfig(Path("gb-50545"), 110.0))
    found = _finished(replace(surveys.short(0.2), clearances=None, findings=()), config)
    assert found.rules is not None and found.rules.judged
    assert any("GB 50545-2010 (example)" in one.text for one in found.findings)


def test_the_command_line_hands_on_conductor_states_and_temperature(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked = []
    monkeypatch.setattr(survey_module, "survey_shown", lambda *given: asked.append(given[3]) or True)
    words = ["--conductor", "acsr-drake", "--states", "nesc-250b", "--temperature-c", "25"]
    monkeypatch.setattr(
        sys, "argv", ["plnerf", "survey", str(tmp_path), *words, "--mechanics.temperature-sigma-c", "1"]
    )
    main()
    (config,) = asked
    assert config.mechanics == MechanicsConfig(Path("acsr-drake"), None, Path("nesc-250b"), 1.0)
    assert config.temperature_c == 25.0
