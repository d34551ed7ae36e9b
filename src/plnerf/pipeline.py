"""The stages in order: paths and values in, values and files out.  Nothing is printed.

    photos, video -> capture_scene -> train_scene -> evaluate, render
    a run, a scene or a point cloud -> survey -> write_survey

Stages meet through files, so that any can be run again alone; `reconstruct.py` runs all of them and skips
those that are up to date.  Progress is reported by callbacks.
"""

import json
from dataclasses import replace
from datetime import UTC, datetime
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

import torch

from plnerf.capture.capture import CaptureConfig, capture
from plnerf.capture.mapping import Tell
from plnerf.capture.poses_config import PosesConfig
from plnerf.detect.config import DetectConfig
from plnerf.detect.detect import FindWires
from plnerf.errors import ConfigError
from plnerf.export.exports import FILES, write_exports
from plnerf.line.files import SURVEY_FILE, write_survey_json
from plnerf.line.survey import Survey
from plnerf.ops.backends import BackendChoice
from plnerf.presets._find import find_preset
from plnerf.render.config import SystemConfig
from plnerf.render.self_test import resolve_backend
from plnerf.report.page import write_report
from plnerf.scene.build_store import Progress
from plnerf.scene.formats import has_poses
from plnerf.scene.only_writer import only_writer
from plnerf.scene.scene import load_scene
from plnerf.scene.whole_result import whole_result
from plnerf.survey.config import SurveyConfig
from plnerf.survey.lidar.point_cloud import SUFFIXES, read_cloud
from plnerf.survey.run import survey_cloud, survey_run, survey_scene
from plnerf.synth.hang_config import HangConfig
from plnerf.synth.hang_scene import hang_in_photos
from plnerf.synth.photos import write_photos
from plnerf.synth.scene_options import SceneOptions, find_scene
from plnerf.synth.synthesize import synthesize
from plnerf.train.config import RunConfig, TrainConfig, Until
from plnerf.train.evaluate import evaluate_run
from plnerf.train.fitted import finest_of, fit_to_scene
from plnerf.train.loop import train as train_loop
from plnerf.train.ranks import join_ranks
from plnerf.train.render_run import Output, Views, render_run
from plnerf.train.report import Report, RunLog
from plnerf.train.run import open_run, read_config, remove_start, require_new_run
from plnerf.train.settings import from_json, to_json
from plnerf.train.visitor import NOBODY, Visitor

Device = Literal["auto", "cpu", "cuda"]
PAGE = "report.html"
"""Of a survey, in its folder."""


def bundled_span() -> Path:
    """The scene folder that comes with the package: one synthetic span with its exact truth."""
    return Path(str(files("plnerf"))) / "data" / "span"


def capture_scene(
    source: Path | str, out: Path | str, config: CaptureConfig | None = None, progress: Tell | None = None
) -> Path:
    """Makes a scene folder of photos or a video; returns the folder.

    progress: called with the stage's name, what is done of it, and of how much.  Errors as of `capture`.
    """
    progress = progress or (lambda stage, done, of: None)
    with only_writer(Path(out)):
        return capture(Path(source), Path(out), config or CaptureConfig(), progress).parent


def train_scene(  # noqa: PLR0913 (an argument is an option of the command)
    scene: Path | str,
    out: Path | str,
    *,
    preset: str = "pl-nerf",
    model: SystemConfig | None = None,
    train: TrainConfig | None = None,
    detect: DetectConfig | None = None,
    poses: PosesConfig | None = None,
    steps: int | None = None,
    seconds: float | None = None,
    until: Until = "spent",
    downscale: int = 1,
    seed: int = 0,
    device: Device = "auto",
    backend: BackendChoice = "auto",
    report: Report | None = None,
    finder: FindWires | None = None,
    visitor: Visitor = NOBODY,
) -> Path:
    """Trains a radiance field on a scene, into a new run folder, which returns.

    model, train, detect, poses: settings; None: the preset's.  A grid's `finest` that is the preset's is
    fitted to the scene's pixels.  The budget is either `steps` or `seconds`; until "settled", the run may end
    before it is spent.  report: hears of every step;
    None: a log in the run folder.  finder: finds the wires in place of `detect_wires`.  visitor: may look at
    the model between two steps and end the run early.  Where torchrun started several processes, each calls
    this: see `train/ranks.py`.  Raises PlnerfError where another process writes into the folder.
    """
    scene, out, on = Path(scene), Path(out), choose_device(device)
    with join_ranks(on) as ranks, ranks.only_writer(out):
        with ranks.first_alone():
            if ranks.first:
                require_new_run(out)
                remove_start(out)
            chosen = find_preset(preset)
            config = RunConfig(
                scene=str(scene.resolve()),
                downscale=downscale,
                preset=preset,
                backend=resolve_backend(backend, torch.device(on)),
                device=on,
                model=model or chosen.model,
                train=train or chosen.train,
                detect=detect or DetectConfig(),
                poses=poses or PosesConfig(),
                steps=steps,
                seconds=seconds,
                until=until,
                seed=seed,
            )
            # What would not come back from config.json, such as infinity, is refused before anything is read.
            config = from_json(RunConfig, to_json(config), "The settings")
            ranks.share_of(config.train)
            loaded = load_scene(scene, store=out / "pixels", downscale=downscale)
            if finest_of(config.model) == finest_of(chosen.model):
                config = replace(config, model=fit_to_scene(config.model, loaded, chosen.cells_per_pixel))
        return train_loop(
            config, out, report or RunLog(out), scene=loaded, finder=finder, ranks=ranks, visitor=visitor
        )


