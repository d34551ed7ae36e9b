"""The command line: what users get wrong ends in one paragraph and status 1, never in a traceback.

Texts of the scene are stored by test_scene_errors.py; the others in tests/snapshots/cli_*.txt.
"""

import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
import torch
from tests.conftest import SNAPSHOTS
from tests.scene import test_scene_errors
from tests.support.changed import options
from tests.support.tiny_run import SMALL, Recorder, log_of, run_plnerf, tiny_config

from plnerf import pipeline
from plnerf.cli.main import main
from plnerf.survey.config import SurveyConfig
from plnerf.train.checkpoint import list_checkpoints
from plnerf.train.loop import train
from plnerf.train.run import open_run, read_config


@dataclass(frozen=True)
class Result:
    status: int
    out: str
    err: str


Call = Callable[..., Result]
SET = options(SMALL)


@pytest.fixture
def plnerf(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """The command in this process; an exception that it lets through fails the test."""

    def call(*arguments: str | Path) -> Result:
        monkeypatch.setattr(sys, "argv", ["plnerf", *map(str, arguments)])
        capsys.readouterr()
        status = 0
        try:
            main()
        except SystemExit as stop:
            status = stop.code if isinstance(stop.code, int) else 1
        return Result(status, *capsys.readouterr())

    return call


@pytest.fixture(scope="module")
def trained(built_tiny_scene: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run of four steps; tests that change files use ``run``."""
    return train(tiny_config(built_tiny_scene, steps=4), tmp_path_factory.mktemp("cli") / "run", Recorder())


@pytest.fixture
def run(trained: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(trained, tmp_path / "run"))


@dataclass(frozen=True)
class Place:
    """Where a case works: a scene folder, a finished run on another copy of it, and a free folder."""

    scene: Path
    run: Path
    free: Path

    def train(self, *options: str | Path) -> list[str | Path]:
        return ["train", self.scene, "-o", self.free / "out", "--steps", "2", *options]

    def resume(self, *options: str | Path) -> list[str | Path]:
        return ["train", read_config(self.run).scene, "-o", self.run, "--resume", *options]


Case = Callable[[Place], list[str | Path]]
CASES: dict[str, Case] = {}
SCENES = ("missing_images", "truncated_jpeg", "rgba", "nan_pose", "not_an_image", "invalid_json", "no_folder")


def case(make: Case) -> Case:
    CASES[make.__name__] = make
    return make


@case
def scene_is_not_there(place: Place) -> list[str | Path]:
    return ["train", place.free / "nowhere", "-o", place.free / "out"]


@case
def unknown_preset(place: Place) -> list[str | Path]:
    return place.train("--preset", "gaussians")


@case
def setting_out_of_range(place: Place) -> list[str | Path]:
    return place.train("--model.field.grid.levels", "0")


@case
def setting_that_contradicts_another(place: Place) -> list[str | Path]:
    return place.train("--model.sampler.proposals", "64")


@case
def two_budgets(place: Place) -> list[str | Path]:
    return place.train("--seconds", "5")


@case
def negative_budget(place: Place) -> list[str | Path]:
    return ["train", place.scene, "-o", place.free / "out", "--seconds=-5"]


@case
def negative_seed(place: Place) -> list[str | Path]:
    return place.train("--seed=-1")


@case
def no_cuda(place: Place) -> list[str | Path]:
    return place.train("--device", "cuda")


@case
def out_is_a_file(place: Place) -> list[str | Path]:
    (place.free / "out").write_text("mine")
    return place.train()


@case
def out_is_below_a_file(place: Place) -> list[str | Path]:
    (place.free / "file").write_text("mine")
    return ["train", place.scene, "-o", place.free / "file" / "out", "--steps", "2"]


@case
def out_holds_a_run(place: Place) -> list[str | Path]:
    return ["train", place.scene, "-o", place.run, "--steps", "2"]


@case
def resume_with_another_scene(place: Place) -> list[str | Path]:
    return ["train", place.scene, "-o", place.run, "--resume"]


@case
def resume_of_no_run(place: Place) -> list[str | Path]:
    return ["train", place.scene, "-o", place.free, "--resume"]


@case
def resume_with_two_budgets(place: Place) -> list[str | Path]:
    return place.resume("--steps", "20", "--seconds", "20")


@case
def resume_with_other_settings(place: Place) -> list[str | Path]:
    return place.resume("--train.rays", "64")


@case
def resume_from_another_format_version(place: Place) -> list[str | Path]:
    edit(list_checkpoints(place.run / "checkpoints")[-1], format_version=2)
    return place.resume("--steps", "20")


@case
def resume_with_an_unknown_key_in_its_config(place: Place) -> list[str | Path]:
    arguments = place.resume()
    edit(place.run / "config.json", colour="blue")
    return arguments


@case
def eval_with_an_unknown_key_in_its_config(place: Place) -> list[str | Path]:
    edit(place.run / "config.json", colour="blue")
    return ["eval", place.run]


@case
def eval_of_another_format_version(place: Place) -> list[str | Path]:
    edit(list_checkpoints(place.run / "checkpoints")[-1], format_version=2)
    return ["eval", place.run]


@case
def eval_of_no_run(place: Place) -> list[str | Path]:
    return ["eval", place.free]


@case
def eval_of_a_file(place: Place) -> list[str | Path]:
    (place.free / "run").write_text("mine")
    return ["eval", place.free / "run"]


@case
def eval_without_a_checkpoint(place: Place) -> list[str | Path]:
    shutil.rmtree(place.run / "checkpoints")
    return ["eval", place.run]


@case
def render_of_no_run(place: Place) -> list[str | Path]:
    return ["render", place.free / "nothing"]


@case
def render_without_frames(place: Place) -> list[str | Path]:
    return ["render", place.run, "--frames", "0"]


@case
def render_at_no_size(place: Place) -> list[str | Path]:
    return ["render", place.run, "--scale", "0"]


@case
def survey_of_no_run(place: Place) -> list[str | Path]:
    return ["survey", place.free]


@case
def survey_into_a_file(place: Place) -> list[str | Path]:
    (place.free / "file").touch()
    return ["survey", place.run, "-o", place.free / "file"]


@case
def synth_into_a_folder_that_is_there(place: Place) -> list[str | Path]:
    return ["synth", place.scene]


def edit(path: Path, **changes: object) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def assert_one_paragraph(result: Result) -> None:
    assert result.status == 1, result
    assert re.match(r"\w+Error: \S", result.err)
    assert result.err.endswith("\n") and "\n" not in result.err[:-1]
    assert "Traceback" not in result.err + result.out


@pytest.mark.parametrize("name", CASES)
def test_text_of_wrong_input(
    name: str, tiny_scene: Path, run: Path, tmp_path: Path, plnerf: Call, snapshot: Callable[[str, str], None]
) -> None:
    if name == "no_cuda" and torch.cuda.is_available():
        pytest.skip("this machine has a CUDA device")
    (tmp_path / "free").mkdir()
    place = Place(tiny_scene, run, tmp_path / "free")
    arguments = CASES[name](place)
    result = plnerf(*arguments)
    assert_one_paragraph(result)
    trained_scene = json.loads((run / "config.json").read_text())["scene"]
    text = result.err.rstrip("\n").replace(trained_scene, "<trained scene>")
    snapshot(f"cli_{name}", text.replace(str(tmp_path), "<here>"))


def test_no_stored_text_is_left_over() -> None:
    stored = {path.stem for path in SNAPSHOTS.glob("cli_*.txt")}
    assert {name for name in stored if not name.startswith("cli_help_")} == {f"cli_{name}" for name in CASES}


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_that_cannot_be_used(name: str, tiny_scene: Path, tmp_path: Path, plnerf: Call) -> None:
    test_scene_errors.CASES[name](tiny_scene)
    result = plnerf("train", tiny_scene, "-o", tmp_path / "out", "--steps", "2")
    assert_one_paragraph(result)
    assert result.err.startswith("SceneError: ") and str(tiny_scene) in result.err
    assert not (tmp_path / "out" / "config.json").exists()


def test_a_folder_that_is_not_writable(tiny_scene: Path, tmp_path: Path, plnerf: Call) -> None:
    (tmp_path / "locked").mkdir(mode=0o500)
    if os.access(tmp_path / "locked", os.W_OK):
        pytest.skip("this user may write everywhere")
    assert_one_paragraph(plnerf("train", tiny_scene, "-o", tmp_path / "locked" / "out", "--steps", "2"))


def test_a_failing_disk_is_told_with_its_path(
    tiny_scene: Path, tmp_path: Path, plnerf: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever no stage expects of the system comes out as a paragraph too."""

    def broken(self: Path) -> bool:
        raise OSError(5, "Input/output error", str(self))

    monkeypatch.setattr(Path, "exists", broken)
    result = plnerf("train", tiny_scene, "-o", tmp_path / "out", "--steps", "2")
    assert_one_paragraph(result)
    assert "Input/output error" in result.err and str(tmp_path / "out") in result.err


def test_paths_are_printed_as_they_are(tmp_path: Path, plnerf: Call) -> None:
    """Neither markup nor emoji codes in a path are taken for commands to the console."""
    folder = tmp_path / "[bold]photos[/bold] :smile: [/x]"
    assert str(folder) in plnerf("eval", folder).err


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["fly"],
        ["train"],
        ["train", "scene"],
        ["train", "scene", "-o", "out", "--steps", "many"],
        ["train", "scene", "-o", "out", "--device", "tpu"],
        ["train", "scene", "-o", "out", "--colour", "blue"],
        ["train", "scene", "-o", "out", "--set", "train.rays=3"],
        ["bench", "--targets", "many"],
        ["compare", "scene", "--presets", "nerf", "pl-nerf", "--model.field.width", "32"],
        ["survey", "run", "--voltage-kv", "high"],
        ["eval"],
        ["render", "run", "--views", "all"],
        ["render", "run", "--outputs", "heat"],
    ],
    ids=" ".join,
)
def test_wrong_arguments_end_with_status_2(arguments: list[str], plnerf: Call) -> None:
    result = plnerf(*arguments)
    assert result.status == 2 and result.err and result.out == ""
    assert "Traceback" not in result.err


