"""Runs on the tiny scene that take a second or a few, for the tests of training and of the command line."""

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import load_file
from tests.support.changed import changed
from torch import Tensor

from plnerf.presets._find import find_preset
from plnerf.presets.pl_nerf import PRESET as PL_NERF
from plnerf.scene.scene import Scene, load_scene
from plnerf.train.checkpoint import list_checkpoints
from plnerf.train.config import RunConfig, Settings
from plnerf.train.report import SilentReport

SMALL = (
    "model.field.grid.levels=4",
    "model.field.grid.finest=160",
    "model.field.grid.log2_table=13",
    "model.field.hidden=32",
    "model.proposals.0.grid.log2_table=11",
    "model.proposals.1.grid.log2_table=11",
    "model.sampler.proposals=[24,16]",
    "model.sampler.final=12",
    "train.rays=128",
    "train.normal_rays=16",
    "train.anneal_steps=50",
    "train.warmup_steps=10",
    "train.validations=2",
)
"""A model and steps that are small enough for tests; every part of the method stays on."""


def tiny_config(scene: Path, *settings: str, **budget_and_seed: Any) -> RunConfig:
    """A small run on a scene; ten steps unless told otherwise."""
    budget = budget_and_seed or {"steps": 10}
    if not budget.keys() & {"steps", "seconds"}:
        budget["steps"] = 10
    start = RunConfig(str(scene), 1, "pl-nerf", "numba", "cpu", PL_NERF.model, PL_NERF.train, **budget)
    return changed(start, (*SMALL, *settings))


def small(*settings: str, preset: str = "pl-nerf") -> dict[str, Any]:
    """Arguments of `train_scene`: a preset made small, and further changes."""
    chosen = find_preset(preset)
    made = changed(Settings(chosen.model, chosen.train), (*SMALL, *settings))
    return {"preset": preset, "model": made.model, "train": made.train}


def open_tiny(scene: Path, folder: Path) -> Scene:
    return load_scene(scene, store=folder / "pixels")


class Recorder(SilentReport):
    """Keeps the loss terms of every step."""

    def __init__(self) -> None:
        super().__init__()
        self.terms: list[dict[str, float]] = []
        self.seconds: list[float] = []
        self.done: list[int] = []
        self.ended, self.closed, self.told_nothing_left = False, False, False

    def nothing_left(self, config: RunConfig, step: int, seconds: float) -> None:
        self.told_nothing_left = True

    def step(self, step: int, seconds: float, progress: float, terms: Mapping[str, Tensor]) -> None:
        super().step(step, seconds, progress, terms)
        self.done.append(step)
        self.seconds.append(seconds)
        self.terms.append({name: term.item() for name, term in terms.items()})

    def end(self, step: int, seconds: float) -> None:
        self.ended = True

    def close(self) -> None:
        self.closed = True


def newest_tensors(run: Path) -> dict[str, Tensor]:
    """Weights and optimiser state of a run's newest checkpoint."""
    return load_file(list_checkpoints(run / "checkpoints")[-1].with_suffix(".safetensors"))


def assert_same_bits(a: Mapping[str, Tensor], b: Mapping[str, Tensor]) -> None:
    assert a.keys() == b.keys()
    assert [name for name in a if not torch.equal(a[name], b[name])] == []


def log_of(run: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]


def run_plnerf(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """The real command in a process that a shell would start, at a fixed width and without colours."""
    return subprocess.run(
        [sys.executable, "-m", "plnerf.cli.main", *map(str, arguments)], text=True, capture_output=True,
        env={**os.environ, "COLUMNS": "100", "NO_COLOR": "1"}, timeout=120, check=False,
    )  # fmt: skip
