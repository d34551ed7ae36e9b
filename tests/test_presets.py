"""Every preset is valid, survives JSON, builds a model, and trains."""

from pathlib import Path

import pytest

from plnerf.errors import ConfigError
from plnerf.presets import PRESETS, find_preset
from plnerf.train.config import RunConfig, fit_to_scene
from plnerf.train.loop import train
from plnerf.train.run import build_model
from plnerf.train.settings import override
from tiny_run import SMALL, Recorder, open_tiny


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_builds_and_trains(name: str, tiny_scene: Path, tmp_path: Path) -> None:
    scene, preset = open_tiny(tiny_scene, tmp_path), find_preset(name)
    model = fit_to_scene(preset.model, scene, preset.cells_per_pixel)
    config = RunConfig(str(tiny_scene), 1, name, "numba", "cpu", model, preset.train, steps=3)
    built = build_model(config, scene)
    assert built.field.grid.table.shape == (model.field.grid.rows, model.field.grid.features)
    assert len(built.proposals) == len(model.proposals) == len(model.sampler.proposals)
    assert sum(value.numel() for value in built.parameters()) < 50e6  # it is for a CPU
    report = Recorder()
    train(override(config, SMALL), tmp_path / "run", report, scene=scene)
    assert report.done == [1, 2, 3]


def test_an_unknown_preset_names_the_known_ones() -> None:
    with pytest.raises(ConfigError) as caught:
        find_preset("gaussians")
    assert str(caught.value) == f"There is no preset 'gaussians'. Presets: {', '.join(PRESETS)}."
