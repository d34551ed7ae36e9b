"""A block of a corridor as a scene of its own, by reference: the photos stay where they are."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from plnerf.detect.config import DetectConfig
from plnerf.detect.detect import Progress
from plnerf.line.files import read_wires
from plnerf.line.frame import LineFrame
from plnerf.line.move import move_wire
from plnerf.line.wire import Wire
from plnerf.scene.listing import Listing, Shot
from plnerf.scene.scene import Scene
from plnerf.scene.write_transforms import write_transforms

SCENE, GIVEN = "transforms.json", "given.json"
"""In a block's folder: its scene, and the wires that it is given."""
LEAST_IMAGES = 3
"""Fewer make no scene."""


@dataclass(frozen=True)
class GivenWires:
    """Finds the wires of a scene in a file of another LineFrame of the same world."""

    path: Path

    def __call__(
        self, scene: Scene, config: DetectConfig, progress: Progress | None = None
    ) -> tuple[Wire, ...]:
        """The wires in the scene's LineFrame.  Raises SurveyError where the file cannot be read."""
        wires, frame = read_wires(self.path)
        own = LineFrame.of_scene(scene.frames)
        return tuple(move_wire(wire, frame, own) for wire in wires)


def write_block_scene(
    listing: Listing,
    images: Int[np.ndarray, " k"],
    up: Float[np.ndarray, "3"],
    held_out: frozenset[str],
    folder: Path,
) -> str:
    """Writes the scene of some images of a listing; returns a fingerprint of it and of its photos.

    up: that of the corridor, which all blocks share.  held_out: images that no block trains on.  Photos count
    by their sizes and times, not by their bytes: a corridor has too many of these.
    """
    shots = tuple(listing.shots[int(k)] for k in np.sort(images))
    held = [shot.name for shot in shots if shot.name in held_out]
    if not held or len(held) == len(shots):
        held = [shot.name for shot in shots[::8]]
    part = replace(listing, shots=shots, up=up, train=None, test=None, truth=None, left_out=())
    write_transforms(part, folder / SCENE, {"root": str(listing.root.resolve()), "test": held})
    whole = hashlib.sha256((folder / SCENE).read_bytes())
    whole.update(stamps(shots).encode())
    return whole.hexdigest()


def stamps(shots: Sequence[Shot]) -> str:
    """Sizes and times of the photos and masks of images."""
    files = [path for shot in shots for path in (shot.path, shot.mask) if path is not None]
    return repr([(stat.st_size, stat.st_mtime_ns) for stat in (path.stat() for path in files)])
