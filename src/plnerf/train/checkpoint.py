"""Checkpoints without pickle: tensors in a safetensors file, everything else in a JSON file beside it.

The JSON is renamed into place last and marks the checkpoint as complete, so that a crash or a full disk at
any moment leaves the previous checkpoint whole.  Randomness needs no state: every draw is a function of the
seed and the step.
"""

import json
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor, nn

from plnerf.errors import CheckpointError, TrainingError
from plnerf.scene.strict_json import read_json
from plnerf.train.optimizer import TableAdam

FORMAT_VERSION = 1
_NAME = re.compile(r"step-(\d+)\.json")
_OF_PARAMETER = re.compile(r"optimizer\.(\d{1,9})\..*")
_REMOVE = "Remove this checkpoint to go on from the one before."
_OWN_CONFIG = "Open it with the config.json and the scene that it was trained with."


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
    schedule: dict[str, Any] | None = None
    """State of the run's schedule; None where the step and the seconds are all of it."""


def save_checkpoint(
    folder: Path,
    model: nn.Module,
    optimizer: TableAdam,
    *,
    step: int,
    seconds: float,
    frames: dict[str, Any],
    schedule: dict[str, Any] | None = None,
) -> Checkpoint:
    """Writes folder/step-N.{safetensors,json}.

    Raises CheckpointError where the disk is full or not writable, TrainingError where a weight is not finite.
    """
    path, beside = folder / f"step-{step}.json", folder / f"step-{step}.safetensors"
    about = {"format_version": FORMAT_VERSION, "step": step, "seconds": seconds, "frames": frames}
    about |= {} if schedule is None else {"schedule": schedule}
    tensors = {f"model.{name}": value for name, value in model.state_dict().items()}
    _check_finite(tensors, folder, step)
    tensors |= _optimizer_tensors(optimizer.state_dict())
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _replace(beside, lambda part: part.write_bytes(save(tensors)))
        _replace(path, lambda part: part.write_text(json.dumps(about, indent=1)))
    except OSError as error:
        if beside.exists() and not path.exists():  # tensors that nothing refers to
            beside.unlink()
        raise CheckpointError(
            f"The checkpoint {path.with_suffix('')} could not be written ({error}). Earlier checkpoints in "
            f"{folder} are untouched. Make room on the disk, or make the folder writable, then go on with "
            "--resume."
        ) from error
    return Checkpoint(path, step, seconds, frames, schedule)


def _check_finite(tensors: dict[str, Tensor], folder: Path, step: int) -> None:
    """A finite loss can have a gradient that ruins a weight: that must not replace a good checkpoint."""
    for name, value in tensors.items():
        if not value.isfinite().all():
            raise TrainingError(
                f"After step {step} the tensor {name!r} is no longer finite, so no checkpoint was written. "
                f"{kept_checkpoint(folder)}. Lower train.hash_lr or train.mlp_lr in the run's "
                "config.json, then go on with --resume."
            )


def _replace(path: Path, write: Any) -> None:
    """Writes a file beside its place, forces it to the disk, and renames it into place."""
    part = path.with_name(path.name + ".part")
    try:
        write(part)
        with part.open("rb+") as file:
            os.fsync(file.fileno())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def list_checkpoints(folder: Path) -> list[Path]:
    """The complete checkpoints of a folder, oldest first, as their JSON files."""
    matches = [(_NAME.fullmatch(path.name), path) for path in folder.glob("step-*.json")]
    return [path for _, path in sorted((int(match[1]), path) for match, path in matches if match)]


def kept_checkpoint(folder: Path) -> str:
    """A sentence without its full stop on what a failed run can go on from."""
    saved = list_checkpoints(folder)
    return f"The last good checkpoint is {saved[-1]}" if saved else "No checkpoint had been written yet"


def drop_old_checkpoints(folder: Path, keep: int) -> None:
    """Removes all but the newest `keep` checkpoints, and what crashes left of others.

    The JSON goes first, so that no checkpoint is left half there.
    """
    newest = {path.stem for path in list_checkpoints(folder)[-keep:]}
    for path in sorted(folder.glob("step-*")):
        if path.name.split(".")[0] not in newest or path.suffix == ".part":
            path.unlink()


