"""The training loop.

One step: draw pixels, cast their rays, render them, weigh the losses, step the optimiser.  Every random draw
is a function of the run's seed and the step, so that a resumed run repeats an uninterrupted one bit for bit.
"""

import math
import time
import warnings
from collections.abc import Callable, Mapping
from contextlib import closing
from functools import partial
from itertools import product
from pathlib import Path

import torch
from torch import Generator, Tensor

from plnerf.detect.detect import FindWires
from plnerf.errors import TrainingError
from plnerf.ops.dispatch import kernels
from plnerf.render.footprint import COPIES_IN_TRAINING, parameter_bytes, ray_bytes
from plnerf.scene.memory import require_memory
from plnerf.scene.scene import Scene
from plnerf.train.batches import Ahead, pinned
from plnerf.train.checkpoint import (
    drop_old_checkpoints,
    kept_checkpoint,
    list_checkpoints,
    load_checkpoint,
    save_checkpoint,
)
from plnerf.train.config import RunConfig, TrainConfig
from plnerf.train.graph import GraphedStep
from plnerf.train.guidance import favoured_pixels, guides_for, run_wires, wire_pixels
from plnerf.train.metrics import held_out_pixels, some_of, validation_psnr
from plnerf.train.optimizer import Optimizer, build_optimizer
from plnerf.train.pixels import PixelBatch, PixelSampler
from plnerf.train.ranks import ALONE, Ranks, SharedGradients, processes_here
from plnerf.train.report import LOG_EVERY, Report, SilentReport
from plnerf.train.run import build_model, open_scene, write_run
from plnerf.train.schedule import HeldOut, schedule_of
from plnerf.train.step import NonFiniteMonitor, Training
from plnerf.train.visitor import NOBODY, Visitor

VALIDATION_PIXELS = 4096
CPU = torch.device("cpu")


def train(
    config: RunConfig,
    folder: Path,
    report: Report,
    *,
    scene: Scene | None = None,
    finder: FindWires | None = None,
    ranks: Ranks = ALONE,
    visitor: Visitor = NOBODY,
) -> Path:
    """Trains a model, or goes on from the folder's newest checkpoint; returns the run folder.

    scene: as it was read; None: it is read.  finder: finds the wires in place of `detect_wires`.
    ranks: the processes that train it together; each calls this.  visitor: may end it early, as if its
    budget were used up, but it can be resumed.
    Raises TrainingError at a loss that is not finite (the last good checkpoint stays), CheckpointError at a
    full disk.  A run that has used up its budget is left as it is.
    """
    report, checkpoints = report if ranks.first else SilentReport(), folder / "checkpoints"
    with ranks.first_alone():
        cfg = ranks.share_of(config.train)
        scene = scene or open_scene(config, folder)
        saved = list_checkpoints(checkpoints)
        _check_memory(config, len(scene.names))
        scene, wires, searched = run_wires(config, scene, folder, trained=bool(saved), finder=finder)
    model = build_model(config, scene, guides_for(wires, scene, config))
    optimizer = build_optimizer(model, cfg)
    step, seconds, state = 0, billable_seconds(searched, config), None
    if saved:
        start = load_checkpoint(saved[-1], model, optimizer)
        step, seconds, state = start.step, start.seconds, start.schedule
    ranks.require_same(model, step)
    seconds = ranks.same(seconds)
    schedule = schedule_of(config, step, seconds, state)
    now = schedule.at(step, seconds)
    if now.progress >= 1:
        report.nothing_left(config, step, seconds)
        return folder
    if ranks.first:
        write_run(folder, config, scene)
    sampler = PixelSampler(scene.images, scene.train, favoured_pixels(config, scene, wires), cfg.unbias)
    device = torch.device(config.device)
    shared = None if ranks.of == 1 else SharedGradients(model.parameters(), ranks)
    training = Training(model, optimizer, scene.cameras.to(device), cfg, NonFiniteMonitor(device), shared)
    take_step, first, goes_on = make_step(training, config), step, True
    normals_from = 0.0 if cfg.loss.normals_shape_density else cfg.normals_from
    check_every = 1 if device == CPU else LOG_EVERY  # asking a GPU waits for it

    same = step_generator(config.seed, 0, CPU)  # the same pixels every time
    held_out = held_out_pixels(scene, VALIDATION_PIXELS, same)
    on_wires = some_of(wire_pixels(scene, wires, scene.test), VALIDATION_PIXELS, same) if wires else None

    def look() -> HeldOut:
        sets = [held_out] if on_wires is None else [held_out, on_wires]
        seen = [validation_psnr(model, scene, one) if ranks.first else 0.0 for one in sets]
        return HeldOut(*map(ranks.same, seen))

    def draw(step: int) -> tuple[PixelBatch, Generator]:
        generator = ranks.generator(CPU).manual_seed(step_seed(config.seed, step))
        side = sampler.side_at(step, config.train)
        batch = sampler.draw(config.train.rays, generator, ranks.rays, side)
        return batch if device == CPU else pinned(batch), generator

    report.begin(config, scene, step)
    # On a CPU a thread that draws would only take the kernels' place, unless it waits for the disk.
    ahead = 2 if device != CPU or scene.images.waits_for_disk else 0
    with closing(report), closing(visitor), Ahead(draw, step, ahead) as batches:
        visitor.begin(config, folder, scene, model)
        while now.progress < 1 and goes_on:
            clock = time.perf_counter()
            set_learning_rates(optimizer, cfg, step, now.progress)
            batch, generator = next(batches)
            model.update(step, generator)
            if device != CPU:
                generator = ranks.generator(device).manual_seed(step_seed(config.seed, step))
            refine_poses = cfg.pose_refinement and now.progress >= cfg.pose_from
            # The first step of a run compiles the kernels of all that will be trained.
            normals = step == 0 or now.progress >= normals_from
            terms = take_step(batch, anneal(step, cfg.anneal_steps), generator, refine_poses, normals)
            if step % check_every == 0:
                _check_finite(training.monitor, first, step, terms, checkpoints)
            step += 1
            # The first step of a process compiles the kernels: it does not count against a budget in seconds.
            seconds += time.perf_counter() - clock if report.steps else 0.0
            seconds = ranks.same(seconds) if config.seconds else seconds
            now = schedule.at(step, seconds)
            report.step(step, seconds, now.share, terms)
            goes_on = visitor.between_steps(step)
            if now.look:
                seen = look()
                schedule.heard(step, seen)
                report.validation(step, seconds, seen)
            if now.save or not goes_on:
                _check_finite(training.monitor, first, step - 1, terms, checkpoints)
                ranks.require_same(model, step)
                if ranks.first:
                    save_checkpoint(
                        checkpoints, model, optimizer, step=step, seconds=seconds,
                        frames=scene.frames.to_json(), schedule=schedule.state(),
                    )  # fmt: skip
                    drop_old_checkpoints(checkpoints, keep=2)
        report.end(step, seconds)
    return folder


