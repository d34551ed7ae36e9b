"""TOML files of others: what Python's reader cannot stand is refused, and numbers fit into a float."""

from pathlib import Path

import pytest

from plnerf.errors import ConfigError, PlnerfError, SurveyError
from plnerf.mechanics.loads import load_states
from plnerf.scene.toml_files import Fields, read_toml
from plnerf.survey.thresholds import load_table

DEEP = "a = " + "[" * 100_000


def test_values_too_deeply_within_each_other_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "deep.toml"
    path.write_text(DEEP)
    with pytest.raises(ConfigError, match=r"deep\.toml is not valid TOML \(its values lie too deeply"):
        read_toml(path, "states", "state")
    with pytest.raises(SurveyError, match=r"deep\.toml is not valid TOML \(its values lie too deeply"):
        load_table(path)


@pytest.mark.parametrize("value", ["9" * 400, "-" + "9" * 400, "nan", "inf", "true", "'1'"])
def test_what_is_no_finite_number_is_refused(value: str, tmp_path: Path) -> None:
    path = tmp_path / "states.toml"
    path.write_text(f"[[state]]\nname = 'a'\ntemperature_c = {value}\n")
    with pytest.raises(PlnerfError, match="temperature_c, a number at least -80"):
        load_states(path)
    assert Fields({"x": 10**30}, "it").number("x") == 1e30
