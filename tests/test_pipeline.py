"""The stages in order, as functions: they meet only through files."""

import io
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from rich.console import Console
from tests.support.tiny_run import SMALL, assert_same_bits, newest_tensors

from plnerf import pipeline
from plnerf.errors import ConfigError, SceneError
from plnerf.presets.pl_nerf import PRESET as PL_NERF
from plnerf.train.config import fit_to_scene
from plnerf.train.run import open_run, read_config


@pytest.fixture
def console() -> Console:
    return Console(file=io.StringIO(), width=100)


def said(console: Console) -> str:
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_a_run_records_all_that_decides_it(tiny_scene: Path, tmp_path: Path, console: Console) -> None:
    out = tmp_path / "run"
    settings = (*SMALL, "train.loss.distortion=0")
    made = pipeline.train_scene(tiny_scene, out, steps=2, seed=9, settings=settings, console=console)
    config = read_config(out)
    assert made == out
    assert (config.preset, config.backend, config.device) == ("pl-nerf", "numba", "cpu")
    assert (config.seed, config.steps, config.seconds, config.train.loss.distortion) == (9, 2, None, 0.0)
    assert {path.name for path in out.iterdir() if "tfevents" not in path.name} == {
        "config.json", "pixels", "checkpoints", "metrics.jsonl"
    }  # fmt: skip


def test_the_model_is_fitted_to_the_scene_unless_it_is_set(
    tiny_scene: Path, tmp_path: Path, console: Console
) -> None:
    other = tuple(setting for setting in SMALL if "finest" not in setting)
    for downscale in (1, 2):
        out = tmp_path / f"by{downscale}"
        pipeline.train_scene(tiny_scene, out, steps=1, downscale=downscale, settings=other, console=console)
        run = open_run(out)
        wanted = fit_to_scene(PL_NERF.model, run.scene, 1.0).field.grid.finest
        assert run.config.model.field.grid.finest == wanted
    settings = (*other, "model.field.grid.finest=77")
    pipeline.train_scene(tiny_scene, tmp_path / "set", steps=1, settings=settings, console=console)
    assert read_config(tmp_path / "set").model.field.grid.finest == 77


def test_a_relative_scene_is_found_from_elsewhere(
    tiny_scene: Path, tmp_path: Path, console: Console, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tiny_scene.parent)
    pipeline.train_scene(Path(tiny_scene.name), Path("run"), steps=1, settings=SMALL, console=console)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert open_run(tmp_path / "run").scene.root == tiny_scene
    pipeline.resume_run(Path("..") / tiny_scene.name, Path("../run"), steps=2, console=console)
    assert open_run(tmp_path / "run").step == 2


def test_resuming_takes_the_runs_own_settings(tiny_scene: Path, tmp_path: Path, console: Console) -> None:
    out = pipeline.train_scene(tiny_scene, tmp_path / "run", steps=2, settings=SMALL, console=console)
    before = read_config(out)
    pipeline.resume_run(tiny_scene, out, steps=4, console=console)
    assert read_config(out) == replace(before, steps=4)
    pipeline.resume_run(tiny_scene, out, console=console)
    assert "Nothing left to train: 4 of 4 steps" in said(console)
    pipeline.resume_run(tiny_scene, out, seconds=1e-9, console=console)
    assert read_config(out) == replace(before, steps=4)  # nothing was done, so nothing is written


def test_a_run_is_not_trained_over(tiny_scene: Path, tmp_path: Path, console: Console) -> None:
    out = pipeline.train_scene(tiny_scene, tmp_path / "run", steps=1, settings=SMALL, console=console)
    before = newest_tensors(out)
    with pytest.raises(ConfigError, match="already holds a run"):
        pipeline.train_scene(tiny_scene, out, steps=1, seed=1, settings=SMALL, console=console)
    assert_same_bits(newest_tensors(out), before)


def test_a_failed_start_leaves_no_run(tiny_scene: Path, tmp_path: Path, console: Console) -> None:
    for settings in (("model.nothing=1",), ("train.rays=0",)):
        with pytest.raises(ConfigError):
            pipeline.train_scene(tiny_scene, tmp_path / "run", steps=1, settings=settings, console=console)
    pipeline.train_scene(tiny_scene, tmp_path / "run", steps=1, settings=SMALL, console=console)


@pytest.mark.skipif(torch.cuda.is_available(), reason="only without a CUDA device")
def test_a_device_that_is_not_there(tiny_scene: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="sees no CUDA device"):
        pipeline.train_scene(tiny_scene, tmp_path / "run", steps=1, device="cuda")


def test_stages_meet_through_files(tiny_scene: Path, tmp_path: Path, console: Console) -> None:
    """The run folder can be moved between the stages: each opens what the one before left on disk."""
    out = pipeline.train_scene(tiny_scene, tmp_path / "run", steps=2, settings=SMALL, console=console)
    moved = out.rename(tmp_path / "moved")
    metrics = pipeline.evaluate(moved, console=console)
    assert metrics == json.loads((moved / "eval" / "metrics.json").read_text())
    assert [image["name"] for image in metrics["images"]] == ["images/0000.png", "images/0008.png"]
    folder = pipeline.render(
        moved, views="path", outputs=("rgb", "depth"), frames=3, scale=0.5, video=False, console=console
    )
    assert [path.name for path in sorted((folder / "depth").iterdir())] == [
        "0000.png",
        "0001.png",
        "0002.png",
    ]
    assert str(moved / "eval") in said(console).replace("\n", "")


STAGES: dict[str, Callable[[Path, Console], object]] = {
    "resume_run": lambda run, console: pipeline.resume_run(run, run, console=console),
    "evaluate": lambda run, console: pipeline.evaluate(run, console=console),
    "render": lambda run, console: pipeline.render(run, views="path", outputs=("rgb",), console=console),
}


@pytest.mark.parametrize("stage", STAGES)
def test_no_stage_takes_a_folder_that_is_no_run(stage: str, tmp_path: Path, console: Console) -> None:
    with pytest.raises(ConfigError, match="is not a run folder"):
        STAGES[stage](tmp_path, console)


def test_demo_goes_from_photos_to_pictures(
    tiny_scene: Path, tmp_path: Path, console: Console, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All of `plnerf demo`, on a smaller scene."""
    shutil.copy(pipeline.bundled_span() / "truth.json", tiny_scene)  # of other wires: none is found
    monkeypatch.setattr(pipeline, "bundled_span", lambda: tiny_scene)
    out = pipeline.run_demo(tmp_path / "demo", seconds=0.5, console=console)
    score = json.loads((out / "survey" / "survey.score.json").read_text())
    assert score["overall"]["recall_25cm"] == 0
    assert open_run(out).seconds >= 0.5
    assert len(list((out / "eval" / "panels").glob("*.png"))) == 2
    assert (out / "renders" / "path-rgb.mp4").stat().st_size > 1000
    assert (out / "renders" / "path-depth.mp4").stat().st_size > 1000


def test_the_bundled_span_is_a_scene_with_truth() -> None:
    span = pipeline.bundled_span()
    assert {"transforms.json", "truth.json", "images"} <= {path.name for path in span.iterdir()}


def test_an_error_before_training_names_the_scene(tmp_path: Path, console: Console) -> None:
    with pytest.raises(SceneError, match=str(tmp_path / "none")):
        pipeline.train_scene(tmp_path / "none", tmp_path / "run", steps=1, console=console)