def _check_memory(config: RunConfig, images: int) -> None:
    """Raises ConfigError where the model with its optimiser, or a step's rays, do not fit into memory."""
    # Before it is known whether there are wires: to find them takes long.
    model = COPIES_IN_TRAINING * parameter_bytes(config.model, images, guided=config.train.find_wires)
    model *= processes_here()
    require_memory(
        model,
        "Training this model",
        "Make its grids or networks smaller: log2_table, levels, features, hidden, width.",
    )
    require_memory(
        model + ray_bytes(config.model, config.train.rays),
        f"A step of {config.train.rays:,} rays",
        "Give a smaller --train.rays, or fewer intervals of a ray: sampler.final, sampler.proposals.",
    )


def billable_seconds(searched: float, config: RunConfig) -> float:
    """The seconds of finding conductors that count as training: at most nine tenths of the budget."""
    if config.seconds is None or searched <= (most := 0.9 * config.seconds):
        return searched
    warnings.warn(
        f"Finding conductors took {searched:.1f} s of a budget of {config.seconds:g} s, of which "
        f"{config.seconds - most:.1f} s are left to train. Give a larger budget.",
        stacklevel=2,
    )
    return most


def make_step(
    training: Training, config: RunConfig
) -> Callable[[PixelBatch, float, Generator, bool, bool], dict[str, Tensor]]:
    """A function that takes a step: a replayed CUDA graph where it can hold all ops, else `Training.step`."""
    # A graph of a step that sums over several GPUs has not been tried.
    graphs_run = config.device == "cuda" and kernels(config.backend).supports_graphs
    graphs_run = graphs_run and training.gradients is None
    if not graphs_run or not training.model.fixed_shapes:
        return training.step
    on_device = Generator(config.device)
    graphs = {
        what: GraphedStep(partial(training.step, refine_poses=what[0], normals=what[1]), on_device)
        for what in product((False, True), repeat=2)
    }

    def graphed(
        batch: PixelBatch, anneal: float, generator: Generator, refine_poses: bool, normals: bool
    ) -> dict[str, Tensor]:
        return graphs[refine_poses, normals](batch, anneal, generator.initial_seed())

    return graphed


def set_learning_rates(optimizer: Optimizer, cfg: TrainConfig, step: int, progress: float) -> None:
    """Linear warm-up over the first steps, exponential decay to `lr_final_factor` from `lr_fall_from` on."""
    fallen = max(0.0, progress - cfg.lr_fall_from) / (1 - cfg.lr_fall_from)
    factor = min(1.0, (step + 1) / cfg.warmup_steps) * cfg.lr_final_factor**fallen
    for group in optimizer.param_groups:
        if isinstance(group["lr"], Tensor):
            group["lr"].fill_(group["rate"] * factor)
        else:
            group["lr"] = group["rate"] * factor


def anneal(step: int, steps: int, slope: float = 10.0) -> float:
    """Exponent of the proposals' weights, from 0 to 1 over some steps.  Mip-NeRF 360 eq. 18."""
    share = min(1.0, (step + 1) / steps)
    return slope * share / ((slope - 1) * share + 1)


def step_generator(seed: int, step: int, device: torch.device) -> Generator:
    """The random generator of a step, a function of the run's seed and the step alone."""
    return Generator(device).manual_seed(step_seed(seed, step))


def step_seed(seed: int, step: int) -> int:
    """The seed of a step's random generators."""
    return (seed * 1_000_003 + step) & 0x7FFF_FFFF_FFFF_FFFF


def _check_finite(
    monitor: NonFiniteMonitor, first: int, step: int, terms: Mapping[str, Tensor], checkpoints: Path
) -> None:
    """Raises TrainingError if a loss from step `first` to `step` was not finite; `terms` are of the last."""
    if (bad := first + monitor.count()) <= step:
        raise TrainingError(_not_finite(bad, terms, checkpoints))


def _not_finite(step: int, terms: Mapping[str, Tensor], checkpoints: Path) -> str:
    values = {name: term.item() for name, term in terms.items()}
    bad = ", ".join(f"{name} = {value}" for name, value in values.items() if not math.isfinite(value))
    return (
        f"The loss is no longer finite at step {step}: {bad or 'only the sum of its terms'}. "
        f"{kept_checkpoint(checkpoints)}. Lower the learning rates (train.hash_lr, train.mlp_lr) or "
        "the weight of that term (train.loss) in the run's config.json, then go on with --resume."
    )
