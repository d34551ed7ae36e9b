"""The stages in order.  Each is a function on paths; they meet only through files, so that any can be
run again alone.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from importlib import import_module
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

import torch
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from plnerf.errors import ConfigError
from plnerf.ops.dispatch import BackendChoice, resolve_backend
from plnerf.presets import preset_names
from plnerf.render.systems import SystemConfig
from plnerf.report.deliver import CONTENT, SurveyOptions
from plnerf.scene.files import check_folder
from plnerf.scene.scene import load_scene
from plnerf.score.score import score_survey
from plnerf.survey.lidar.las import SUFFIXES, survey_cloud
from plnerf.survey.run import survey_run
from plnerf.synth.options import SceneOptions, find_scene
from plnerf.synth.scene import summary, synthesize
from plnerf.train.checkpoint import list_checkpoints
from plnerf.train.config import Preset, RunConfig, fit_to_scene
from plnerf.train.evaluate import evaluate_run
from plnerf.train.loop import train
from plnerf.train.render_run import Output, Views, render_run
from plnerf.train.report import Report, RunReport
from plnerf.train.run import open_run, read_config
from plnerf.train.settings import override

Device = Literal["auto", "cpu", "cuda"]


# pl-nerf for the bundled span, as it is compared with pl-nerf-wire and measured in benches: cells across the
# line three times smaller than along it, upwards twice; three times as many samples on fewer rays, more of
# them on thin lines.
SPAN_SETTINGS = (
    "model.stretch=[1,3,2]",
    "model.sampler.proposals=[128,96]",
    "model.sampler.final=64",
    "train.rays=320",
    "train.normal_rays=16",
    "train.hash_lr=0.01",
    "train.mlp_lr=0.01",
    "train.detail_share=0.6",
    "train.detail_part=0.05",
    "train.loss.distortion=0.0003",
)


def find_preset(name: str) -> Preset[SystemConfig]:
    """The preset of a name.  Raises ConfigError naming the ones there are."""
    if name not in preset_names():
        raise ConfigError(f"There is no preset {name!r}. Presets: {', '.join(preset_names())}.")
    preset: Preset[SystemConfig] = import_module(f"plnerf.presets.{name.replace('-', '_')}").PRESET
    return preset


def presets_by_year() -> tuple[str, ...]:
    """The names of all presets, the oldest method first."""
    return tuple(sorted(preset_names(), key=lambda name: (find_preset(name).year, name)))


def bundled_span() -> Path:
    """The scene folder that comes with the package: one synthetic span with its exact truth."""
    return Path(str(files("plnerf"))) / "data" / "span"


def train_scene(  # noqa: PLR0913 (an argument is an option of the command)
    scene: Path,
    out: Path,
    *,
    preset: str = "pl-nerf",
    steps: int | None = None,
    seconds: float | None = None,
    downscale: int = 1,
    settings: Sequence[str] = (),
    seed: int = 0,
    device: Device = "auto",
    backend: BackendChoice = "auto",
    console: Console | None = None,
    report: Report | None = None,
) -> Path:
    """Trains a preset on a scene, into a new run folder.

    `settings` are overrides like model.field.direction_encoding=sh, of the preset's settings after these were
    fitted to the scene.  `report` takes the place of the progress bar and the logs.
    """
    if (out / "config.json").exists() or list_checkpoints(out / "checkpoints"):
        raise ConfigError(
            f"{out} already holds a run. Give --resume to go on with it, or another folder to train anew."
        )
    for setting in settings:
        if not setting.startswith(("model.", "train.")):
            raise ConfigError(
                f"--set changes settings of the model and the training (model.… or train.…), but got "
                f"{setting!r}. For the rest there are options of their own."
            )
    chosen = find_preset(preset)
    on = choose_device(device)
    config = RunConfig(
        scene=str(scene.resolve()),
        downscale=downscale,
        preset=preset,
        backend=resolve_backend(backend, torch.device(on)),
        device=on,
        model=chosen.model,
        train=chosen.train,
        steps=steps,
        seconds=seconds,
        seed=seed,
    )
    override(config, tuple(settings))  # a mistake shall show before any image is read
    loaded = load_scene(scene, store=out / "pixels", downscale=downscale)
    fitted = replace(config, model=fit_to_scene(chosen.model, loaded, chosen.cells_per_pixel))
    report = report or RunReport(out, console or Console())
    return train(override(fitted, tuple(settings)), out, report, scene=loaded)


def resume_run(
    scene: Path,
    out: Path,
    *,
    steps: int | None = None,
    seconds: float | None = None,
    console: Console | None = None,
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
    return train(config, out, RunReport(out, console or Console()))


def evaluate(run: Path, *, console: Console | None = None) -> dict[str, Any]:
    """Measures a run on its held-out images and returns the content of eval/metrics.json."""
    console = console or Console()
    with bar(console, "evaluate") as progress:
        metrics = evaluate_run(open_run(run), progress=progress)
    console.print((metrics.parent / "summary.md").read_text(), highlight=False, markup=False)
    _say(console, f"measures and panels: {metrics.parent}")
    content: dict[str, Any] = json.loads(metrics.read_text())
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
    console: Console | None = None,
) -> Path:
    """Renders views of a run to PNG and MP4; returns the folder."""
    console = console or Console()
    with bar(console, "render") as progress:
        folder = render_run(
            open_run(run), views=views, outputs=outputs, frames=frames, fps=fps, scale=scale, video=video,
            progress=progress,
        )  # fmt: skip
    _say(console, f"pictures: {folder}")
    return folder


def synthesize_scene(
    out: Path, scene: str = "span", options: SceneOptions | None = None, *, console: Console | None = None
) -> Path:
    """Renders a named synthetic scene, changed by `options`, into a new scene folder."""
    console = console or Console()
    options = options or SceneOptions()
    if scene == "span" and options.samples is None:
        options = replace(options, samples=64)
    config = options.apply(find_scene(scene))
    with bar(console, "synth") as progress:
        folder = synthesize(out, config, progress=progress)
    _say(console, f"scene folder: {folder} ({summary(folder)})")
    return folder


def run_demo(
    out: Path, *, seconds: float = 240.0, quick: bool = False, console: Console | None = None
) -> Path:
    """The bundled span: trained, evaluated, its wires surveyed and scored, rendered as a fly-along.

    `quick` is a short look at half size.
    """
    console = console or Console()
    if out.exists():
        raise ConfigError(
            f"The demo writes a new folder, but {out} is there already. Remove it, or name another: -o."
        )
    budget, downscale, frames, scale = (20.0, 2, 8, 0.5) if quick else (seconds, 1, 40, 0.5)
    span = bundled_span()
    train_scene(span, out, preset="pl-nerf-wire", seconds=budget, downscale=downscale, console=console)
    evaluate(out, console=console)
    survey(out, console=console)
    score_survey(out, truth=span, out=None, classes=None, console=console)
    render(out, views="path", outputs=("rgb", "depth"), frames=frames, fps=12.0, scale=scale, console=console)
    _say(console, f"Look at {out}: survey/report.html, eval/panels, renders.")
    _say(console, f"Curves of the training: tensorboard --logdir {out}")
    return out


def survey(
    source: Path, out: Path | None = None, options: SurveyOptions | None = None, *,
    console: Console | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Conductors, clearances and a report of a run, or of a LAS or LAZ file; returns survey.json's content.

    out: left out, the folder `survey` in the run folder, or beside the file.
    """
    console = console or Console()
    options = options or SurveyOptions()
    cloud = source.suffix.lower() in SUFFIXES
    folder = out or (source.with_name(f"{source.stem}-survey") if cloud else source / "survey")
    check_folder(folder)
    with bar(console, "survey") as progress:
        if cloud:
            page = survey_cloud(source, folder, options, progress)
        else:
            page = survey_run(open_run(source), folder, options, progress)
    content: dict[str, Any] = json.loads((folder / CONTENT).read_text())
    if not content["conductors"]:
        for text in ("No conductor was found.", *content["caveats"]):
            _say(console, text)
    _say(console, f"{len(content['conductors'])} conductors, {content['points']:,} points: {folder}")
    _say(console, f"report: {page}")
    return content


@contextmanager
def bar(console: Console, title: str) -> Iterator[Callable[[int, int], None]]:
    """A progress bar that is told (done, total)."""
    columns = (
        TextColumn(f"[bold]{title}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TimeRemainingColumn(compact=True),
    )
    with Progress(*columns, console=console) as progress:
        task = progress.add_task(title, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)


def _say(console: Console, text: str) -> None:
    """Prints text as it is: a path may hold what looks like markup."""
    console.print(text, markup=False, highlight=False, emoji=False, soft_wrap=True)


def choose_device(choice: Device) -> Literal["cpu", "cuda"]:
    """The device asked for, or the best one there is.  Raises ConfigError for a GPU that is not there."""
    if choice == "cuda" and not torch.cuda.is_available():
        raise ConfigError(
            "--device cuda was asked for, but PyTorch sees no CUDA device. Choose --device cpu."
        )
    if choice == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    return choice
