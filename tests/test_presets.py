"""Every preset is valid, survives JSON, builds a model, and trains."""

from dataclasses import replace
from pathlib import Path

import pytest

from plnerf.errors import ConfigError
from plnerf.pipeline import train_scene
from plnerf.presets import NERF, PRESETS, find_preset
from plnerf.render.coarse_fine import CoarseFineConfig
from plnerf.render.deep_proposals import DeepProposalsConfig
from plnerf.render.model import ModelConfig, PLNeRF
from plnerf.render.occupied import OccupiedConfig
from plnerf.train.config import RunConfig, fit_to_scene
from plnerf.train.loop import train
from plnerf.train.run import build_model, open_run
from plnerf.train.settings import override
from tiny_run import SMALL, Recorder, open_tiny

FEW = ("train.rays=64", "train.warmup_steps=10", "train.validations=2")
SMALLER = {
    ModelConfig: SMALL,
    OccupiedConfig: ("model.field.grid.log2_table=13", "model.field.grid.finest=160", *FEW),
    CoarseFineConfig: ("model.field.width=16", *FEW),
    DeepProposalsConfig: ("model.field.width=16", *FEW),
}


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_builds_and_trains(name: str, tiny_scene: Path, tmp_path: Path) -> None:
    scene, preset = open_tiny(tiny_scene, tmp_path), find_preset(name)
    model = fit_to_scene(preset.model, scene, preset.cells_per_pixel)
    config = RunConfig(str(tiny_scene), 1, name, "numba", "cpu", model, preset.train, steps=3)
    built = build_model(config, scene)
    if isinstance(model, ModelConfig):
        assert isinstance(built, PLNeRF)
        assert built.field.grid.table.shape == (model.field.grid.rows, model.field.grid.features)
        assert len(built.proposals) == len(model.proposals) == len(model.sampler.proposals)
    assert sum(value.numel() for value in built.parameters()) < 50e6  # it is for a CPU
    report = Recorder()
    train(override(config, SMALLER[type(model)]), tmp_path / "run", report, scene=scene)
    assert report.done == [1, 2, 3]


def test_a_further_preset_is_an_entry_of_one_table(
    tiny_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(PRESETS, "mine", replace(NERF, train=replace(NERF.train, rays=16)))
    small = ("model.field.width=16", "train.validations=0")
    train_scene(tiny_scene, tmp_path / "run", preset="mine", steps=2, settings=small, report=Recorder())
    run = open_run(tmp_path / "run")
    assert run.config.preset == "mine" and run.config.train.rays == 16 and run.step == 2


def test_an_unknown_preset_names_the_known_ones() -> None:
    with pytest.raises(ConfigError) as caught:
        find_preset("gaussians")
    assert str(caught.value) == f"There is no preset 'gaussians'. Presets: {', '.join(PRESETS)}."