def load_checkpoint(path: Path, model: nn.Module, optimizer: TableAdam | None = None) -> Checkpoint:
    """Loads weights, and the optimiser's state where one is given.

    Every tensor is compared with what is to take it over before any is taken: kernels step the optimiser's
    state without bounds.  Raises CheckpointError, and leaves model and optimiser as they were, where the file
    is of another format version, damaged (also by values that are not finite), or of another architecture.
    """
    about = _read_about(path)
    try:
        # Not `load_file`: of every tensor of a file that it opens itself, safetensors 0.8 keeps two objects.
        tensors = load(path.with_suffix(".safetensors").read_bytes())
    except (OSError, SafetensorError, KeyError) as error:  # KeyError: of a type that torch does not have
        raise CheckpointError(
            f"The tensors of the checkpoint {path} cannot be read ({error}). {_REMOVE}"
        ) from error
    state = {
        name.removeprefix("model."): value for name, value in tensors.items() if name.startswith("model.")
    }
    _check_same_architecture(path, state, model.state_dict(), "the model")
    _check_loaded_finite(path, state)
    if optimizer is not None:
        optimizer.load_state_dict(_optimizer_state(optimizer, tensors, path))
    model.load_state_dict(state)
    return Checkpoint(
        path, about["step"], float(about["seconds"]), about["frames"], about.get("schedule")
    )


def _read_about(path: Path) -> dict[str, Any]:
    about = read_json(path, CheckpointError, _REMOVE)
    version = about.get("format_version") if isinstance(about, dict) else None
    if version != FORMAT_VERSION:
        raise CheckpointError(
            f"The checkpoint {path} has format version {version}, but this version of plnerf reads version "
            f"{FORMAT_VERSION}. Use the version of plnerf that wrote it, or train again."
        )
    whole = isinstance(about.get("step"), int) and isinstance(about.get("frames"), dict)
    whole = whole and isinstance(about.get("schedule"), dict | None)
    if not whole or not isinstance(about.get("seconds"), int | float):
        raise CheckpointError(
            f"The checkpoint {path} is damaged: its step is {about.get('step')!r}, its seconds are "
            f"{about.get('seconds')!r}, its frames {about.get('frames')!r}, its schedule "
            f"{about.get('schedule')!r}. {_REMOVE}"
        )
    return about


def _check_same_architecture(
    path: Path, state: dict[str, Tensor], expected: dict[str, Tensor], whose: str
) -> None:
    """By names, shapes and dtypes of the tensors."""
    another = f"The checkpoint {path} is of another architecture"
    for name in sorted(state.keys() ^ expected.keys()):
        has, lacks = ("the checkpoint", whose) if name in state else (whose, "the checkpoint")
        raise CheckpointError(f"{another}: {has} has the tensor {name!r}, {lacks} has not. {_OWN_CONFIG}")
    for name, value in expected.items():
        its, wanted = _layout(state[name]), _layout(value)
        for what in its:
            if its[what] != wanted[what]:
                has = f"{name!r} has {what} {its[what]}, {whose} expects {wanted[what]}"
                raise CheckpointError(f"{another}: {has}. {_OWN_CONFIG}")


def _check_loaded_finite(path: Path, tensors: dict[str, Tensor]) -> None:
    """Weights that are NaN would render to black pictures, without any error."""
    for name, value in tensors.items():
        bad = int((~value.isfinite()).sum())
        if bad:
            raise CheckpointError(
                f"The checkpoint {path} is damaged: {bad:,} of the {value.numel():,} values of {name!r} are "
                f"not finite. {_REMOVE}"
            )


def _layout(tensor: Tensor) -> dict[str, str]:
    return {"shape": str(tuple(tensor.shape)), "dtype": str(tensor.dtype)}


def _optimizer_tensors(state: dict[int, dict[str, Tensor]]) -> dict[str, Tensor]:
    return {
        f"optimizer.{index}.{key}": value for index, parts in state.items() for key, value in parts.items()
    }


def _optimizer_state(
    optimizer: TableAdam, tensors: dict[str, Tensor], path: Path
) -> dict[int, dict[str, Tensor]]:
    """The optimiser's state in a checkpoint, by parameter.

    Poses, the last parameters, may be refined from here on, or no longer: their state is not always there.
    """
    found = {name: value for name, value in tensors.items() if name.startswith("optimizer.")}
    if not found:
        raise CheckpointError(
            f"The checkpoint {path} holds no optimiser state: it can be rendered, not resumed."
        )
    layout = optimizer.layout()
    of = {name: match for name in found if (match := _OF_PARAMETER.fullmatch(name))}
    used = {name: found[name] for name in found if name not in of or int(of[name][1]) < len(layout)}
    stepped = {int(match[1]) for match in of.values()}
    expected = {k: parts for k, parts in layout.items() if k in stepped or k not in optimizer.late()}
    _check_same_architecture(path, used, _optimizer_tensors(expected), "the optimiser")
    _check_loaded_finite(path, used)
    return {k: {key: found[f"optimizer.{k}.{key}"] for key in parts} for k, parts in expected.items()}
