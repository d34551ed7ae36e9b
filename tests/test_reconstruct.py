"""All stages in one call: what is up to date is skipped, and what changed is done again."""

import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from plnerf.errors import ConfigError, PlnerfError
from plnerf.pipeline import Stages, Training, reconstruct


@pytest.fixture
def done() -> list[str]:
    """Which stages ran."""
    return []


@pytest.fixture
def stages(done: list[str]) -> Stages:
    """Stages that only say that they ran; training leaves a checkpoint and costs nothing."""

    def train(scene: Path, run: Path, **options: Any) -> None:
        done.append(f"train {options.get('preset', 'on')}")
        (run / "checkpoints").mkdir(parents=True, exist_ok=True)
        (run / "config.json").write_text("{}")
        (run / "checkpoints" / "step-10.json").write_text("{}")

    def note(name: str) -> Callable[..., None]:
        return lambda *_: done.append(name)

    return Stages(note("capture"), train, train, note("evaluate"), note("render"), note("survey"))


def call(stages: Stages, scene: Path, out: Path, **training: Any) -> Path:
    return reconstruct(scene, out, Training(**training), stages=stages)


def test_a_second_call_does_nothing_again(
    tiny_scene: Path, tmp_path: Path, stages: Stages, done: list[str]
) -> None:
    run = call(stages, tiny_scene, tmp_path / "out")
    assert run == tmp_path / "out" / "run" and not (tmp_path / "out" / "scene").exists()
    assert done == ["train pl-nerf-wire", "evaluate", "render", "survey"]
    done.clear()
    lines: list[str] = []
    reconstruct(tiny_scene, tmp_path / "out", stages=stages, skipped=lines.append)
    assert done == ["train on"]  # which finds its budget used up
    assert lines == [f"{name}: there already, of step-10" for name in ("eval", "render", "survey")]
    (run / "checkpoints" / "step-20.json").write_text("{}")
    done.clear()
    call(stages, tiny_scene, tmp_path / "out")
    assert done == ["train on", "evaluate", "render", "survey"]


def test_a_result_of_which_a_file_is_gone_is_made_again(
    tiny_scene: Path, tmp_path: Path, stages: Stages, done: list[str]
) -> None:
    def render(run: Path) -> None:
        done.append("render")
        for place in ("renders/rgb/0000.png", "renders/path.mp4"):
            (run / place).parent.mkdir(parents=True, exist_ok=True)
            (run / place).write_text("made by reconstruct")

    stages = replace(stages, render=render)
    run = call(stages, tiny_scene, tmp_path / "out")
    (run / "renders" / "path.mp4").write_text("made again by the user")
    (run / "renders" / "own.png").write_text("made by the user, and removed")
    done.clear()
    call(stages, tiny_scene, tmp_path / "out")
    assert done == ["train on"]
    for lost in ("own.png", "rgb/0000.png"):
        (run / "renders" / lost).unlink()
        done.clear()
        call(stages, tiny_scene, tmp_path / "out")
        assert done == (["train on"] if lost == "own.png" else ["train on", "render"])


def test_a_stage_that_failed_is_done_by_the_next_call(
    tiny_scene: Path, tmp_path: Path, stages: Stages, done: list[str]
) -> None:
    def full(run: Path) -> None:
        raise PlnerfError("the disk is full")

    with pytest.raises(PlnerfError, match="the disk is full"):
        call(replace(stages, render=full), tiny_scene, tmp_path / "out")
    assert done == ["train pl-nerf-wire", "evaluate"]
    call(stages, tiny_scene, tmp_path / "out")
    assert done == ["train pl-nerf-wire", "evaluate", "train on", "render", "survey"]


def test_other_settings_and_poses_train_anew_and_lose_nothing(
    tiny_scene: Path, tmp_path: Path, stages: Stages, done: list[str]
) -> None:
    out = tmp_path / "out"
    call(stages, tiny_scene, out)
    done.clear()
    call(stages, tiny_scene, out, preset="nerfacto")
    assert done == ["train nerfacto", "evaluate", "render", "survey"]
    data = json.loads((tiny_scene / "transforms.json").read_text())
    data["frames"][0]["transform_matrix"][0][3] += 0.01
    (tiny_scene / "transforms.json").write_text(json.dumps(data))
    done.clear()
    call(stages, tiny_scene, out, preset="nerfacto")
    assert done[0] == "train nerfacto"
    assert {path.name for path in out.iterdir()} == {"run", "run-1", "run-2", "reconstruct.json"}


def test_photos_replaced_under_their_names_train_anew(
    tiny_scene: Path, tmp_path: Path, stages: Stages, done: list[str]
) -> None:
    call(stages, tiny_scene, tmp_path / "out")
    photos = sorted((tiny_scene / "images").iterdir())
    stat = photos[0].stat()
    photos[0].write_bytes(photos[1].read_bytes())
    os.utime(photos[0], ns=(stat.st_atime_ns, stat.st_mtime_ns))
    done.clear()
    call(stages, tiny_scene, tmp_path / "out")
    assert done == ["train pl-nerf-wire", "evaluate", "render", "survey"]


@pytest.mark.parametrize("state", ["{", "[]", '{"training": 3}', "[" * 5000, '{"eval": NaN}'])
def test_a_damaged_state_is_refused_and_nothing_runs(
    state: str, tiny_scene: Path, tmp_path: Path, stages: Stages, done: list[str]
) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "reconstruct.json").write_text(state)
    with pytest.raises(ConfigError, match=r"reconstruct\.json .*Remove it: the run is kept"):
        call(stages, tiny_scene, tmp_path / "out")
    assert not done and (tmp_path / "out" / "reconstruct.json").read_text() == state


def test_photos_are_captured_first(tiny_scene: Path, tmp_path: Path, stages: Stages, done: list[str]) -> None:
    def capture(source: Path, out: Path, _: object) -> None:
        done.append(f"capture {source.name} {out.name}")
        tiny_scene.rename(out)

    (tmp_path / "out").mkdir()
    photos = tiny_scene / "images"
    call(replace(stages, capture=capture), photos, tmp_path / "out")
    assert done[:2] == ["capture images scene", "train pl-nerf-wire"]
