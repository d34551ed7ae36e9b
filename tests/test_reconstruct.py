"""All stages in one call: the first report before training; what is up to date is skipped."""

import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from plnerf.detect.kept_wires import KeptWires
from plnerf.errors import ConfigError, PlnerfError
from plnerf.line.files import write_wires
from plnerf.line.frame import LineFrame
from plnerf.pipeline import bundled_span
from plnerf.reconstruct import Listener, Stages, Training, first_config, reconstruct
from plnerf.scene.formats import read_listing
from plnerf.scene.scene import load_scene
from plnerf.survey.config import SurveyConfig

FIRST = "first survey"
AFTER = ["survey", "evaluate", "render"]
"""What follows training."""


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

    def survey(source: Path, out: Path, finder: KeptWires, config: SurveyConfig) -> None:
        done.append(FIRST if out.name == "survey" and out.parent.name != "run" else "survey")
        out.mkdir(parents=True, exist_ok=True)
        (out / "report.html").write_text("made by reconstruct")

    return Stages(note("capture"), train, train, note("evaluate"), note("render"), survey)


def call(stages: Stages, scene: Path, out: Path, **training: Any) -> Path:
    return reconstruct(scene, out, Training(**training), stages=stages)


def test_a_second_call_does_nothing_again(
    tiny_scene: Path, tmp_path: Path, stages: Stages, done: list[str]
) -> None:
    run = call(stages, tiny_scene, tmp_path / "out")
    assert run == tmp_path / "out" / "run" and not (tmp_path / "out" / "scene").exists()
    assert done == [FIRST, "train pl-nerf-wire", *AFTER]
    done.clear()
    lines: list[str] = []
    reconstruct(tiny_scene, tmp_path / "out", stages=stages, listener=Listener(lines.append))
    assert done == ["train on"]  # which finds its budget used up
    assert lines == [
        f"{FIRST}: there already, {tmp_path / 'out' / 'survey'}",
        *(f"{name}: there already, of step-10" for name in ("survey", "eval", "render")),
    ]
    (run / "checkpoints" / "step-20.json").write_text("{}")
    done.clear()
    call(stages, tiny_scene, tmp_path / "out")
    assert done == ["train on", *AFTER]


def test_a_stage_is_announced_with_an_estimate(tiny_scene: Path, tmp_path: Path, stages: Stages) -> None:
    begun: list[tuple[str, float | None]] = []
    listener = Listener(begins=lambda stage, seconds: begun.append((stage.split(":")[0], seconds)))
    for _ in range(2):
        reconstruct(tiny_scene, tmp_path / "out", Training(seconds=7.0), stages=stages, listener=listener)
    names = [stage for stage, _ in begun]
    wanted = ["survey of the scene", "train", "survey with the field", "eval", "render"]
    assert names == [*wanted, "train"]  # of those up to date only training may go on
    assert begun[1][1] == 7.0 and begun[-1][1] is None
    assert all(seconds is not None and 0 < seconds < 600 for _, seconds in begun[:-1])


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
        call(replace(stages, eval=full), tiny_scene, tmp_path / "out")
    assert done == [FIRST, "train pl-nerf-wire", "survey"]
    call(stages, tiny_scene, tmp_path / "out")
    assert done == [FIRST, "train pl-nerf-wire", "survey", "train on", "evaluate", "render"]


def test_the_first_report_is_there_before_training(
    tiny_scene: Path, tmp_path: Path, stages: Stages, done: list[str]
) -> None:
    def broken(*_: Any, **__: Any) -> None:
        assert (tmp_path / "out" / "survey" / "report.html").exists()
        raise PlnerfError("no memory")

    for _ in range(2):  # the second call does not survey again
        with pytest.raises(PlnerfError, match="no memory"):
            call(replace(stages, train=broken), tiny_scene, tmp_path / "out")
        assert done == [FIRST]
    (tmp_path / "out" / "survey" / "report.html").unlink()
    call(stages, tiny_scene, tmp_path / "out")
    assert done == [FIRST, FIRST, "train pl-nerf-wire", *AFTER]


@pytest.mark.parametrize("loss", [Path.unlink, lambda path: path.write_text("{")], ids=["removed", "cut"])
def test_wires_that_are_lost_are_found_again(
    loss: Callable[[Path], object], tiny_scene: Path, tmp_path: Path, stages: Stages, done: list[str]
) -> None:
    def survey(source: Path, out: Path, finder: KeptWires, config: SurveyConfig) -> None:
        stages.survey(source, out, finder, config)
        write_wires(finder.path, (), LineFrame.of_scene(load_scene(tiny_scene).frames), {})

    wires = tmp_path / "out" / "wires.json"
    call(replace(stages, survey=survey), tiny_scene, tmp_path / "out")
    before = wires.read_text()
    loss(wires)
    done.clear()
    call(replace(stages, survey=survey), tiny_scene, tmp_path / "out")
    assert done == [FIRST, "train on"] and wires.read_text() == before


def test_other_settings_and_poses_train_anew_and_lose_nothing(
    tiny_scene: Path, tmp_path: Path, stages: Stages, done: list[str]
) -> None:
    out = tmp_path / "out"
    call(stages, tiny_scene, out)
    done.clear()
    call(stages, tiny_scene, out, preset="nerfacto")
    assert done == ["train nerfacto", *AFTER]  # the first survey is of the same images
    data = json.loads((tiny_scene / "transforms.json").read_text())
    data["frames"][0]["transform_matrix"][0][3] += 0.01
    (tiny_scene / "transforms.json").write_text(json.dumps(data))
    done.clear()
    call(stages, tiny_scene, out, preset="nerfacto")
    assert done[:2] == [FIRST, "train nerfacto"]
    assert {path.name for path in out.iterdir()} == {"run", "run-1", "run-2", "survey", "reconstruct.json"}


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
    assert done == [FIRST, "train pl-nerf-wire", *AFTER]


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
    assert done[:3] == ["capture images scene", FIRST, "train pl-nerf-wire"]


def test_the_first_survey_matches_smaller_images(tiny_scene: Path) -> None:
    full = SurveyConfig()
    assert first_config(read_listing(tiny_scene)) == full  # they are tiny already
    first = first_config(read_listing(bundled_span()))
    assert (first.stereo.longest_px, first.stereo.coarse.longest_px) == (240, 240)
    assert (first.detect, first.refine, first.clearance) == (full.detect, full.refine, full.clearance)