def resume_run(
    scene: Path,
    out: Path,
    *,
    steps: int | None = None,
    seconds: float | None = None,
    until: Until | None = None,
    report: Report | None = None,
    visitor: Visitor = NOBODY,
) -> Path:
    """Goes on with a run from its newest checkpoint, with its own settings; a larger budget may be given, and
    another end."""
    config = read_config(out)
    if Path(config.scene) != scene.resolve():
        raise ConfigError(
            f"The run in {out} was trained on {config.scene}, not on {scene.resolve()}. Give that scene, or "
            "another folder to train anew."
        )
    if steps is not None or seconds is not None:
        config = replace(config, steps=steps, seconds=seconds)
    config = replace(config, until=until or config.until)
    with join_ranks(config.device) as ranks, ranks.only_writer(out):
        return train_loop(config, out, report or RunLog(out), ranks=ranks, visitor=visitor)


def evaluate(run: Path, progress: Progress | None = None) -> dict[str, Any]:
    """Measures a run on its held-out images and returns the content of eval/metrics.json."""
    opened = open_run(run)
    with only_writer(run / "eval"):
        content: dict[str, Any] = json.loads(evaluate_run(opened, progress=progress).read_text())
    return content


def render(
    run: Path,
    *,
    views: Views,
    outputs: tuple[Output, ...],
    frames: int = 96,
    fps: float = 24.0,
    scale: float = 1.0,
    video: bool = True,
    progress: Progress | None = None,
) -> Path:
    """Renders views of a run to PNG and MP4, without the photos; returns the folder."""
    opened = open_run(run)
    with only_writer(run / "renders"):
        return render_run(
            opened, views=views, outputs=outputs, frames=frames, fps=fps, scale=scale, video=video,
            progress=progress,
        )  # fmt: skip


def synthesize_scene(
    out: Path,
    scene: str = "span",
    options: SceneOptions | None = None,
    progress: Progress | None = None,
    photos: bool = False,
) -> Path:
    """Renders a named synthetic scene, changed by `options`, into a new scene folder, which returns.

    photos: also writes `photos` in it, its images as a camera leaves them: without poses, with positions.
    """
    options = options or SceneOptions()
    if scene == "span" and options.samples is None:
        options = replace(options, samples=64)
    folder = synthesize(out, options.apply(find_scene(scene, options.seed)), progress=progress)
    if photos:
        write_photos(folder, folder / "photos", seed=options.seed or 0)
    return folder


def hang_wires(
    scene: Path | str, out: Path | str, config: HangConfig | None = None, progress: Tell | None = None
) -> Path:
    """Draws exact catenaries into the photos of a scene, into a new folder, which returns.

    The folder holds images/ and truth.json, and no poses: those are to be found anew, by `capture_scene`.
    progress: called with the stage's name, what is done of it, and of how much.
    """
    return hang_in_photos(Path(scene), Path(out), config, progress)


def survey(
    source: Path,
    config: SurveyConfig | None = None,
    out: Path | None = None,
    progress: Progress | None = None,
    finder: FindWires | None = None,
) -> tuple[Survey, Path]:
    """Surveys a run, a scene or a LAS or LAZ file, and writes the survey; returns it and its folder.

    out: None: `survey` in the folder of the run or scene, or beside the file.  finder: finds the wires in
    images in place of `detect_wires`.
    """
    is_cloud = source.suffix.lower() in SUFFIXES
    is_scene = not is_cloud and not (source / "config.json").exists() and has_poses(source)
    root = source.parent if is_scene and source.is_file() else source
    folder = out or (source.with_name(f"{source.stem}-survey") if is_cloud else root / "survey")
    if not is_cloud and not is_scene and not (source / "config.json").exists():
        raise ConfigError(
            f"{source} is neither a run folder, nor a scene with poses, nor a LAS or LAZ file. Give one of "
            "these."
        )
    with only_writer(folder):
        if is_cloud:
            found = survey_cloud(read_cloud(source), config, progress)
        elif is_scene:
            found = survey_scene(load_scene(source, store=folder / "pixels"), config, progress, finder)
        else:
            found = survey_run(open_run(source), config, progress, finder)
        now = datetime.now(UTC).strftime("%Y-%m-%d %H:%M")
        found = replace(found, made={**found.made, "date (UTC)": now})
        _write_survey(found, folder)
    return found, folder


def write_survey(survey: Survey, folder: Path | str) -> Path:
    """Writes a survey into a folder: files for other programs, survey.json and the report.

    Returns the report's path.  An earlier survey there is replaced once all files are written, and stays as
    it was where one cannot be.  Raises SurveyError for a survey that a file cannot hold, PlnerfError where
    one cannot be written, or another process writes into the folder.
    """
    with only_writer(Path(folder)):
        _write_survey(survey, Path(folder))
    return Path(folder) / PAGE


def _write_survey(survey: Survey, folder: Path) -> None:
    """`write_survey` by the only writer of the folder."""
    with whole_result(folder, (*FILES, SURVEY_FILE, PAGE)) as new:
        exports = write_exports(survey, new)
        write_survey_json(new / SURVEY_FILE, survey)
        write_report(new / PAGE, survey, (*exports.files, SURVEY_FILE), exports.about)


def choose_device(choice: Device) -> Literal["cpu", "cuda"]:
    """The device asked for, or the best one there is.  Raises ConfigError for a GPU that is not there."""
    if choice == "cuda" and not torch.cuda.is_available():
        raise ConfigError(
            "--device cuda was asked for, but PyTorch sees no CUDA device. Choose --device cpu."
        )
    if choice == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    return choice
