"""Checkpoints without pickle: tensors in a safetensors file, everything else in a JSON file beside it.

The JSON is renamed into place last and marks the checkpoint as complete, so that a crash or a full disk at any moment
leaves the previous checkpoint whole.  Randomness needs no state: every draw is a function of the seed and the step.
"""

import json
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from plnerf.errors import CheckpointError

FORMAT_VERSION = 1
_NAME = re.compile(r"step-(\d+)\.json")


@dataclass(frozen=True)
class Checkpoint:
    """What is known of a checkpoint without its tensors."""

    path: Path
    """The JSON file; the tensors lie beside it with the suffix .safetensors."""
    step: int
    """Steps done."""
    seconds: float
    """Seconds of training done."""
    frames: dict[str, Any]
    """The scene's frames, so that the weights stay georeferenced without the scene folder."""


def save_checkpoint(
    folder: Path, model: nn.Module, optimizer: torch.optim.Optimizer, *, step: int, seconds: float, frames: dict[str, Any]
) -> Checkpoint:
    """Writes folder/step-N.{safetensors,json}.  Raises CheckpointError where the disk is full or not writable."""
    path = folder / f"step-{step}.json"
    about = {"format_version": FORMAT_VERSION, "step": step, "seconds": seconds, "frames": frames}
    tensors = {f"model.{name}": value for name, value in model.state_dict().items()}
    tensors |= _optimizer_tensors(optimizer)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _replace(path.with_suffix(".safetensors"), lambda beside: save_file(tensors, beside))
        _replace(path, lambda beside: beside.write_text(json.dumps(about, indent=1)))
    except (OSError, SafetensorError) as error:
        raise CheckpointError(
            f"The checkpoint {path.with_suffix('')} could not be written ({error}). Earlier checkpoints in {folder} "
            "are untouched. Free some disk space or choose another folder, then continue with --resume."
        ) from error
    return Checkpoint(path, step, seconds, frames)


def _replace(path: Path, write: Any) -> None:
    """Writes a file beside its place, forces it to the disk, and renames it into place."""
    beside = path.with_name(path.name + ".part")
    try:
        write(beside)
        with beside.open("rb+") as file:
            os.fsync(file.fileno())
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def list_checkpoints(folder: Path) -> list[Path]:
    """The complete checkpoints of a folder, oldest first, as their JSON files."""
    found = [(int(match[1]), path) for path in folder.glob("step-*.json") if (match := _NAME.fullmatch(path.name))]
    return [path for _, path in sorted(found)]


def drop_old_checkpoints(folder: Path, keep: int) -> None:
    """Removes all but the newest `keep` checkpoints; the JSON first, so that none is left half there."""
    for path in list_checkpoints(folder)[:-keep]:
        path.unlink()
        path.with_suffix(".safetensors").unlink(missing_ok=True)


def load_checkpoint(path: Path, model: nn.Module, optimizer: torch.optim.Optimizer | None = None) -> Checkpoint:
    """Loads weights, and the optimiser's state where one is given.

    Raises CheckpointError where the file is of another format version, damaged, or of another architecture.
    """
    about = _read_about(path)
    try:
        tensors = load_file(path.with_suffix(".safetensors"))
    except (OSError, SafetensorError) as error:
        raise CheckpointError(
            f"The tensors of the checkpoint {path} cannot be read ({error}). Remove this checkpoint to go on from "
            "the one before."
        ) from error
    state = {name.removeprefix("model."): value for name, value in tensors.items() if name.startswith("model.")}
    _check_same_architecture(path, state, model.state_dict())
    model.load_state_dict(state)
    if optimizer is not None:
        _load_optimizer_tensors(optimizer, tensors, path)
    return Checkpoint(path, about["step"], about["seconds"], about["frames"])


def _read_about(path: Path) -> dict[str, Any]:
    try:
        about: dict[str, Any] = json.loads(path.read_text())
    except (OSError, json.JSONDecodeError) as error:
        raise CheckpointError(f"The checkpoint {path} cannot be read ({error}).") from error
    version = about.get("format_version")
    if version != FORMAT_VERSION:
        raise CheckpointError(
            f"The checkpoint {path} has format version {version}, but this version of plnerf reads version "
            f"{FORMAT_VERSION}. Use the version of plnerf that wrote it, or train again."
        )
    return about


def _check_same_architecture(path: Path, state: dict[str, Tensor], expected: dict[str, Tensor]) -> None:
    for name in sorted(state.keys() ^ expected.keys()):
        has, lacks = ("the checkpoint", "the model") if name in state else ("the model", "the checkpoint")
        raise CheckpointError(
            f"The checkpoint {path} is of another architecture: {has} has the tensor {name!r}, {lacks} has not. "
            "Open it with the config.json that it was trained with."
        )
    for name, value in expected.items():
        if state[name].shape != value.shape:
            raise CheckpointError(
                f"The checkpoint {path} is of another architecture: {name!r} has shape {tuple(state[name].shape)}, "
                f"the model expects {tuple(value.shape)}. Open it with the config.json that it was trained with."
            )


def _optimizer_tensors(optimizer: torch.optim.Optimizer) -> dict[str, Tensor]:
    state = optimizer.state_dict()["state"]
    return {f"optimizer.{index}.{key}": value for index, items in state.items() for key, value in items.items()}


def _load_optimizer_tensors(optimizer: torch.optim.Optimizer, tensors: dict[str, Tensor], path: Path) -> None:
    state: dict[int, dict[str, Tensor]] = {}
    for name, value in tensors.items():
        if name.startswith("optimizer."):
            _, index, key = name.split(".")
            state.setdefault(int(index), {})[key] = value
    if not state:
        raise CheckpointError(f"The checkpoint {path} holds no optimiser state: it can be rendered, not resumed.")
    optimizer.load_state_dict({"state": state, "param_groups": optimizer.state_dict()["param_groups"]})