WRONG_SETTINGS = {
    "word_for_a_number": ["--train.rays", "many"],
    "fraction_for_a_whole_number": ["--train.rays", "1.5"],
    "unknown": ["--train.rayz", "3"],
    "unknown_section": ["--trian.rays", "3"],
    "of_another_preset": ["--model.field.width", "3"],
    "without_a_value": ["--model.sampler.final"],
    "too_few_values": ["--model.stretch", "1", "2"],
    "no_such_choice": ["--train.detail-map", "edges"],
    "no_such_item": ["--model.proposals.2.hidden", "3"],
    "as_a_value_that_is_no_truth": ["--train.pose-refinement", "yes"],
}


@pytest.mark.parametrize("name", WRONG_SETTINGS)
def test_text_of_wrong_settings(
    name: str, plnerf: Call, monkeypatch: pytest.MonkeyPatch, snapshot: Callable[[str, str], None]
) -> None:
    for variable, value in (("COLUMNS", "100"), ("NO_COLOR", "1")):
        monkeypatch.setenv(variable, value)
    terminal = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")  # where this can be written, boxes are drawn
    monkeypatch.setattr(sys, "stdout", terminal)
    done = plnerf("train", "scene", "-o", "out", *WRONG_SETTINGS[name])
    terminal.flush()
    assert done.status == 2 and terminal.buffer.tell() == 0 and "Traceback" not in done.err
    snapshot(f"options_{name}", "\n".join(line.rstrip() for line in done.err.rstrip().splitlines()))


