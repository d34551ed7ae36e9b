"""The stages in order: paths and values in, values and files out.  Nothing is printed.

    photos, video -> capture_scene -> train_scene -> evaluate, render
    a run, a scene or a point cloud -> survey -> write_survey

Stages meet through files, so that any can be run again alone; `reconstruct` runs all of them and skips those
that are up to date.  Progress is reported by callbacks.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

import torch

from plnerf.capture.capture import CaptureConfig, capture
from plnerf.capture.mapping import Tell
from plnerf.detect.config import DetectConfig
from plnerf.errors import ConfigError
from plnerf.export.exports import FILES, write_exports
from plnerf.line.files import SURVEY_FILE, write_survey_json
from plnerf.line.survey import Survey
from plnerf.ops.backends import BackendChoice
from plnerf.ops.dispatch import resolve_backend
from plnerf.presets._find import find_preset
from plnerf.render.config import SystemConfig
from plnerf.render.picture_files import write_text
from plnerf.report.page import write_report
from plnerf.scene.build_store import Progress
from plnerf.scene.fingerprint import file_sha256, photos_sha256
from plnerf.scene.formats import has_poses, read_listing
from plnerf.scene.only_writer import only_writer
from plnerf.scene.scene import load_scene
from plnerf.scene.strict_json import object_of, read_json, shown
from plnerf.scene.whole_result import whole_result
from plnerf.survey.config import SurveyConfig
from plnerf.survey.lidar.point_cloud import SUFFIXES, read_cloud
from plnerf.survey.run import survey_cloud, survey_run, survey_scene
from plnerf.synth.hang_config import HangConfig
from plnerf.synth.hang_scene import hang_in_photos
from plnerf.synth.scene_options import SceneOptions, find_scene
from plnerf.synth.synthesize import synthesize
from plnerf.train.checkpoint import list_checkpoints
from plnerf.train.config import RunConfig, TrainConfig
from plnerf.train.evaluate import evaluate_run
from plnerf.train.fitted import finest_of, fit_to_scene
from plnerf.train.loop import train as train_loop
from plnerf.train.render_run import Output, Views, render_run
from plnerf.train.report import Report, RunLog
from plnerf.train.run import open_run, read_config
from plnerf.train.settings import from_json, to_json

Device = Literal["auto", "cpu", "cuda"]
PAGE = "report.html"
"""Of a survey, in its folder."""
STATE = "reconstruct.json"
RESULTS = {"eval": "eval", "render": "renders", "survey": "survey"}
"""Of the stages after training: folders in that of the run."""


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
    steps: int | None = None,
    seconds: float | None = None,
    downscale: int = 1,
    seed: int = 0,
    device: Device = "auto",
    backend: BackendChoice = "auto",
    report: Report | None = None,
) -> Path:
    """Trains a radiance field on a scene, into a new run folder, which returns.

    model, train, detect: settings; None: the preset's.  A grid's `finest` that is the preset's is fitted to
    the scene's pixels.  The budget is either `steps` or `seconds`.  report: hears of every step; None: a log
    in the run folder.  Raises PlnerfError where another process writes into the folder.
    """
    scene, out = Path(scene), Path(out)
    with only_writer(out):
        if not (out / "config.json").exists() and (kept := list_checkpoints(out / "checkpoints")):
            raise ConfigError(
                f"{out} holds the checkpoint {kept[-1].name} of a run, but not its settings, config.json. "
                "Put that file back, or remove the folder to train anew."
            )
        if (out / "config.json").exists():
            raise ConfigError(
                f"{out} already holds a run. Give --resume to go on with it, or another folder to train anew."
            )
        chosen, on = find_preset(preset), choose_device(device)
        config = RunConfig(
            scene=str(scene.resolve()),
            downscale=downscale,
            preset=preset,
            backend=resolve_backend(backend, torch.device(on)),
            device=on,
            model=model or chosen.model,
            train=train or chosen.train,
            detect=detect or DetectConfig(),
            steps=steps,
            seconds=seconds,
            seed=seed,
        )
        # What would not come back from config.json, such as infinity, is refused before anything is read.
        config = from_json(RunConfig, to_json(config), "The settings")
        loaded = load_scene(scene, store=out / "pixels", downscale=downscale)
        if finest_of(config.model) == finest_of(chosen.model):
            config = replace(config, model=fit_to_scene(config.model, loaded, chosen.cells_per_pixel))
        return train_loop(config, out, report or RunLog(out), scene=loaded)


def resume_run(
    scene: Path,
    out: Path,
    *,
    steps: int | None = None,
    seconds: float | None = None,
    report: Report | None = None,
) -> Path:
    """Goes on with a run from its newest checkpoint, with its own settings; a larger budget may be given."""
    config = read_config(out)
    if Path(config.scene) != scene.resolve():
        raise ConfigError(
            f"The run in {out} was trained on {config.scene}, not on {scene.resolve()}. Give that scene, or "
            "another folder to train anew."
        )
    if steps is not None or seconds is not None:
        config = replace(config, steps=steps, seconds=seconds)
    with only_writer(out):
        return train_loop(config, out, report or RunLog(out))


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
    out: Path, scene: str = "span", options: SceneOptions | None = None, progress: Progress | None = None
) -> Path:
    """Renders a named synthetic scene, changed by `options`, into a new scene folder, which returns."""
    options = options or SceneOptions()
    if scene == "span" and options.samples is None:
        options = replace(options, samples=64)
    return synthesize(out, options.apply(find_scene(scene, options.seed)), progress=progress)


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
) -> tuple[Survey, Path]:
    """Surveys a run, a scene or a LAS or LAZ file, and writes the survey; returns it and its folder.

    out: None: `survey` in the folder of the run or scene, or beside the file.
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
            found = survey_scene(load_scene(source, store=folder / "pixels"), config, progress)
        else:
            found = survey_run(open_run(source), config, progress)
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


