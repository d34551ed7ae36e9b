"""What a run keeps of its scene, so that its model renders without the photos: scene.json in the run folder.

Numbers are written so that they come back to the last bit.
"""

import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from plnerf.errors import ConfigError
from plnerf.scene.cameras import Cameras
from plnerf.scene.files import write_text
from plnerf.scene.scene import Scene
from plnerf.scene.transforms import Frames

FILE = "scene.json"
FORMAT_VERSION = 1


@dataclass(frozen=True, eq=False)
class SceneRecord:
    """A scene without its pixels; fields as in `Scene`."""

    names: tuple[str, ...]
    cameras: Cameras
    frames: Frames
    box: Float[np.ndarray, "2 3"]
    train: tuple[int, ...]
    test: tuple[int, ...]

    @classmethod
    def of(cls, scene: Scene) -> "SceneRecord":
        """What is kept of a scene."""
        return cls(scene.names, scene.cameras, scene.frames, scene.box, scene.train, scene.test)


def write_record(folder: Path, record: SceneRecord) -> None:
    """Writes scene.json into a run folder."""
    content = {
        "format_version": FORMAT_VERSION,
        "names": list(record.names),
        "train": list(record.train),
        "test": list(record.test),
        "frames": record.frames.to_json(),
        "box_scene": record.box.tolist(),
        "cameras": {one.name: getattr(record.cameras, one.name).tolist() for one in fields(Cameras)},
    }
    write_text(folder / FILE, json.dumps(content, indent=1, allow_nan=False) + "\n")


def read_record(folder: Path) -> SceneRecord:
    """Reads scene.json.  Raises ConfigError where it is absent, damaged or of another version."""
    path = folder / FILE
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["format_version"] != FORMAT_VERSION:
            raise ConfigError(
                f"{path} has format version {content['format_version']}, but this version of plnerf reads "
                f"version {FORMAT_VERSION}. Use the version of plnerf that wrote it, or train again."
            )
        return SceneRecord(
            names=tuple(content["names"]),
            cameras=_cameras(content["cameras"]),
            frames=Frames.from_json(content["frames"]),
            box=np.array(content["box_scene"], dtype=np.float64).reshape(2, 3),
            train=tuple(content["train"]),
            test=tuple(content["test"]),
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(
            f"{path} cannot be read ({error!r}): the run's cameras and frames are not known. Copy the whole "
            "run folder, or train again."
        ) from error


def _cameras(columns: dict[str, Any]) -> Cameras:
    kinds = {"size_px": torch.int64}
    tensors = {
        one.name: torch.tensor(columns[one.name], dtype=kinds.get(one.name, torch.float32))
        for one in fields(Cameras)
    }
    return Cameras(**tensors)