def test_a_run_from_the_first_step_to_its_pictures(tiny_scene: Path, tmp_path: Path, plnerf: Call) -> None:
    out = tmp_path / "run"
    more = ("--train.loss.distortion", "0.5", "--train.pose-refinement", "--model.field.no-normals")
    budget = ("--steps", "3", "--seed", "7", "--downscale", "2")
    done = plnerf("train", tiny_scene, "-o", out, *budget, *SET, *more)
    assert (done.status, done.err) == (0, "")
    assert "images of 24x16, backend numba on cpu, seed 7" in done.out
    config = read_config(out)
    assert (config.steps, config.seconds, config.seed, config.downscale) == (3, None, 7, 2)
    assert config.train.rays == 128 and config.model.sampler.proposals == (24, 16)
    assert config.train.loss.distortion == 0.5 and config.train.pose_refinement
    assert not config.model.field.normals
    assert config.scene == str(tiny_scene.resolve())
    assert log_of(out)[-1]["step"] == 3

    finished = plnerf("train", tiny_scene, "-o", out, "--resume")
    assert (finished.status, finished.err) == (0, "")
    assert finished.out == "Nothing left to train: 3 of 3 steps are done. Give a larger budget to go on.\n"
    more = plnerf("train", tiny_scene, "-o", out, "--resume", "--steps", "5")
    assert more.status == 0 and "resumed at step 3" in more.out and "5 steps in" in more.out

    measured = plnerf("eval", out)
    assert measured.status == 0 and "images/0008.png" in measured.out
    assert json.loads((out / "eval" / "metrics.json").read_text())["protocol"]["step"] == 5
    rendered = plnerf("render", out, "--views", "test", "--outputs", "rgb", "--no-video")
    assert rendered.status == 0
    assert [path.name for path in sorted((out / "renders/test/rgb").iterdir())] == ["0000.png", "0001.png"]


