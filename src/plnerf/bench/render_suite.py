"""The suite `render`: seconds per megapixel of held-out views, and how alike the renderers' pictures are.

The first renderer of `RENDERERS` is the truth: each one below it is measured in turn with it and its pictures
are compared with the truth's.
"""

import statistics
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from rich.console import Console
from torch import Tensor

from plnerf.bench.config import BenchConfig
from plnerf.bench.tables import Table, figure
from plnerf.bench.timing import timed
from plnerf.bench.train_suite import scene_of, settings_of
from plnerf.pipeline import train_scene
from plnerf.render.pruning import can_prune
from plnerf.render.views import RenderedView, render_view
from plnerf.scene.build_store import Progress
from plnerf.scene.cameras import Cameras
from plnerf.train.evaluate import mean_appearance
from plnerf.train.metrics import psnr_of_mse
from plnerf.train.render_run import FLIGHT
from plnerf.train.report import SilentReport
from plnerf.train.run import TrainedRun, open_run

VIEWS = 3
TRAIN_SECONDS = 10.0  # where no run is given


@dataclass(frozen=True)
class Renderer:
    """One way to render a view."""

    name: str
    render: Callable[[TrainedRun, Cameras, Tensor], RenderedView]


def _whole(run: TrainedRun, camera: Cameras, appearance: Tensor) -> RenderedView:
    return render_view(run.model, camera, appearance, normals=False)


def renderers_of(run: TrainedRun) -> tuple[Renderer, ...]:
    """Those that can render this run: not every system can be pruned."""
    return RENDERERS if can_prune(run.model) else RENDERERS[:1]


def _pruned(run: TrainedRun, camera: Cameras, appearance: Tensor) -> RenderedView:
    return render_view(run.model, camera, appearance, normals=False, pruning=FLIGHT)


RENDERERS = (Renderer("every sample", _whole), Renderer("pruned, as flights are", _pruned))


@dataclass(frozen=True)
class ViewFigures:
    """One view by one renderer."""

    view: str
    renderer: str
    width_px: int
    height_px: int
    raw_s: tuple[float, ...]
    agreement_db: float | None
    """PSNR of the picture against the first renderer's; None for the first itself."""

    @property
    def seconds_per_megapixel(self) -> float:
        """Median over the repeats."""
        return statistics.median(self.raw_s) / (self.width_px * self.height_px * 1e-6)


def measure_rendering(
    run: TrainedRun,
    renderers: Sequence[Renderer] = RENDERERS,
    *,
    views: int = VIEWS,
    repeats: int = 3,
    progress: Progress | None = None,
) -> list[ViewFigures]:
    """Renders up to `views` held-out views, evenly chosen, by all renderers in turn.

    Each renderer renders the first view once before, unmeasured.
    """
    test, device = run.scene.test, run.model.appearance.device
    chosen = [test[i * len(test) // min(views, len(test))] for i in range(min(views, len(test)))]
    appearance, figures = mean_appearance(run), list[ViewFigures]()
    for done, i in enumerate(chosen, start=1):
        camera, raw = run.scene.cameras[[i]], [list[float]() for _ in renderers]
        pictures: list[RenderedView] = []
        for repeat in range(repeats + (done == 1)):
            for times, renderer in zip(raw, renderers, strict=True):
                seconds, picture = timed(partial(renderer.render, run, camera, appearance), device)
                pictures.append(picture)
                if repeat or done > 1:
                    times.append(seconds)
        width, height = camera.size_px[0].tolist()
        for at, (times, renderer) in enumerate(zip(raw, renderers, strict=True)):
            agreement = agreement_db(pictures[at], pictures[0]) if at else None
            name = run.scene.names[i]
            figures.append(ViewFigures(name, renderer.name, width, height, tuple(times), agreement))
        if progress is not None:
            progress(done, len(chosen))
    return figures


def agreement_db(picture: RenderedView, truth: RenderedView) -> float:
    """PSNR in dB of one picture against another; infinite where they are equal."""
    error = picture.rgb.astype(np.float64) - truth.rgb.astype(np.float64)
    return psnr_of_mse(float((error**2).mean()))


def run_to_render(bench: BenchConfig, console: Console) -> TrainedRun:
    """The run that was given, or else that of the suite train, or else one trained for a few seconds."""
    if bench.run is not None:
        return open_run(bench.run)
    folder = bench.out / "train"
    if not folder.exists():
        folder = bench.out / "render"
        seconds, settings = 2.0 if bench.quick else TRAIN_SECONDS, settings_of(bench)
        with console.status(f"training for {seconds:.0f} s"):
            train_scene(
                scene_of(bench), folder, preset=bench.preset, model=settings.model,
                train=replace(settings.train, validations=0), detect=settings.detect, seconds=seconds,
                downscale=bench.downscale, seed=bench.seed, device=bench.device, backend=bench.backend,
                report=SilentReport(),
            )  # fmt: skip
    return open_run(folder)


def render_table(run: TrainedRun, figures: Sequence[ViewFigures]) -> Table:
    """Views by renderer, then each renderer's median."""
    rows = [
        (
            one.view, one.renderer, f"{one.width_px}×{one.height_px}",
            figure(statistics.median(one.raw_s)), figure(one.seconds_per_megapixel),
            figure(one.agreement_db, 4),
        )
        for one in figures
    ]  # fmt: skip
    for name in dict.fromkeys(one.renderer for one in figures):
        mine = [one for one in figures if one.renderer == name]
        seconds = statistics.median(statistics.median(one.raw_s) for one in mine)
        median = statistics.median(one.seconds_per_megapixel for one in mine)
        known = [one.agreement_db for one in mine if one.agreement_db is not None]
        worst = figure(min(known), 4) if known else "–"
        rows.append(("**median; worst agreement**", name, "", figure(seconds), figure(median), worst))
    columns = ("held-out view", "renderer", "px", "s a view", "s per megapixel", "agreement dB")
    note = (
        f"{run.folder} at step {run.step}, backend {run.config.backend} on {run.config.device}; colour, "
        "depth and accumulation of every pixel, no normals; medians of the repeats, nothing written to disk. "
        "Agreement is the PSNR against the first renderer's picture."
    )
    return Table("Rendering", columns, tuple(rows), (note,))


def render_json(run: TrainedRun, figures: Sequence[ViewFigures]) -> dict[str, Any]:
    """Everything measured, as JSON values."""
    views = [{**asdict(one), "seconds_per_megapixel": one.seconds_per_megapixel} for one in figures]
    return {"run": str(run.folder), "step": run.step, "config": asdict(run.config), "views": views}
