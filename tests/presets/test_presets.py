"""Every preset is valid, survives JSON, builds a model, and trains."""

import sys
from pathlib import Path

import numpy as np
import pytest
import torch
import torch.distributed as dist
from tests.support.changed import changed
from tests.support.tiny_run import SMALL, Recorder, open_tiny
from torch import Tensor

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
from plnerf.train.loop import CPU, train
from plnerf.train.optimizer import TableAdam, build_optimizer
from plnerf.train.pixels import PixelSampler, detail_pools
from plnerf.train.ranks import Ranks, SharedGradients
from plnerf.train.run import build_model, open_run
from plnerf.train.step import NonFiniteMonitor, Training

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


@pytest.mark.slow
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


@pytest.mark.parametrize("name", preset_names())
def test_shares_of_a_batch_have_the_gradients_of_the_batch(
    name: str, tiny_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Summed over two ranks, whose all-reduce is left out here; with poses, appearance and normals on."""
    scene, preset = open_tiny(tiny_scene, tmp_path), find_preset(name)
    small = tuple(t for t in SMALLER[type(preset.model)] if not t.startswith("train.normal_rays"))
    model = fit_to_scene(preset.model, scene, preset.cells_per_pixel)
    config = RunConfig("a scene", 1, name, "numba", "cpu", model, preset.train, steps=1)
    config = changed(config, (*small, *SWITCHES))
    monkeypatch.setattr(dist, "all_reduce", lambda row: None)
    monkeypatch.setattr(TableAdam, "step", lambda self: None)

    def gradients(ranks: Ranks) -> tuple[list[Tensor], dict[str, Tensor]]:
        system = build_model(config, scene)
        optimizer = build_optimizer(system, config.train)
        shared = SharedGradients(system.parameters(), ranks)
        monitor = NonFiniteMonitor(CPU)
        training = Training(system, optimizer, scene.cameras, ranks.share_of(config.train), monitor, shared)
        generator = ranks.generator(CPU).manual_seed(5)
        pools = detail_pools(scene.images, scene.train, 0.5, 0.1)
        batch = PixelSampler(scene.images, scene.train, pools).draw(config.train.rays, generator, ranks.rays)
        system.update(0, generator)
        terms = training.step(batch, 0.5, generator, refine_poses=True)
        return [value.grad for value in system.parameters() if value.grad is not None], terms

    whole, terms = gradients(Ranks(0, 1))
    (first, terms_0), (second, terms_1) = gradients(Ranks(0, 2)), gradients(Ranks(1, 2))
    for all_, a, b in zip(whole, first, second, strict=True):
        assert (a + b - all_).abs().max() <= 1e-4 * all_.abs().max()
    for key, term in terms.items():
        assert (terms_0[key] + terms_1[key]).item() == pytest.approx(term.item(), rel=1e-5)
    assert sum(int(value.any()) for value in whole) > len(whole) // 2


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
