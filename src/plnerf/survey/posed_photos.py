"""The photos of a scene as a survey uses them: cameras in the LineFrame, float64."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from plnerf.line.frame import LineFrame
from plnerf.scene.cameras import Cameras
from plnerf.scene.images import ImageStore
from plnerf.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class Photos:
    """The training images of a scene, with their poses and lenses."""

    frame: LineFrame
    cameras: Cameras
    """All of the scene's, in the LineFrame, float64."""
    images: ImageStore
    names: tuple[str, ...]
    train: tuple[int, ...]
    """Indices of the images that a survey may use."""
    box: Float[np.ndarray, "2 3"]
    """Lowest and highest corner of what the capture is about, LineFrame."""

    def within(self, points: Float[np.ndarray, "n 3"], farthest: float) -> Bool[np.ndarray, " n"]:
        """Which points are no background: within `farthest` half sides of the box from its middle."""
        return within(points, self.box, farthest)


def within(
    points: Float[np.ndarray, "n 3"], box: Float[np.ndarray, "2 3"], farthest: float
) -> Bool[np.ndarray, " n"]:
    """Which points lie within `farthest` of a box's longest half side from its middle, along every axis."""
    low, high = box
    middle, half = (low + high) / 2, (high - low) / 2
    inside: Bool[np.ndarray, " n"] = (np.abs(points - middle) <= farthest * half.max()).all(1)
    return inside


def photos_of(scene: Scene) -> Photos:
    """Enters the LineFrame."""
    frame = LineFrame.of_scene(scene.frames)
    return Photos(
        frame, frame.cameras(scene.cameras), scene.images, scene.names, scene.train,
        frame.from_scene(scene.box.astype(np.float64)),
    )  # fmt: skip