@dataclass(frozen=True)
class Training:
    """What `reconstruct` trains; a change of any of it trains anew."""

    preset: str = "pl-nerf-wire"
    seconds: float = 300.0
    downscale: int = 1
    seed: int = 0


def _render_path(run: Path) -> Path:
    return render(run, views="path", outputs=("rgb", "depth"))


@dataclass(frozen=True)
class Stages:
    """The stages that `reconstruct` calls; the command line puts in its own, which show their progress."""

    capture: Callable[[Path, Path, CaptureConfig], object] = capture_scene
    train: Callable[..., object] = train_scene
    resume: Callable[[Path, Path], object] = resume_run
    eval: Callable[[Path], object] = evaluate
    render: Callable[[Path], object] = _render_path
    survey: Callable[[Path], object] = survey


def reconstruct(
    source: Path,
    out: Path,
    training: Training | None = None,
    capture: CaptureConfig | None = None,
    stages: Stages | None = None,
    skipped: Callable[[str], None] = lambda text: None,
) -> Path:
    """Photos in, pictures and points on wires out; returns the run folder.  Errors are those of the stages.

        OUT/scene/    plnerf capture     (left out where the input is a scene with poses)
        OUT/run/      plnerf train, eval, render, survey

    A stage is done again where its inputs changed (poses, photos, settings, the newest checkpoint), and where
    a file that it wrote is gone.  A run of other settings is kept, as run-1, run-2, ...  skipped: called with
    a line about every stage that is up to date, and about a run that is put aside.
    """
    with only_writer(out):
        return _reconstruct(source, out, training or Training(), capture, stages or Stages(), skipped)


def _reconstruct(
    source: Path,
    out: Path,
    training: Training,
    capture: CaptureConfig | None,
    stages: Stages,
    skipped: Callable[[str], None],
) -> Path:
    scene, run = source, out / "run"
    if not has_poses(source):
        scene = out / "scene"
        stages.capture(source, scene, capture or CaptureConfig())
    listing = read_listing(scene)
    transforms = scene / "transforms.json" if scene.is_dir() else scene
    wanted = {
        **asdict(training), "scene": str(scene.resolve()),
        "poses": file_sha256(transforms) if transforms.is_file() else "", "photos": photos_sha256(listing),
    }  # fmt: skip
    state = _read_state(out / STATE)
    if state.get("training") not in {None, json.dumps(wanted)} and run.exists():
        aside = next(path for k in range(1, 10_000) if not (path := out / f"run-{k}").exists())
        with only_writer(run):  # not from under a training
            pass
        run.replace(aside)
        skipped(f"the run of other settings or poses: {aside}")
        state = {}
    state["training"] = json.dumps(wanted)
    write_text(out / STATE, json.dumps(state, indent=1) + "\n")
    if (run / "config.json").exists():
        stages.resume(scene, run)
    else:
        stages.train(scene, run, **asdict(training))
    newest = list_checkpoints(run / "checkpoints")[-1].stem
    for name, stage in (("eval", stages.eval), ("render", stages.render), ("survey", stages.survey)):
        if state.get(name) == newest and not _lost(run, state.get(f"{name} files", "")):
            skipped(f"{name}: there already, of {newest}")
            continue
        stage(run)
        written = sorted(path for path in (run / RESULTS[name]).rglob("*") if path.is_file())
        state[name] = newest
        state[f"{name} files"] = "\n".join(path.relative_to(run).as_posix() for path in written)
        write_text(out / STATE, json.dumps(state, indent=1) + "\n")
    return run


def _lost(run: Path, names: str) -> list[str]:
    """The files of a result that are no longer there.

    What they hold is not compared: whoever surveys again with other settings wants that survey.
    """
    return [name for name in names.splitlines() if not (run / name).is_file()]


def _read_state(path: Path) -> dict[str, str]:
    """What was done of which inputs; nothing where there is no file yet."""
    if not path.exists():
        return {}
    do = "Remove it: the run is kept, and another one is trained."
    state = object_of(read_json(path, ConfigError, do), str(path), ConfigError, do)
    if not all(isinstance(value, str) for value in state.values()):
        raise ConfigError(f"{path} must hold texts, but holds {shown(state)}. {do}")
    return {str(key): str(value) for key, value in state.items()}


def choose_device(choice: Device) -> Literal["cpu", "cuda"]:
    """The device asked for, or the best one there is.  Raises ConfigError for a GPU that is not there."""
    if choice == "cuda" and not torch.cuda.is_available():
        raise ConfigError(
            "--device cuda was asked for, but PyTorch sees no CUDA device. Choose --device cpu."
        )
    if choice == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    return choice
