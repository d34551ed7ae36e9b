"""The run folder: config.json, pixels/, checkpoints/, metrics.jsonl, eval/, renders/.

It is all that later stages need: `open_run` gives back the scene and the trained model.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import torch

from plnerf.errors import CheckpointError, ConfigError
from plnerf.field.guides import Guides
from plnerf.ops.dispatch import resolve_backend
from plnerf.render.files import write_text
from plnerf.render.system import RadianceSystem
from plnerf.render.systems import build_system
from plnerf.scene.build_store import Progress
from plnerf.scene.scene import Scene, load_scene
from plnerf.train.checkpoint import list_checkpoints, load_checkpoint
from plnerf.train.config import RunConfig
from plnerf.train.guidance import guides_for, run_curves
from plnerf.train.settings import from_json, to_json


@dataclass(frozen=True)
class TrainedRun:
    """A run at its newest checkpoint; the model is in evaluation mode on the run's device."""

    folder: Path
    config: RunConfig
    scene: Scene
    model: RadianceSystem
    step: int
    seconds: float


def open_run(folder: Path) -> TrainedRun:
    """Loads the newest checkpoint of a run and its scene.

    Raises CheckpointError or ConfigError where the folder is no run or has no checkpoint yet, SceneError
    where the scene has gone or changed.
    """
    config = read_config(folder)
    checkpoints = list_checkpoints(folder / "checkpoints")
    if not checkpoints:
        raise CheckpointError(
            f"{folder / 'checkpoints'} holds no complete checkpoint yet. Go on with the run until it writes "
            f"one: plnerf train {config.scene} -o {folder} --resume."
        )
    scene = open_scene(config, folder)
    curves, _ = run_curves(config, scene, folder)
    model = build_model(config, scene, guides_for(curves, config))
    checkpoint = load_checkpoint(checkpoints[-1], model)
    return TrainedRun(folder, config, scene, model.eval(), checkpoint.step, checkpoint.seconds)


def open_scene(config: RunConfig, folder: Path, progress: Progress | None = None) -> Scene:
    """The scene of a run; its reduced pixels are kept in the run folder."""
    store = folder / "pixels"
    return load_scene(Path(config.scene), store=store, downscale=config.downscale, progress=progress)


def build_model(config: RunConfig, scene: Scene, guides: Guides | None = None) -> RadianceSystem:
    """The untrained model of a run, its weights drawn from the run's seed.

    Raises ConfigError where the run's device is not there, or its backend cannot run on it.
    """
    if config.device == "cuda" and not torch.cuda.is_available():
        raise ConfigError(
            "This run is on the device 'cuda', but PyTorch sees no CUDA device. Use a machine with one, or "
            'set "device" to "cpu" in the run\'s config.json.'
        )
    resolve_backend(config.backend, torch.device(config.device))  # the run may come from another machine
    generator = torch.Generator().manual_seed(config.seed)
    system = build_system(config.model, len(scene.names), config.backend, generator, guides)
    return system.to(config.device)


def read_config(folder: Path) -> RunConfig:
    """The settings of a run.  Raises ConfigError where there are none, or where a key is unknown."""
    path = folder / "config.json"
    try:
        data = json.loads(path.read_text())
    except FileNotFoundError as error:
        raise ConfigError(
            f"{folder} is not a run folder: it has no config.json. Give the folder that "
            "`plnerf train SCENE -o FOLDER` wrote."
        ) from error
    except (OSError, ValueError) as error:
        raise ConfigError(
            f"{path} cannot be read ({error}). Correct it, or give another run folder."
        ) from error
    return from_json(RunConfig, data, str(path))


def write_config(folder: Path, config: RunConfig) -> None:
    """Writes config.json."""
    write_text(folder / "config.json", json.dumps(to_json(config), indent=1) + "\n")
