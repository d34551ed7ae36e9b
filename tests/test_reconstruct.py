"""All stages in one call: what is done is not done again, and what changed is."""

import json
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

import plnerf.reconstruct as stages
from plnerf.capture.capture import CaptureConfig
from plnerf.errors import PlnerfError
from plnerf.reconstruct import Training, reconstruct_all

QUIET = Console(quiet=True)


@pytest.fixture
def done(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Which stages ran; training leaves a checkpoint and costs nothing."""
    ran: list[str] = []

    def train(scene: Path, run: Path, **options: Any) -> Path:
        ran.append(f"train {options.get('preset', 'on')}")
        (run / "checkpoints").mkdir(parents=True, exist_ok=True)
        (run / "config.json").write_text("{}")
        (run / "checkpoints" / "step-10.json").write_text("{}")
        return run

    monkeypatch.setattr(stages, "train_scene", train)
    monkeypatch.setattr(stages, "resume_run", train)
    for name in ("evaluate", "render", "survey"):
        monkeypatch.setattr(stages, name, lambda run, name=name, **options: ran.append(name))
    return ran


def call(scene: Path, out: Path, **training: Any) -> Path:
    return reconstruct_all(scene, out, Training(**training), CaptureConfig(), QUIET)


def test_a_second_call_does_nothing_again(tiny_scene: Path, tmp_path: Path, done: list[str]) -> None:
    run = call(tiny_scene, tmp_path / "out")
    assert run == tmp_path / "out" / "run" and not (tmp_path / "out" / "scene").exists()
    assert done == ["train pl-nerf-wire", "evaluate", "render", "survey"]
    done.clear()
    call(tiny_scene, tmp_path / "out")
    assert done == ["train on"]  # which finds its budget used up
    (run / "checkpoints" / "step-20.json").write_text("{}")
    done.clear()
    call(tiny_scene, tmp_path / "out")
    assert done == ["train on", "evaluate", "render", "survey"]


def test_a_stage_that_failed_is_done_by_the_next_call(
    tiny_scene: Path, tmp_path: Path, done: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise PlnerfError("the disk is full")

    works = stages.render
    monkeypatch.setattr(stages, "render", full)
    with pytest.raises(PlnerfError, match="the disk is full"):
        call(tiny_scene, tmp_path / "out")
    assert done == ["train pl-nerf-wire", "evaluate"]
    monkeypatch.setattr(stages, "render", works)
    call(tiny_scene, tmp_path / "out")
    assert done == ["train pl-nerf-wire", "evaluate", "train on", "render", "survey"]


def test_other_settings_and_poses_train_anew_and_lose_nothing(
    tiny_scene: Path, tmp_path: Path, done: list[str]
) -> None:
    out = tmp_path / "out"
    call(tiny_scene, out)
    done.clear()
    call(tiny_scene, out, preset="nerfacto")
    assert done == ["train nerfacto", "evaluate", "render", "survey"]
    data = json.loads((tiny_scene / "transforms.json").read_text())
    data["frames"][0]["transform_matrix"][0][3] += 0.01
    (tiny_scene / "transforms.json").write_text(json.dumps(data))
    done.clear()
    call(tiny_scene, out, preset="nerfacto")
    assert done[0] == "train nerfacto"
    assert {path.name for path in out.iterdir()} == {"run", "run-1", "run-2", "reconstruct.json"}


def test_photos_are_captured_first(
    tiny_scene: Path, tmp_path: Path, done: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def capture(source: Path, out: Path, *_: object) -> Path:
        done.append(f"capture {source.name} {out.name}")
        return tiny_scene

    monkeypatch.setattr(stages, "capture_and_tell", capture)
    call(tiny_scene / "images", tmp_path / "out")
    assert done[:2] == ["capture images scene", "train pl-nerf-wire"]
