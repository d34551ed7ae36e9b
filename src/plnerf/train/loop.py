"""The training loop.

One step: draw pixels, cast their rays, render them, weigh the losses, step the optimiser.  Every random draw
is a function of the run's seed and the step, so that a resumed run repeats an uninterrupted one bit for bit.
"""

import math
import time
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path

import torch
from torch import Tensor

from plnerf.errors import TrainingError
from plnerf.rays.rays import pixel_rays
from plnerf.render.ray_ops import ray_ops
from plnerf.scene.scene import Scene
from plnerf.train.checkpoint import (
    drop_old_checkpoints,
    kept_checkpoint,
    list_checkpoints,
    load_checkpoint,
    save_checkpoint,
)
from plnerf.train.config import RunConfig, TrainConfig
from plnerf.train.losses import loss_terms
from plnerf.train.metrics import validation_psnr
from plnerf.train.optimizer import build_optimizer
from plnerf.train.pixels import PixelSampler
from plnerf.train.report import Report
from plnerf.train.run import build_model, open_scene, write_config

VALIDATION_PIXELS = 4096


def train(config: RunConfig, folder: Path, report: Report, *, scene: Scene | None = None) -> Path:
    """Trains a model, or goes on from the folder's newest checkpoint; returns the run folder.

    Raises TrainingError at a loss that is not finite (the last good checkpoint stays), CheckpointError at a
    full disk.  A run that has used up its budget is left as it is.
    """
    scene = scene or open_scene(config, folder)
    cfg, checkpoints = config.train, folder / "checkpoints"
    model = build_model(config, scene)
    optimizer = build_optimizer(model, cfg)
    step, seconds = 0, 0.0
    if saved := list_checkpoints(checkpoints):
        start = load_checkpoint(saved[-1], model, optimizer)
        step, seconds = start.step, start.seconds
    progress = progress_of(config, step, seconds)
    if progress >= 1:
        report.nothing_left(config, step, seconds)
        return folder
    write_config(folder, config)
    sampler = PixelSampler(scene.images, scene.train, cfg.detail_share, cfg.detail_part)
    cameras, device = scene.cameras, torch.device(config.device)

    report.begin(config, scene, step)
    with closing(report):
        while progress < 1:
            clock = time.perf_counter()
            draws = step_generator(config.seed, step, torch.device("cpu"))
            generator = draws if device.type == "cpu" else step_generator(config.seed, step, device)
            set_learning_rates(optimizer, cfg, step, progress)
            batch = sampler.draw(cfg.rays, draws)
            rays = pixel_rays(cameras, batch.camera, batch.pixel_px).to(device)
            if cfg.pose_refinement and progress >= cfg.pose_from:
                rays = model.poses(rays)
            out = model(
                rays,
                appearance=model.appearance[rays.camera],
                anneal=anneal(step, cfg.anneal_steps),
                generator=generator,
                normal_rays=cfg.normal_rays if config.model.field.normals else 0,
                normals_shape_density=cfg.loss.normals_shape_density,
            )
            colour, importance = batch.colour.to(device), batch.importance.to(device)
            terms = loss_terms(out, colour, importance, cfg.loss, ray_ops(config.backend))
            total = torch.stack(list(terms.values())).sum()
            if not math.isfinite(total.item()):
                raise TrainingError(_not_finite(step, terms, checkpoints))
            optimizer.zero_grad(set_to_none=False)  # the ops add to the gradients in place
            total.backward()
            optimizer.step()
            step += 1
            # The first step of a process compiles the kernels: it is not charged to a budget in seconds.
            seconds += time.perf_counter() - clock if report.steps else 0.0
            before, progress = progress, progress_of(config, step, seconds)
            report.step(step, seconds, progress, terms)
            if due(before, progress, cfg.validations):
                same = step_generator(config.seed, 0, torch.device("cpu"))  # the same pixels every time
                psnr_db = validation_psnr(model, scene, VALIDATION_PIXELS, generator=same)
                report.validation(step, seconds, psnr_db)
            if due(before, progress, cfg.checkpoints):
                frames = scene.frames.to_json()
                save_checkpoint(checkpoints, model, optimizer, step=step, seconds=seconds, frames=frames)
                drop_old_checkpoints(checkpoints, keep=2)
        report.end(step, seconds)
    return folder


def set_learning_rates(
    optimizer: torch.optim.Optimizer, cfg: TrainConfig, step: int, progress: float
) -> None:
    """Linear warm-up over the first steps, exponential decay to `final_rate` over the whole budget."""
    factor = min(1.0, (step + 1) / cfg.warmup_steps) * cfg.final_rate**progress
    for group in optimizer.param_groups:
        group["lr"] = group["rate"] * factor


def anneal(step: int, steps: int, slope: float = 10.0) -> float:
    """Exponent of the proposals' weights, from 0 to 1 over some steps.  Mip-NeRF 360 eq. 18."""
    share = min(1.0, (step + 1) / steps)
    return slope * share / ((slope - 1) * share + 1)


def progress_of(config: RunConfig, step: int, seconds: float) -> float:
    """Part of the budget that is used up, in [0, 1]."""
    used = step / config.steps if config.steps else seconds / (config.seconds or 1.0)
    return min(1.0, used)


def due(before: float, after: float, times: int) -> bool:
    """Whether progress passed one of `times` evenly spaced marks, the last of them at 1."""
    return int(after * times + 1e-9) > int(before * times + 1e-9)


def step_generator(seed: int, step: int, device: torch.device) -> torch.Generator:
    """The random generator of a step, a function of the run's seed and the step alone."""
    return torch.Generator(device).manual_seed((seed * 1_000_003 + step) & 0x7FFF_FFFF_FFFF_FFFF)


def _not_finite(step: int, terms: Mapping[str, Tensor], checkpoints: Path) -> str:
    values = {name: term.item() for name, term in terms.items()}
    bad = ", ".join(f"{name} = {value}" for name, value in values.items() if not math.isfinite(value))
    return (
        f"The loss is no longer finite at step {step}: {bad or 'only the sum of its terms'}. "
        f"{kept_checkpoint(checkpoints)}. Lower the learning rates (train.table_rate, train.network_rate) or "
        "the weight of that term (train.loss) in the run's config.json, then go on with --resume."
    )
