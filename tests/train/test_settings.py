"""Settings survive JSON exactly, and whatever is not exactly a setting is refused with a text of its own.

The texts are stored in tests/snapshots/settings_*.txt; ``pytest --update-snapshots`` writes them anew.
"""

import dataclasses
import json
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.conftest import SNAPSHOTS
from tests.support.changed import changed

from plnerf.errors import ConfigError
from plnerf.presets import preset_names
from plnerf.presets._find import find_preset
from plnerf.train.config import LossWeights, RunConfig, TrainConfig
from plnerf.train.settings import from_json, to_json


def a_run(preset: str = "pl-nerf") -> RunConfig:
    chosen = find_preset(preset)
    return RunConfig(
        "/data/span", 2, preset, "numba", "cpu", chosen.model, chosen.train, seconds=1 / 3, seed=5
    )


@pytest.mark.parametrize("preset", preset_names())
def test_every_preset_comes_back_from_json_as_it_went(preset: str) -> None:
    config = a_run(preset)
    text = json.dumps(to_json(config))
    assert from_json(RunConfig, json.loads(text), "here") == config
    assert json.dumps(to_json(from_json(RunConfig, json.loads(text), "here"))) == text


@dataclasses.dataclass(frozen=True)
class Numbers:
    one: float
    many: tuple[float, ...]
    count: int
    maybe: float | None


FLOATS = st.floats(allow_nan=False, allow_infinity=False)


@given(st.builds(Numbers, FLOATS, st.lists(FLOATS, max_size=4).map(tuple), st.integers(), st.none() | FLOATS))
def test_numbers_come_back_to_the_last_bit(numbers: Numbers) -> None:
    assert from_json(Numbers, json.loads(json.dumps(to_json(numbers))), "here") == numbers


def test_keys_left_out_keep_their_defaults() -> None:
    assert from_json(TrainConfig, {"rays": 64}, "here") == TrainConfig(rays=64)
    assert from_json(TrainConfig, {"loss": {"colour": 2}}, "here") == TrainConfig(
        loss=LossWeights(colour=2.0)
    )


def test_a_fixed_kind_is_written_and_read_but_no_argument() -> None:
    data = to_json(a_run())
    assert data["model"]["kind"] == "pl-nerf"
    with pytest.raises(TypeError, match="kind"):
        type(a_run().model)(**data["model"])
    data["model"]["kind"] = "gaussians"
    with pytest.raises(ConfigError, match=r"model\.kind must be one of 'pl-nerf', "):
        from_json(RunConfig, data, "here")


WRONG_VALUES = {
    "fraction_for_a_whole_number": "train.rays=1.5",
    "truth_for_a_whole_number": "train.rays=true",
    "word_for_a_number": "train.hash_lr=fast",
    "not_a_number": "train.hash_lr=NaN",
    "infinite": "train.hash_lr=1e999",
    "python_truth": "train.pose_refinement=True",
    "number_for_a_truth": "model.contraction=1",
    "number_for_a_text": "preset=7",
    "wrong_choice": "model.field.direction_encoding=shh",
    "wrong_choice_by_type": "backend=[1]",
    "too_few_items": "model.stretch=[1,2]",
    "too_many_items": "model.stretch=[1,2,3,4]",
    "number_for_a_list": "model.stretch=2",
    "wrong_item": 'model.stretch=[1,"a",3]',
    "number_for_an_object": "train.loss=0",
    "unknown_key_in_an_object": 'model.proposals.0={"color": 1}',
    "object_without_a_key": 'model.proposals.0={"hidden": 16}',
    "null_where_none_may_be": "train.rays=null",
    "two_budgets": "steps=100",
    "refused_by_the_owner": 'model.field.grid={"levels": 0, "coarsest": 2, "finest": 4, "features": 2, '
    '"log2_table": 5}',
}


@pytest.mark.parametrize("name", WRONG_VALUES)
def test_text_of_a_wrong_value(name: str, snapshot: Callable[[str, str], None]) -> None:
    with pytest.raises(ConfigError) as caught:
        changed(a_run(), (WRONG_VALUES[name],))
    text = str(caught.value)
    assert "\n" not in text and text.startswith("the test's settings: ")
    snapshot(f"settings_value_{name}", text.replace("the test's settings", "<file>"))


FILES: dict[str, Callable[[dict[str, Any]], object]] = {
    "unknown_key": lambda data: data["model"]["proposals"][1].update(color=1),
    "missing_key": lambda data: data.pop("scene"),
    "missing_key_in_a_list": lambda data: data["model"]["proposals"][1]["grid"].pop("levels"),
    "wrong_type": lambda data: data.update(downscale="2"),
    "wrong_choice": lambda data: data.update(device="tpu"),
    "no_budget": lambda data: data.update(seconds=None),
    "a_section_is_a_list": lambda data: data.update(train=[]),
}


@pytest.mark.parametrize("name", FILES)
def test_text_of_a_wrong_file(name: str, snapshot: Callable[[str, str], None]) -> None:
    data = to_json(a_run())
    FILES[name](data)
    with pytest.raises(ConfigError) as caught:
        from_json(RunConfig, data, "runs/a/config.json")
    text = str(caught.value)
    assert "\n" not in text and text.startswith("runs/a/config.json: ")
    snapshot(f"settings_file_{name}", text)


@pytest.mark.parametrize("data", [None, [], "x", 3])
def test_a_file_that_holds_no_object(data: object) -> None:
    with pytest.raises(ConfigError, match="RunConfig, but is"):
        from_json(RunConfig, data, "runs/a/config.json")


def test_no_stored_text_is_left_over() -> None:
    stored = {path.stem for path in SNAPSHOTS.glob("settings_*.txt")}
    wanted = {f"settings_value_{name}" for name in WRONG_VALUES} | {f"settings_file_{name}" for name in FILES}
    assert stored == wanted
