"""Every preset is valid, survives JSON, builds a model, and trains."""

import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.support.changed import changed
from tests.support.tiny_run import SMALL, Recorder, open_tiny

import plnerf.presets
from plnerf.cli.main import main
from plnerf.errors import CheckpointError, ConfigError
from plnerf.pipeline import train_scene
from plnerf.presets import preset_names
from plnerf.presets._find import find_preset, presets_by_year
from plnerf.render.config import CoarseFineConfig, DeepProposalsConfig, ModelConfig, OccupancyGridConfig
from plnerf.render.model import PLNeRF
from plnerf.render.system import RadianceSystem
from plnerf.render.views import render_view
from plnerf.scene.scene import Scene
from plnerf.train.checkpoint import load_checkpoint, save_checkpoint
from plnerf.train.config import RunConfig, Settings
from plnerf.train.evaluate import mean_appearance
from plnerf.train.fitted import fit_to_scene
from plnerf.train.loop import train
from plnerf.train.optimizer import build_optimizer
from plnerf.train.run import build_model, open_run

FEW = ("train.rays=64", "train.warmup_steps=10", "train.validations=2")
SMALLER = {
    ModelConfig: SMALL,
    OccupancyGridConfig: ("model.field.grid.log2_table=13", "model.field.grid.finest=160", *FEW),
    CoarseFineConfig: ("model.field.width=16", *FEW),
    DeepProposalsConfig: ("model.field.width=16", *FEW),
}


@pytest.mark.parametrize("name", preset_names())
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
    train(changed(config, SMALLER[type(model)]), tmp_path / "run", report, scene=scene)
    assert report.done == [1, 2, 3]


SWITCHES = (
    "model.field.appearance=4",
    "model.field.normals=true",
    "train.pose_refinement=true",
    "train.pose_from=0",
    "train.normal_rays=8",
    "train.loss.normals_shape_density=true",
)


@pytest.mark.parametrize("name", preset_names())
def test_poses_appearance_and_normals_can_be_switched_on(name: str, tiny_scene: Path, tmp_path: Path) -> None:
    """NeRF--, NeRF-W and Ref-NeRF on every system."""
    small = SMALLER[type(find_preset(name).model)]
    small = tuple(text for text in small if not text.startswith("train.normal_rays"))
    folder, report = tmp_path / "run", Recorder()
    chosen = find_preset(name)
    made = changed(Settings(chosen.model, chosen.train), (*small, *SWITCHES))
    train_scene(tiny_scene, folder, preset=name, model=made.model, train=made.train, steps=3, report=report)
    run = open_run(folder)
    assert all({"normals", "orientation"} <= terms.keys() for terms in report.terms)
    learnt = (run.model.appearance, run.model.poses.correction)
    assert all(value[list(run.scene.train)].abs().max() > 0 for value in learnt)
    view = render_view(run.model, run.scene.cameras[[0]], mean_appearance(run), normals=True)
    assert view.normals is not None and np.isfinite(view.normals).all() and view.normals.any()


def small_system(name: str, scene: Scene) -> RadianceSystem:
    preset = find_preset(name)
    model = fit_to_scene(preset.model, scene, preset.cells_per_pixel)
    config = RunConfig("a scene", 1, name, "numba", "cpu", model, preset.train, steps=1)
    return build_model(changed(config, SMALLER[type(model)]), scene)


def test_a_checkpoint_is_refused_by_every_other_architecture(tiny_scene: Path, tmp_path: Path) -> None:
    """pl-nerf-wire without curves has the tensors of pl-nerf, and is one."""
    scene = open_tiny(tiny_scene, tmp_path)
    systems = {name: small_system(name, scene) for name in preset_names() if name != "pl-nerf-wire"}
    for name, system in systems.items():
        optimizer = build_optimizer(system, find_preset(name).train)
        saved = save_checkpoint(tmp_path / name, system, optimizer, step=1, seconds=0.0, frames={})
        for other, model in systems.items():
            if other == name:
                load_checkpoint(saved.path, model)
                continue
            before = {key: value.clone() for key, value in model.state_dict().items()}
            with pytest.raises(CheckpointError, match="is of another architecture: "):
                load_checkpoint(saved.path, model)
            assert all(torch.equal(value, before[key]) for key, value in model.state_dict().items())


MINE = """
from dataclasses import replace
from plnerf.presets.nerf import PRESET as NERF

PRESET = replace(NERF, train=replace(NERF.train, rays=16), year=1999)
"""


def test_a_further_preset_is_a_further_file(
    tiny_scene: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "my_own.py").write_text(MINE)
    monkeypatch.setattr(plnerf.presets, "__path__", [*plnerf.presets.__path__, str(tmp_path)])
    assert presets_by_year()[:3] == ("my-own", "nerf", "mip-nerf")
    mine = find_preset("my-own")
    made = changed(Settings(mine.model, mine.train), ("model.field.width=16", "train.validations=0"))
    train_scene(
        tiny_scene, tmp_path / "run", preset="my-own", model=made.model, train=made.train, steps=2,
        report=Recorder(),
    )  # fmt: skip
    run = open_run(tmp_path / "run")
    assert run.config.preset == "my-own" and run.config.train.rays == 16 and run.step == 2
    monkeypatch.setattr(sys, "argv", ["plnerf", "train", "--help"])
    with pytest.raises(SystemExit):
        main()
    told = " ".join(capsys.readouterr().out.replace("│", "").split())
    assert "mip-nerf-360, my-own, nerf," in told


def test_an_unknown_preset_names_the_known_ones() -> None:
    with pytest.raises(ConfigError) as caught:
        find_preset("gaussians")
    assert str(caught.value) == f"There is no preset 'gaussians'. Presets: {', '.join(preset_names())}."
