"""The commands that train a radiance field, measure it and render it."""

from functools import partial
from pathlib import Path
from typing import Any, Literal

import tyro
from rich.console import Console

from plnerf.cli.options import AsOptions, BackendName, Device, Out, Output, PresetName, settings_of
from plnerf.cli.view import require_viewer
from plnerf.errors import ConfigError
from plnerf.terminal import Terminal


def train(  # noqa: PLR0913 (an argument is an option)
    scene: tyro.conf.Positional[Path],
    *,
    out: Out,
    preset: PresetName = "pl-nerf",
    seconds: float | None = None,
    steps: int | None = None,
    until: Literal["spent", "settled"] = "spent",
    downscale: int = 1,
    resume: bool = False,
    view: bool = False,
    seed: int = 0,
    line_azimuth: float | None = None,
    device: Device = "auto",
    backend: BackendName = "auto",
    settings: AsOptions,
) -> None:
    """Train a radiance field on images with known camera poses.

    In N processes: torchrun --nproc-per-node N -m plnerf train SCENE -o RUN

    Args:
        scene: Folder with transforms.json (nerfstudio, instant-ngp) or a COLMAP model, or the file itself.
        out: Run folder to write.
        preset: Named settings to start from; --help-all shows their values.
        seconds: Budget in seconds of training; 300 when neither this nor --steps is given, 3600 to settle.
        steps: Budget in steps; such a run can be repeated, and resumed, to the same bits.
        until: When to end: with the budget, or before it is spent, once held-out pixels no longer gain.
        downscale: Integer factor by which images are made smaller.
        resume: Go on with the run in OUT from its newest checkpoint, with its own settings.
        view: Show the field in a browser while it is trained (needs plnerf[view]).
        seed: Decides the initial weights and every random draw.
        line_azimuth: Direction of the line in degrees clockwise from north (the world's +y); found in the
            images when left out.
        device: Where to train.
        backend: Implementation of the ops: numba on a CPU, triton on a CUDA device, plain torch anywhere.
        settings: Settings of the run.
    """
    from plnerf.console import RunConsole, say
    from plnerf.pipeline import resume_run, train_scene
    from plnerf.train.ranks import processes_here
    from plnerf.train.visitor import NOBODY, Visitor

    console = Terminal()
    report = RunConsole(out, console)
    visitor: Visitor = NOBODY
    if view:
        require_viewer("plnerf train --view")
        if processes_here() > 1:
            raise ConfigError(
                "--view shows a training in one process, but torchrun started several. Leave it out, and "
                f"follow the curves: tensorboard --logdir {out}"
            )
        from plnerf.view.watched_training import WatchedTraining

        visitor = WatchedTraining(report, partial(say, console))
    if resume and (line_azimuth is not None or settings != settings_of(preset)):
        raise ConfigError(
            "--resume goes on with the run's own settings, so it takes no others. Change them in "
            f"{out / 'config.json'}, or train anew into another folder."
        )
    if resume:
        other = None if until == "spent" else until
        resume_run(scene, out, steps=steps, seconds=seconds, until=other, report=report, visitor=visitor)
    else:
        usual = {"spent": 300.0, "settled": 3600.0}[until]
        budget = usual if seconds is None and steps is None else seconds
        train_scene(
            scene, out, preset=preset, model=settings.model, train=settings.train,
            detect=settings.detect.along(line_azimuth), poses=settings.poses, steps=steps, seconds=budget,
            until=until, downscale=downscale, seed=seed, device=device, backend=backend, report=report,
            visitor=visitor,
        )  # fmt: skip


def train_shown(console: Console, scene: Path, out: Path, **options: Any) -> None:
    """`train_scene` with a bar."""
    from plnerf.console import RunConsole
    from plnerf.pipeline import train_scene

    train_scene(scene, out, **options, report=RunConsole(out, console))


def resume_shown(console: Console, scene: Path, out: Path) -> None:
    """`resume_run` with a bar."""
    from plnerf.console import RunConsole
    from plnerf.pipeline import resume_run

    resume_run(scene, out, report=RunConsole(out, console))


def eval(run: tyro.conf.Positional[Path]) -> None:
    """Measure a run on its held-out images: PSNR, SSIM, wire PSNR, side-by-side panels.

    Args:
        run: Run folder written by `plnerf train`.
    """
    eval_shown(Terminal(), run)


def eval_shown(console: Console, run: Path) -> None:
    """`evaluate` with a bar and its summary."""
    from plnerf.console import bar, say
    from plnerf.pipeline import evaluate

    with bar(console, "evaluate") as progress:
        evaluate(run, progress)
    console.print((run / "eval" / "summary.md").read_text(), highlight=False, markup=False)
    say(console, f"measures and panels: {run / 'eval'}")


def render(
    run: tyro.conf.Positional[Path],
    *,
    views: Literal["test", "train", "path"] = "path",
    outputs: tuple[Output, ...] = ("rgb", "depth"),
    frames: int = 96,
    fps: float = 24.0,
    scale: float = 1.0,
    video: bool = True,
) -> None:
    """Render views of a run to PNG and MP4; the photos are not needed.

    Args:
        run: Run folder written by `plnerf train`.
        views: Held-out views, training views, or a smooth path along the training cameras.
        outputs: What to render.
        frames: Frames of the path.
        fps: Frames per second of the video.
        scale: Size of the pictures relative to the training images.
        video: Whether to write an MP4 beside the PNGs.
    """
    render_shown(
        Terminal(), run, views=views, outputs=outputs, frames=frames, fps=fps, scale=scale, video=video
    )


def render_shown(console: Console, run: Path, **options: Any) -> None:
    """`pipeline.render` with a progress bar; by default colour and depth along a path."""
    from plnerf.console import bar, say
    from plnerf.pipeline import render as render_views

    with bar(console, "render") as progress:
        folder = render_views(
            run, **({"views": "path", "outputs": ("rgb", "depth")} | options), progress=progress
        )
    say(console, f"pictures: {folder}")


def demo(out: Out = Path("runs/demo"), seconds: float = 240.0, quick: bool = False) -> None:
    """Train on the bundled span, survey it, evaluate and render it; no data and no options needed.

    Args:
        out: Folder for everything that is made.
        seconds: Training time in seconds.
        quick: A short version: 45 s of training at half size (of which finding wires takes nearly half) and
            a short fly-along.
    """
    from plnerf.cli.survey import score_shown, survey_shown
    from plnerf.console import say
    from plnerf.pipeline import bundled_span

    if out.exists():
        raise ConfigError(
            f"The demo writes a new folder, but {out} is there already. Remove it, or name another: -o."
        )
    budget, downscale, frames = (45.0, 2, 8) if quick else (seconds, 1, 40)
    console, span = Terminal(), bundled_span()
    train_shown(console, span, out, preset="pl-nerf-wire", seconds=budget, downscale=downscale)
    survey_shown(console, out)  # the report comes first: what follows takes a minute more
    score_shown(console, out, truth=span)
    eval_shown(console, out)
    render_shown(console, out, frames=frames, fps=12.0, scale=0.5)
    say(console, f"Look at {out}: survey/report.html, eval/panels, renders.")
    say(console, f"Curves of the training: tensorboard --logdir {out}")
