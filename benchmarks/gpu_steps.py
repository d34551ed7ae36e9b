"""Steps a second of training on a GPU, at the preset's size and at nerfacto's, by rays a step.

    python benchmarks/gpu_steps.py OUT [--scene SCENE] [--lens] [--steps 200] [--device cuda]

Rates are of the last three quarters of the steps, the first of which compile and record; nothing is validated
and no wires are searched.  Nerfacto's size: 16 levels of two features in 2^19 rows, 256 and 96 proposal
samples, 48 final ones.
"""

import argparse
import json
import shutil
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from plnerf.pipeline import bundled_span, train_scene
from plnerf.presets._find import find_preset
from plnerf.render.config import ModelConfig
from plnerf.train.report import SilentReport

PRESET = find_preset("pl-nerf")
SIZES = [("preset", 512), ("preset", 4096), ("preset", 16384), ("nerfacto", 4096)]

LENS = {"k1": 0.0578, "k2": -0.0805, "p1": -0.00098, "p2": 0.00016}
"""Of the telephone that took the fox; the bundled span's cameras have none."""


class Clock(SilentReport):
    """When each step was handed over."""

    def __init__(self) -> None:
        super().__init__()
        self.times: list[float] = []

    def step(self, step: int, seconds: float, progress: float, terms: Mapping[str, Tensor]) -> None:
        super().step(step, seconds, progress, terms)
        self.times.append(time.perf_counter())


def model_of(size: str) -> ModelConfig:
    model = PRESET.model
    if size == "preset":
        return model
    grid = replace(model.field.grid, levels=16, features=2, log2_table=19)
    sampler = replace(model.sampler, proposals=(256, 96), final=48)
    return replace(model, field=replace(model.field, grid=grid), sampler=sampler)


def through_a_lens(scene: Path, out: Path) -> Path:
    """A copy of a scene whose cameras have `LENS`.  Its photos have none: only the time of steps is right."""
    shutil.copytree(scene, out)
    content = json.loads((out / "transforms.json").read_text())
    (out / "transforms.json").write_text(json.dumps(content | LENS))
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("out", type=Path, help="a new folder")
    parser.add_argument("--scene", type=Path, default=bundled_span())
    parser.add_argument("--lens", action="store_true", help="time steps of cameras whose lens distorts")
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--device", default="cuda", choices=["cuda", "cpu"])
    given = parser.parse_args()
    scene = through_a_lens(given.scene, given.out / "scene") if given.lens else given.scene
    for size, rays in SIZES:
        clock, began = Clock(), time.perf_counter()
        train = replace(PRESET.train, rays=rays, validations=0, checkpoints=1, find_wires=False)
        train_scene(
            scene, given.out / f"{size}-{rays}", model=model_of(size), train=train,
            steps=given.steps, device=given.device, report=clock,
        )  # fmt: skip
        measured = clock.times[len(clock.times) // 4 :]
        rate = (len(measured) - 1) / (measured[-1] - measured[0])
        memory = torch.cuda.max_memory_allocated() / 2**30 if given.device == "cuda" else float("nan")
        print(
            f"{size} size, {rays:,} rays: {rate:.1f} steps/s, {rate * rays:,.0f} rays/s, "
            f"first step after {clock.times[0] - began:.1f} s, {memory:.2f} GiB of the GPU",
            flush=True,
        )


if __name__ == "__main__":
    main()
