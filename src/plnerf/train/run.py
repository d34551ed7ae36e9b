"""The run folder: config.json, scene.json, wires.json, pixels/, checkpoints/, metrics.jsonl, eval/, renders/.

`open_run` returns the trained model and what rendering needs of the scene; the photos are read when something
asks for `TrainedRun.scene`.
"""

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import torch

from plnerf.errors import CheckpointError, ConfigError, SceneError
from plnerf.field.guides import Guides
from plnerf.line.wire import Wire
from plnerf.render.footprint import parameter_bytes
from plnerf.render.picture_files import write_text
from plnerf.render.self_test import resolve_backend
from plnerf.render.system import RadianceSystem
from plnerf.render.systems import build_system
from plnerf.scene.build_store import Progress
from plnerf.scene.memory import require_memory
from plnerf.scene.scene import Scene, load_scene
from plnerf.scene.strict_json import read_json
from plnerf.train.checkpoint import list_checkpoints, load_checkpoint
from plnerf.train.config import RunConfig
from plnerf.train.field import Field
from plnerf.train.guidance import WIRES, certain, guides_for, trained_wires
from plnerf.train.scene_record import FILE as RECORD
from plnerf.train.scene_record import SceneRecord, read_record, write_record
from plnerf.train.settings import from_json, to_json

FORMAT_VERSION = 2
"""Of config.json; files of version 1 name none."""


@dataclass(frozen=True, eq=False)
class TrainedRun:
    """A run at its newest checkpoint; the model is in evaluation mode on the run's device."""

    folder: Path
    config: RunConfig
    record: SceneRecord
    """The scene without its photos."""
    model: RadianceSystem
    step: int
    seconds: float
    wires: tuple[Wire, ...] | None = None
    """All wires that were detected before training, in the LineFrame of `record`; None: the run looked for
    none."""

    @cached_property
    def scene(self) -> Scene:
        """The scene with its photos, in the frames of the run.

        Raises SceneError where it has gone or changed.
        """
        scene = open_scene(self.config, self.folder)
        # A scene of fewer or more images than the record has no place for its poses.
        scene = self.record.restored(scene) if len(scene.names) == len(self.record.names) else scene
        if not self.record.is_of(scene):
            raise SceneError(
                f"The scene {self.config.scene} has changed since the run in {self.folder} was trained: its "
                "images, their poses or the held-out ones are others. Restore it, or train again."
            )
        return scene

    @cached_property
    def field(self) -> Field:
        """The radiance field, in world coordinates."""
        return Field(self.model, self.record)


def open_run(folder: Path | str) -> TrainedRun:
    """Loads the newest checkpoint of a run; the photos are not needed.

    Raises CheckpointError or ConfigError where the folder is no run or has no checkpoint yet.
    """
    folder = Path(folder)
    config = read_config(folder)
    checkpoints = list_checkpoints(folder / "checkpoints")
    if not checkpoints:
        raise CheckpointError(
            f"{folder / 'checkpoints'} holds no complete checkpoint yet. Go on with the run until it writes "
            f"one: plnerf train {config.scene} -o {folder} --resume."
        )
    record = read_record(folder)
    wires = trained_wires(config, folder, record.frames)
    model = build_model(config, record, guides_for(certain(wires or ()), record, config))
    checkpoint = load_checkpoint(checkpoints[-1], model)
    return TrainedRun(folder, config, record, model.eval(), checkpoint.step, checkpoint.seconds, wires)


def open_scene(config: RunConfig, folder: Path, progress: Progress | None = None) -> Scene:
    """The scene of a run as it is read, in the cameras' frame; its reduced pixels are kept in the run
    folder."""
    store = folder / "pixels"
    return load_scene(Path(config.scene), store=store, downscale=config.downscale, progress=progress)


def build_model(
    config: RunConfig, scene: Scene | SceneRecord, guides: Guides | None = None
) -> RadianceSystem:
    """The untrained model of a run, its weights drawn from the run's seed.

    Raises ConfigError where the run's device is not there, its backend cannot run on it, or the model does
    not fit into memory.
    """
    if config.device == "cuda" and not torch.cuda.is_available():
        raise ConfigError(
            "This run is on the device 'cuda', but PyTorch sees no CUDA device. Use a machine with one, or "
            'set "device" to "cpu" in the run\'s config.json.'
        )
    resolve_backend(config.backend, torch.device(config.device))  # the run may come from another machine
    require_memory(
        parameter_bytes(config.model, len(scene.names), guided=guides is not None),
        "This model",
        "Make its grids or networks smaller: log2_table, levels, features, hidden, width.",
    )
    generator = torch.Generator().manual_seed(config.seed)
    system = build_system(config.model, len(scene.names), config.backend, generator, guides)
    return system.to(config.device)


def read_config(folder: Path) -> RunConfig:
    """The settings of a run.

    Raises ConfigError where there are none, where a key is unknown, or where an earlier version wrote them.
    """
    path = folder / "config.json"
    if not path.exists():
        raise ConfigError(
            f"{folder} is not a run folder: it has no config.json. Give the folder that "
            "`plnerf train SCENE -o FOLDER` wrote."
        )
    data = read_json(path, ConfigError, "Correct it, or give another run folder.")
    version = data.pop("format_version", 1) if isinstance(data, dict) else FORMAT_VERSION
    if version != FORMAT_VERSION:
        raise ConfigError(
            f"{path} has format version {version}, but this version of plnerf reads version "
            f"{FORMAT_VERSION}. Train again into another folder, or use the version of plnerf that wrote it."
        )
    return from_json(RunConfig, data, str(path))


def require_new_run(folder: Path) -> None:
    """Raises ConfigError where the folder holds a run, or a part of one."""
    if (folder / "config.json").exists():
        raise ConfigError(
            f"{folder} already holds a run. Give --resume to go on with it, or another folder to train anew."
        )
    if kept := list_checkpoints(folder / "checkpoints"):
        raise ConfigError(
            f"{folder} holds the checkpoint {kept[-1].name} of a run, but not its settings, config.json. "
            "Put that file back, or remove the folder to train anew."
        )


def remove_start(folder: Path) -> None:
    """Removes the frames and wires of a run that ended before its settings were written.

    They may be of another scene, or detected by other settings.
    """
    if (folder / RECORD).exists():  # wires alone were put there by the user
        (folder / WIRES).unlink(missing_ok=True)
        (folder / RECORD).unlink()


def write_run(folder: Path, config: RunConfig, scene: Scene) -> None:
    """Writes scene.json and config.json."""
    write_record(folder, SceneRecord.of(scene))
    content = {"format_version": FORMAT_VERSION, **to_json(config)}
    write_text(folder / "config.json", json.dumps(content, indent=1) + "\n")