def test_a_run_killed_before_its_first_checkpoint_begins_anew(
    tiny_scene: Path, tmp_path: Path, plnerf: Call
) -> None:
    out = tmp_path / "run"
    assert plnerf("train", tiny_scene, "-o", out, "--steps", "2", *SET).status == 0
    shutil.rmtree(out / "checkpoints")
    again = plnerf("train", tiny_scene, "-o", out, "--resume")
    assert again.status == 0 and "resumed" not in again.out and "2 steps in" in again.out
    assert [line["step"] for line in log_of(out) if "loss" in line] == [2]


def test_images_that_are_left_out_are_told_in_a_line(tiny_scene: Path, tmp_path: Path, plnerf: Call) -> None:
    listing = tiny_scene / "transforms.json"
    data = json.loads(listing.read_text())
    data["aabb_scale"] = 2  # instant-ngp's files may name images that are not there
    listing.write_text(json.dumps(data))
    (tiny_scene / "images/0003.png").unlink()
    done = plnerf("train", tiny_scene, "-o", tmp_path / "run", "--steps", "1", *SET)
    assert done.status == 0
    assert done.err.startswith("note: Left out") and done.err.count("\n") == 1 and "0003" in done.err


def test_ctrl_c_ends_with_status_130(
    tiny_scene: Path, tmp_path: Path, plnerf: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    def press(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("plnerf.pipeline.train_loop", press)
    done = plnerf("train", tiny_scene, "-o", tmp_path / "run", "--steps", "1", *SET)
    assert done.status == 130 and done.err.endswith("Interrupted. The run goes on with --resume.\n")
    for function in ("capture", "open_run"):
        monkeypatch.setattr(f"plnerf.pipeline.{function}", press)
    done = plnerf("capture", tmp_path, "-o", tmp_path / "scene")
    assert done.status == 130
    assert done.err.endswith("Interrupted. The same command goes on from what is done.\n")
    done = plnerf("eval", tmp_path / "run")
    assert done.status == 130 and done.err.endswith("Interrupted.\n")


def test_sigterm_does_as_ctrl_c(
    tiny_scene: Path, tmp_path: Path, plnerf: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    def end(*_: object, **__: object) -> None:
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(60)

    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr("plnerf.pipeline.train_loop", end)
    done = plnerf("train", tiny_scene, "-o", tmp_path / "run", "--steps", "1", *SET)
    assert done.status == 143 and done.err.endswith("Terminated. The run goes on with --resume.\n")
    assert signal.getsignal(signal.SIGTERM) == before


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_where_nothing_can_be_raised_comes_again(
    number: signal.Signals,
    status: int,
    tiny_scene: Path,
    tmp_path: Path,
    plnerf: Call,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In a destructor: Python prints a traceback there, and goes on."""

    class Destroyed:
        def __del__(self) -> None:
            os.kill(os.getpid(), number)

    def train(*_: object, **__: object) -> None:
        Destroyed()
        time.sleep(20)

    monkeypatch.setattr("plnerf.pipeline.train_loop", train)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # jobs in the background ignore it
    began = time.monotonic()
    try:
        done = plnerf("train", tiny_scene, "-o", tmp_path / "run", "--steps", "1", *SET)
    finally:
        signal.signal(signal.SIGINT, before)
    assert time.monotonic() - began < 15  # it does not sleep to the end
    assert done.status == status and "Traceback" not in done.err
    assert done.err.endswith("ed. The run goes on with --resume.\n")


@pytest.mark.slow
def test_the_real_command_too(tmp_path: Path) -> None:
    done = run_plnerf("eval", tmp_path)
    assert_one_paragraph(Result(done.returncode, done.stdout, done.stderr))


def test_output_that_nobody_reads_ends_the_command_quietly() -> None:
    """As behind `| head`: with the status that a shell gives SIGPIPE, and without a word."""
    command = [sys.executable, "-m", "plnerf", "train", "--help"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stderr is not None
    process.stdout.close()
    assert process.stderr.read() == ""
    assert process.wait() == 141


@pytest.mark.slow
def test_demo_goes_from_photos_to_pictures(
    tiny_scene: Path, tmp_path: Path, plnerf: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All of `plnerf demo`, on a smaller scene."""
    shutil.copy(pipeline.bundled_span() / "truth.json", tiny_scene)  # of other wires: none is found
    monkeypatch.setattr(pipeline, "bundled_span", lambda: tiny_scene)
    out = tmp_path / "demo"
    done = plnerf("demo", "-o", out, "--seconds", "0.5")
    assert done.status == 0
    for said in (f"report: {out}/survey/report.html", f"pictures: {out}/renders/path", "No wire was found."):
        assert said in done.out
    assert done.out.index(f"report: {out}/survey") < done.out.index(f"measures and panels: {out}/eval")
    score = json.loads((out / "survey" / "survey.score.json").read_text())
    assert score["conductors"]["found"] == 0 and score["conductors"]["missing"]
    assert open_run(out).seconds >= 0.5
    assert len(list((out / "eval" / "panels").glob("*.png"))) == 2
    assert (out / "renders" / "path-rgb.mp4").stat().st_size > 1000
    assert (out / "renders" / "path-depth.mp4").stat().st_size > 1000
    again = plnerf("demo", "-o", out)
    assert again.status == 1 and "is there already" in again.err


def test_the_survey_takes_its_settings_from_the_command_line(
    tmp_path: Path, plnerf: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[SurveyConfig] = []
    monkeypatch.setattr(pipeline, "survey", lambda source, config, *_: asked.append(config))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))  # for the crash report
    settings = ["--voltage-kv", "230", "--pictures", "2", "--refine.most-rounds", "7"]
    assert plnerf("survey", tmp_path, *settings).status == 70  # nothing comes back
    (config,) = asked
    assert (config.clearance.voltage_kv, config.pictures, config.refine.most_rounds) == (230.0, 2, 7)
    assert plnerf("survey", tmp_path, "--clearance.clearance-m", "-1").status == 1
