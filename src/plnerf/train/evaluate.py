"""Held-out images rendered and measured, with everything that somebody needs to repeat the numbers.

Writes into the run folder: eval/panels/NAME.png, eval/summary.md and eval/metrics.json, all or none of them.
"""

import json
import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from plnerf.render.panels import evaluation_panel
from plnerf.render.picture_files import write_png, write_text
from plnerf.render.pictures import world_depth
from plnerf.render.views import RenderedView, render_view
from plnerf.scene.build_store import Progress
from plnerf.scene.scene import Scene
from plnerf.scene.whole_result import whole_result
from plnerf.train.metrics import NEAR_WIRE_PX, Lpips, mean_inside, psnr, ssim_map
from plnerf.train.protocol import plain, protocol, summary
from plnerf.train.run import TrainedRun
from plnerf.train.true_pictures import (
    DepthError,
    at_full_size,
    depth_error,
    read_depth_mm,
    read_wire_mask,
    reduced_wire_mask,
)

FORMAT_VERSION = 1


@dataclass(frozen=True)
class ImageScores:
    """What is measured on one held-out image; None where the scene does not know enough."""

    name: str
    psnr_db: float | None
    ssim: float | None
    lpips: float | None
    wire_psnr_db: float | None
    """Over the wires' pixels alone."""
    elsewhere_psnr_db: float | None
    """Over all other pixels."""
    near_wire_psnr_db: float | None
    """Over the wires' pixels and those within `NEAR_WIRE_PX` of them."""
    near_wire_ssim: float | None
    """Over the same pixels."""
    wire_depth: DepthError | None
    elsewhere_depth: DepthError | None
    """Where the image has no wire mask: over all pixels."""


def evaluate_run(run: TrainedRun, *, chunk_rays: int | None = None, progress: Progress | None = None) -> Path:
    """Renders and measures every held-out image; returns the path of eval/metrics.json.

    Raises SceneError where a wire mask or depth picture cannot be used, PlnerfError at a full disk.
    """
    folder = run.folder / "eval"
    with whole_result(folder, ("panels/*.png", "summary.md", "metrics.json")) as new:
        _write_evaluation(run, new, chunk_rays, progress)
    return folder / "metrics.json"


def _write_evaluation(
    run: TrainedRun, folder: Path, chunk_rays: int | None, progress: Progress | None
) -> None:
    scene, appearance, normals = run.scene, mean_appearance(run), run.model.predicts_normals
    stems = panel_names([scene.names[i] for i in scene.test])
    lpips, scores, seconds = Lpips(), [], 0.0
    for done, (i, stem) in enumerate(zip(scene.test, stems, strict=True), start=1):
        clock = time.perf_counter()
        view = render_view(run.model, scene.cameras[[i]], appearance, chunk_rays=chunk_rays, normals=normals)
        seconds += time.perf_counter() - clock
        scores.append(measure(view, scene, i, lpips))
        write_png(folder / "panels" / f"{stem}.png", _panel(view, scene, i, scores[-1]))
        if progress is not None:
            progress(done, len(scene.test))
    rules, mean = protocol(run, seconds, lpips.absent), means(scores)
    images = [asdict(score) for score in scores]
    write_text(folder / "summary.md", summary(images, mean, rules))
    content = {"format_version": FORMAT_VERSION, "mean": mean, "images": images, "protocol": rules}
    write_text(folder / "metrics.json", json.dumps(plain(content), indent=1, allow_nan=False) + "\n")


def measure(view: RenderedView, scene: Scene, i: int, lpips: Lpips) -> ImageScores:
    """One rendered image against its photo and, where the scene has them, its wire mask and depth."""
    photo = scene.images.image(i).astype(np.float32) / 255
    valid = scene.images.valid(i)
    wire = read_wire_mask(scene.wire_masks[i]) if i in scene.wire_masks else None
    size_px = (valid.shape[1], valid.shape[0])
    small = reduced_wire_mask(wire, size_px) if wire is not None else None
    near = reduced_wire_mask(wire, size_px, NEAR_WIRE_PX) if wire is not None else None
    similarity = ssim_map(view.rgb, photo, valid)
    wire_depth, elsewhere_depth = None, None
    if i in scene.depths and scene.frames.unit == "m":
        truth_mm, rendered_m = read_depth_mm(scene.depths[i]), world_depth(view, scene.frames)
        use = at_full_size(valid, truth_mm.shape)
        on_wire = wire if wire is not None else np.zeros_like(use)
        wire_depth = depth_error(rendered_m, truth_mm, use & on_wire)
        elsewhere_depth = depth_error(rendered_m, truth_mm, use & ~on_wire)
    return ImageScores(
        name=scene.names[i],
        psnr_db=psnr(view.rgb, photo, valid),
        ssim=mean_inside(similarity, valid),
        lpips=lpips(view.rgb, photo, valid),
        wire_psnr_db=psnr(view.rgb, photo, valid & small) if small is not None else None,
        elsewhere_psnr_db=psnr(view.rgb, photo, valid & ~small) if small is not None else None,
        near_wire_psnr_db=psnr(view.rgb, photo, valid & near) if near is not None else None,
        near_wire_ssim=mean_inside(similarity, valid & near) if near is not None else None,
        wire_depth=wire_depth,
        elsewhere_depth=elsewhere_depth,
    )


def mean_appearance(run: TrainedRun) -> Float[Tensor, " A"]:
    """The mean of the training images' appearance vectors, for views that have none of their own."""
    with torch.no_grad():
        train = torch.tensor(run.record.train, device=run.model.appearance.device)
        return run.model.mean_appearance(1, train)[0]


def means(scores: Sequence[ImageScores]) -> dict[str, Any]:
    """Means over the images that have a value; of depth errors, of the images' medians and shares."""
    mean: dict[str, Any] = {}
    over_all = ("psnr_db", "ssim", "lpips")
    over_wires = ("wire_psnr_db", "elsewhere_psnr_db", "near_wire_psnr_db", "near_wire_ssim")
    for key in (*over_all, *over_wires):
        mean[key] = _mean([getattr(score, key) for score in scores])
    for key in ("wire_depth", "elsewhere_depth"):
        errors = [error for score in scores if (error := getattr(score, key)) is not None]
        parts = ("median_m", "close_share", "no_surface_share")
        found = {part: _mean([getattr(error, part) for error in errors]) for part in parts}
        mean[key] = found if errors else None
    return mean


def panel_names(names: Sequence[str]) -> list[str]:
    """File names without suffix: the path below images/ with dashes; with its suffix where two are alike."""
    flat = [name.removeprefix("images/").replace("/", "-") for name in names]
    stems = [Path(name).stem for name in flat]
    return stems if len(set(stems)) == len(stems) else flat


def _mean(values: Sequence[float | None]) -> float | None:
    present = [value for value in values if value is not None]
    return math.fsum(present) / len(present) if present else None


def _panel(view: RenderedView, scene: Scene, i: int, score: ImageScores) -> np.ndarray:
    text = "no pixels to compare" if score.psnr_db is None else f"PSNR {score.psnr_db:.2f} dB"
    photo, valid = scene.images.image(i), scene.images.valid(i)
    name = scene.names[i].removeprefix("images/")
    return evaluation_panel(view, photo, valid, scene.frames, title=name, score=text)
