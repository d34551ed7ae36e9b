"""The photos of a scene as a survey uses them: cameras in the LineFrame, float64."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from plnerf.line.frame import LineFrame
from plnerf.line.wire import Wire
from plnerf.scene.cameras import Cameras, project
from plnerf.scene.photos import Pictures
from plnerf.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class Photos:
    """The training images of a scene, with their poses and lenses, at the resolution of training."""

    frame: LineFrame
    cameras: Cameras
    """All of the scene's, in the LineFrame, float64."""
    images: Pictures
    full: Pictures
    """The same at their full size."""
    full_sizes_px: Int[np.ndarray, "n 2"]
    names: tuple[str, ...]
    train: tuple[int, ...]
    """Indices of the images that a survey may use."""
    box: Float[np.ndarray, "2 3"]
    """Lowest and highest corner of what the capture is about, LineFrame."""
    pose_covariance: Float[np.ndarray, "p p"] | None = None
    """Of the centres of all cameras (LineFrame) and their turns (radians, about its axes), a camera's six
    numbers after another's, where an adjustment to tie points says it."""

    def full_size(self) -> "Photos":
        """The same with the photos at their full size."""
        cameras = self.cameras.at_size(torch.from_numpy(self.full_sizes_px))
        return replace(self, cameras=cameras, images=self.full)

    @property
    def reduced(self) -> float:
        """How many pixels of the photos make one here, along the side: the median."""
        return float(np.median(self.full_sizes_px / self.cameras.size_px.numpy()))

    def within(self, points: Float[np.ndarray, "n 3"], farthest: float) -> Bool[np.ndarray, " n"]:
        """Which points are no background: within `farthest` half sides of the box from its middle."""
        return within(points, self.box, farthest)

    def of(self, points: Float[np.ndarray, "n 3"]) -> "Photos":
        """With those training images only that have one of the points inside of them."""
        shown = np.isfinite(self.distances(points)).any(1).tolist()
        return replace(self, train=tuple(i for i, here in zip(self.train, shown, strict=True) if here))

    def distances(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "t n"]:
        """From the camera of each training image to each point inside of it; infinite to all others."""
        cameras = self.cameras[list(self.train)]
        pixels, depths = project(cameras, torch.from_numpy(points))
        inside = ((pixels >= 0) & (pixels < cameras.size_px[:, None])).all(-1) & (depths > 0)
        apart = np.linalg.norm(points - cameras.centre.numpy()[:, None], axis=-1)
        found: Float[np.ndarray, "t n"] = np.where(inside.numpy(), apart, np.inf)
        return found


def within(
    points: Float[np.ndarray, "n 3"], box: Float[np.ndarray, "2 3"], farthest: float
) -> Bool[np.ndarray, " n"]:
    """Which points lie within `farthest` of a box's longest half side from its middle, along every axis."""
    low, high = box
    middle, half = (low + high) / 2, (high - low) / 2
    inside: Bool[np.ndarray, " n"] = (np.abs(points - middle) <= farthest * half.max()).all(1)
    return inside


def box_around(box: Float[np.ndarray, "2 3"], wires: Sequence[Wire]) -> Float[np.ndarray, "2 3"]:
    """The box that holds another one, such as that of the cameras, and the wires whose place is certain."""
    ends = [wire.points(np.array([0.0, wire.base.length_m])) for wire in wires if wire.evidence.certain]
    every = np.concatenate([box, *ends])
    return np.stack([every.min(0), every.max(0)])


def photos_of(scene: Scene, pose_covariance: Float[np.ndarray, "p p"] | None = None) -> Photos:
    """Enters the LineFrame.  pose_covariance: as in `Photos`, of centres in the scene frame."""
    frame = LineFrame.of_scene(scene.frames)
    if pose_covariance is not None:
        units = np.ones((len(scene.names), 6))
        units[:, :3] = frame.from_scene(units[:, :3])
        pose_covariance = units.reshape(-1, 1) * pose_covariance * units.ravel()
    return Photos(
        frame, frame.cameras(scene.cameras), scene.images, scene.photos, scene.photo_sizes_px,
        scene.names, scene.train, frame.from_scene(scene.box.astype(np.float64)), pose_covariance,
    )  # fmt: skip
