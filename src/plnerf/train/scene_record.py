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
from plnerf.scene.json_fields import numbers_of
from plnerf.scene.scene import Scene
from plnerf.scene.strict_json import object_of, read_json, shown
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
    stated_centre: Float[torch.Tensor, "n 3"] | None = None

    @classmethod
    def of(cls, scene: Scene) -> "SceneRecord":
        """What is kept of a scene."""
        return cls(
            scene.names, scene.cameras, scene.frames, scene.box, scene.train, scene.test, scene.stated_centre
        )

    def restored(self, scene: Scene) -> Scene:
        """The scene, as it was read, in the frames and with the poses of this record."""
        scene = scene.in_frames(self.frames, self.box)
        if self.stated_centre is None:
            return scene
        return scene.with_poses(self.cameras.R_scene_camera, self.cameras.centre)

    def is_of(self, scene: Scene) -> bool:
        """Whether a scene, as `restored` gave it, has the images, poses and held-out images of this one."""
        stated, known = (one.cameras.centre if one.stated_centre is None else one.stated_centre
                         for one in (scene, self))  # fmt: skip
        same = scene.names == self.names and (scene.train, scene.test) == (self.train, self.test)
        return same and torch.allclose(stated, known, atol=1e-5)


def write_record(folder: Path, record: SceneRecord) -> None:
    """Writes scene.json into a run folder."""
    content = {
        "format_version": FORMAT_VERSION,
        "names": list(record.names),
        "train": list(record.train),
        "test": list(record.test),
        "frames": record.frames.to_json(),
        "box_scene": record.box.tolist(),
        "stated_centre": None if record.stated_centre is None else record.stated_centre.tolist(),
        "cameras": {one.name: getattr(record.cameras, one.name).tolist() for one in fields(Cameras)},
    }
    write_text(folder / FILE, json.dumps(content, indent=1, allow_nan=False) + "\n")


def read_record(folder: Path) -> SceneRecord:
    """Reads scene.json.  Raises ConfigError where it is absent, damaged or of another version."""
    path = folder / FILE
    do = "The run's cameras and frames are not known. Copy the whole run folder, or train again."
    content = object_of(read_json(path, ConfigError, do), str(path), ConfigError, do)
    if content.get("format_version") != FORMAT_VERSION:
        raise ConfigError(
            f"{path} has format version {shown(content.get('format_version'))}, but this version of plnerf "
            f"reads version {FORMAT_VERSION}. Use the version of plnerf that wrote it, or train again."
        )
    try:
        names = tuple(content["names"])
        if not all(isinstance(name, str) for name in names):
            raise ValueError("its names are no texts")
        train, test = (_places(content[key], len(names), key) for key in ("train", "test"))
        return SceneRecord(
            names=names,
            cameras=_cameras(content["cameras"], len(names)),
            frames=Frames.from_json(content["frames"]),
            box=_numbers(content["box_scene"], "box_scene", 2, 3),
            train=train,
            test=test,
            stated_centre=_stated(content.get("stated_centre"), len(names)),
        )
    except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError) as error:
        raise ConfigError(f"{path} cannot be read ({error!r}). {do}") from error


def _places(value: Any, count: int, key: str) -> tuple[int, ...]:
    """Numbers of images."""
    if not all(type(place) is int and 0 <= place < count for place in value):
        raise ValueError(f"{key} names images that are not among its {count}")
    return tuple(value)


def _numbers(value: Any, key: str, *shape: int) -> Float[np.ndarray, "..."]:
    """Finite numbers of a stated shape."""
    array = numbers_of(value)
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"{key} must be finite numbers of the shape {shape}, but is {shown(value)}")
    return array


def _stated(value: Any, count: int) -> Float[torch.Tensor, "n 3"] | None:
    """Camera centres as the scene states them, where its poses were adjusted."""
    if value is None:
        return None
    return _tensor(value, "stated_centre", count, 3)


def _cameras(columns: dict[str, Any], count: int) -> Cameras:
    shapes = {"R_scene_camera": (3, 3), "centre": (3,), "distortion": (5,)}
    tensors = {
        one.name: _tensor(columns[one.name], one.name, count, *shapes.get(one.name, (2,)))
        for one in fields(Cameras)
    }
    return Cameras(**tensors)


def _tensor(value: Any, key: str, *shape: int) -> torch.Tensor:
    """Finite numbers of a stated shape, as cameras hold them."""
    kind = torch.int64 if key == "size_px" else torch.float32
    tensor = torch.tensor(_numbers(value, key, *shape), dtype=kind)
    if not tensor.isfinite().all():  # what is finite in 64 bits need not be in 32
        raise ValueError(f"{key} holds a number that is too large")
    return tensor
