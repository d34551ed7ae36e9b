"""The stages in order, as functions: they meet only through files."""

import json
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from tests.support.tiny_run import Recorder, assert_same_bits, newest_tensors, small

from plnerf import pipeline
from plnerf.errors import ConfigError, PlnerfError, SceneError
from plnerf.presets.pl_nerf import PRESET as PL_NERF
from plnerf.reconstruct import reconstruct
from plnerf.scene.only_writer import only_writer
from plnerf.train.fitted import fit_to_scene
from plnerf.train.run import open_run, read_config
from plnerf.train.scene_record import read_record


def test_a_run_records_all_that_decides_it(tiny_scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    settings = small("train.loss.distortion=0", "train.validations=3")
    made = pipeline.train_scene(tiny_scene, out, steps=2, seed=9, **settings)
    config = read_config(out)
    assert made == out
    assert (config.preset, config.backend, config.device) == ("pl-nerf", "numba", "cpu")
    assert (config.seed, config.steps, config.seconds, config.train.loss.distortion) == (9, 2, None, 0.0)
    assert {path.name for path in out.iterdir() if "tfevents" not in path.name} == {
        "config.json", "scene.json", "pixels", "checkpoints", "metrics.jsonl"
    }  # fmt: skip


def test_the_model_is_fitted_to_the_scene_unless_it_is_set(tiny_scene: Path, tmp_path: Path) -> None:
    other = small(f"model.field.grid.finest={PL_NERF.model.field.grid.finest}")
    for downscale in (1, 2):
        out = tmp_path / f"by{downscale}"
        pipeline.train_scene(tiny_scene, out, steps=1, downscale=downscale, **other)
        run = open_run(out)
        wanted = fit_to_scene(PL_NERF.model, run.scene, 1.0).field.grid.finest
        assert run.config.model.field.grid.finest == wanted
    pipeline.train_scene(tiny_scene, tmp_path / "set", steps=1, **small("model.field.grid.finest=77"))
    assert read_config(tmp_path / "set").model.field.grid.finest == 77


def test_a_relative_scene_is_found_from_elsewhere(
    tiny_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tiny_scene.parent)
    pipeline.train_scene(Path(tiny_scene.name), Path("run"), steps=1, **small())
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert open_run(tmp_path / "run").scene.root == tiny_scene
    pipeline.resume_run(Path("..") / tiny_scene.name, Path("../run"), steps=2)
    assert open_run(tmp_path / "run").step == 2


def test_resuming_takes_the_runs_own_settings(tiny_scene: Path, tmp_path: Path) -> None:
    out = pipeline.train_scene(tiny_scene, tmp_path / "run", steps=2, **small())
    before = read_config(out)
    pipeline.resume_run(tiny_scene, out, steps=4)
    assert read_config(out) == replace(before, steps=4)
    report = Recorder()
    pipeline.resume_run(tiny_scene, out, report=report)
    assert report.told_nothing_left and not report.done
    pipeline.resume_run(tiny_scene, out, seconds=1e-9)
    assert read_config(out) == replace(before, steps=4)  # nothing was done, so nothing is written


def test_a_run_is_not_trained_over(tiny_scene: Path, tmp_path: Path) -> None:
    out = pipeline.train_scene(tiny_scene, tmp_path / "run", steps=1, **small())
    before = newest_tensors(out)
    with pytest.raises(ConfigError, match="already holds a run"):
        pipeline.train_scene(tiny_scene, out, steps=1, seed=1, **small())
    assert_same_bits(newest_tensors(out), before)


def test_a_run_without_its_settings_says_what_is_missing(tiny_scene: Path, tmp_path: Path) -> None:
    out = pipeline.train_scene(tiny_scene, tmp_path / "run", steps=1, **small())
    (out / "config.json").unlink()
    with pytest.raises(ConfigError, match=r"step-1\.json of a run, but not its settings, config\.json. Put"):
        pipeline.train_scene(tiny_scene, out, steps=1, **small())


def test_only_one_command_writes_into_a_folder(tiny_scene: Path, tmp_path: Path) -> None:
    out = pipeline.train_scene(tiny_scene, tmp_path / "out" / "run", steps=1, **small())
    again: dict[str, Callable[[], object]] = {
        "train": lambda: pipeline.train_scene(tiny_scene, out, steps=1, seed=1, **small()),
        "resume": lambda: pipeline.resume_run(tiny_scene, out, steps=2),
        "capture": lambda: pipeline.capture_scene(tiny_scene / "images", out),
        "reconstruct": lambda: reconstruct(tiny_scene, out),
    }
    before = newest_tensors(out)
    with only_writer(out):
        for call in again.values():
            with pytest.raises(PlnerfError, match=f"{out} is being written by process {os.getpid()}"):
                call()
    assert_same_bits(newest_tensors(out), before)


def test_a_run_that_is_trained_is_not_put_aside(tiny_scene: Path, tmp_path: Path) -> None:
    (tmp_path / "reconstruct.json").write_text('{"training": "other settings"}')
    with only_writer(tmp_path / "run"), pytest.raises(PlnerfError, match="run is being written by process"):
        reconstruct(tiny_scene, tmp_path)
    assert not (tmp_path / "run-1").exists()


def test_a_failed_start_leaves_no_run(tiny_scene: Path, tmp_path: Path) -> None:
    for budget in ({}, {"steps": 1, "seconds": 1.0}):
        with pytest.raises(ConfigError):
            pipeline.train_scene(tiny_scene, tmp_path / "run", **small(), **budget)
        assert not (tmp_path / "run").exists()
    pipeline.train_scene(tiny_scene, tmp_path / "run", steps=1, **small())


@pytest.mark.skipif(torch.cuda.is_available(), reason="only without a CUDA device")
def test_frames_of_a_start_that_was_interrupted_are_not_those_of_another_scene(
    tiny_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The process ended when frames and wires were written, and the settings were not."""

    def ends(*_: object) -> None:
        raise KeyboardInterrupt

    other = Path(shutil.copytree(tiny_scene, tmp_path / "other"))
    content = json.loads((other / "transforms.json").read_text())
    for frame in content["frames"]:
        for row in frame["transform_matrix"][:3]:
            row[3] *= 3.0
    (other / "transforms.json").write_text(json.dumps(content))
    settings = small("train.find_wires=true")
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr("plnerf.train.loop.write_run", ends)
        pipeline.train_scene(other, tmp_path / "run", steps=1, **settings)
    assert (tmp_path / "run" / "wires.json").exists() and not (tmp_path / "run" / "config.json").exists()
    pipeline.train_scene(tiny_scene, tmp_path / "run", steps=1, **settings)
    pipeline.train_scene(tiny_scene, tmp_path / "fresh", steps=1, **settings)
    one, fresh = (read_record(tmp_path / name) for name in ("run", "fresh"))
    assert one.frames.to_json() == fresh.frames.to_json()
    assert torch.equal(one.cameras.centre, fresh.cameras.centre)


def test_a_device_that_is_not_there(tiny_scene: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="sees no CUDA device"):
        pipeline.train_scene(tiny_scene, tmp_path / "run", steps=1, device="cuda")


def test_stages_meet_through_files(tiny_scene: Path, tmp_path: Path) -> None:
    """The run folder can be moved between the stages: each opens what the one before left on disk."""
    out = pipeline.train_scene(tiny_scene, tmp_path / "run", steps=2, **small())
    moved = out.rename(tmp_path / "moved")
    done: list[tuple[int, int]] = []
    metrics = pipeline.evaluate(moved, lambda done_so_far, total: done.append((done_so_far, total)))
    assert done == [(1, 2), (2, 2)]
    assert metrics == json.loads((moved / "eval" / "metrics.json").read_text())
    assert [image["name"] for image in metrics["images"]] == ["images/0000.png", "images/0008.png"]
    folder = pipeline.render(moved, views="path", outputs=("rgb", "depth"), frames=3, scale=0.5, video=False)
    assert [path.name for path in sorted((folder / "depth").iterdir())] == [
        "0000.png",
        "0001.png",
        "0002.png",
    ]


STAGES: dict[str, Callable[[Path], object]] = {
    "resume_run": lambda run: pipeline.resume_run(run, run),
    "evaluate": pipeline.evaluate,
    "render": lambda run: pipeline.render(run, views="path", outputs=("rgb",)),
    "survey": pipeline.survey,
}


@pytest.mark.parametrize("stage", STAGES)
def test_no_stage_takes_a_folder_that_is_no_run(stage: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"is (not|neither) a run folder"):
        STAGES[stage](tmp_path)


def test_rendering_needs_no_photos(tiny_scene: Path, tmp_path: Path) -> None:
    """The scene folder is gone, and with it whatever the run does not hold itself."""
    out = pipeline.train_scene(tiny_scene, tmp_path / "run", steps=2, **small())
    shutil.rmtree(out / "pixels")
    tiny_scene.rename(tmp_path / "away")
    folder = pipeline.render(out, views="path", outputs=("rgb", "depth"), frames=2, scale=0.5, video=False)
    assert len(list((folder / "rgb").iterdir())) == 2
    with pytest.raises(SceneError, match="is not there"):
        pipeline.evaluate(out)


def test_nothing_is_printed(tiny_scene: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    out = pipeline.train_scene(tiny_scene, tmp_path / "run", steps=1, **small())
    pipeline.evaluate(out)
    pipeline.render(out, views="test", outputs=("rgb",), video=False)
    assert capfd.readouterr().out == ""


def test_the_bundled_span_is_a_scene_with_truth() -> None:
    span = pipeline.bundled_span()
    assert {"transforms.json", "truth.json", "images"} <= {path.name for path in span.iterdir()}


def test_an_error_before_training_names_the_scene(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=str(tmp_path / "none")):
        pipeline.train_scene(tmp_path / "none", tmp_path / "run", steps=1)
