"""Poses of a scene that agree better with its photos: an adjustment to tie points, where it helps.

Poses from satellite positions and an inertial unit are off by centimetres and hundredths of a degree, which
is some pixels; those of structure from motion were adjusted before and gain nothing.  A few groups of photos
show which is the case, and all are adjusted only where those agree clearly better afterwards.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from plnerf.capture.bundle_adjustment import Adjusted, AdjustmentConfig, adjust
from plnerf.capture.pairs import Pair
from plnerf.capture.tie_points import TieConfig, neighbour_pairs, sampled_pairs, tie_points
from plnerf.errors import ConfigError
from plnerf.scene.scene import Scene

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class PosesConfig:
    """Whether the given poses of a scene are adjusted before wires are detected."""

    adjust: bool = True
    """Whether poses are adjusted where that makes photos agree better."""
    loose_px: float = 0.25
    """Poses are adjusted where the median reprojection error of tie points is more than this,"""
    gain: float = 0.7
    """and falls to this share or less,"""
    agree_px: float = 1.0
    """and to no more than this: what stays farther apart are no matches."""
    groups: int = 5
    """Groups of neighbouring photos that show whether an adjustment would help."""
    group_size: int = 5
    """Photos of a group."""
    min_points: int = 30
    """Tie points that groups must have to decide; and without which poses stay as they are."""
    max_images: int = 2000
    """Scenes of more images are not adjusted: the equations take memory with the square of this number."""
    ties: TieConfig = field(default_factory=TieConfig)
    adjustment: AdjustmentConfig = field(default_factory=AdjustmentConfig)

    def __post_init__(self) -> None:
        if (
            not 0 < self.gain <= 1
            or not min(self.loose_px, self.agree_px) > 0
            or min(self.groups, self.min_points) < 1
            or self.group_size < 3
        ):
            raise ConfigError(
                "poses need a gain above 0 and at most 1, loose_px and agree_px above 0, groups and "
                f"min_points of 1 or more and a group_size of 3 or more, but got {self}."
            )


@dataclass(frozen=True)
class PoseAdjustment:
    """What an adjustment of all poses did."""

    images: int
    points: int
    before_px: float
    """Median reprojection error of the tie points, in the pixels in which features were found."""
    after_px: float
    moved: float
    """Median distance by which cameras moved, in the unit of the world."""
    turned_deg: float
    """Median angle by which they turned."""

    def text(self, unit: str) -> str:
        """The same as a sentence; unit: "m" or "unscaled"."""
        moved = f"{100 * self.moved:.1f} cm" if unit == "m" else f"{self.moved:.3g} (unscaled)"
        return (
            f"The given poses were adjusted to {self.points:,} tie points of {self.images} photos: their "
            f"median reprojection error fell from {self.before_px:.2f} to {self.after_px:.2f} px; cameras "
            f"moved by {moved} and turned by {self.turned_deg:.3f} degrees (medians)."
        )


def with_adjusted_poses(
    scene: Scene, config: PosesConfig, progress: Progress | None = None
) -> tuple[Scene, PoseAdjustment | None]:
    """The scene with poses that agree with tie points, or the scene itself and None where that does not help.

    Held-out images move too: without it they would be compared with pictures of other places.  Frames, lenses
    and pixels stay.
    """
    report = progress or (lambda done, of: None)
    images = len(scene.names)
    if not config.adjust or not 3 <= images <= config.max_images:
        return scene, None
    sample = _adjusted(scene, sampled_pairs(scene.cameras, config.groups, config.group_size), config, None)
    if sample.points >= config.min_points and not _helps(sample, config):
        report(1, 1)
        return scene, None
    found = _adjusted(scene, neighbour_pairs(scene.cameras, config.ties.partners), config, progress)
    if not _helps(found, config):
        return scene, None
    cameras = scene.cameras
    gone = np.linalg.norm(found.centre - cameras.centre.double().numpy(), axis=1)
    R = found.R_scene_camera @ cameras.R_scene_camera.double().numpy().transpose(0, 2, 1)
    change = PoseAdjustment(
        images, found.points, found.before_px, found.after_px,
        moved=scene.frames.length_to_world(float(np.median(gone))),
        turned_deg=float(np.degrees(np.median(Rotation.from_matrix(R).magnitude()))),
    )  # fmt: skip
    poses = (torch.from_numpy(part).float() for part in (found.R_scene_camera, found.centre))
    return scene.with_poses(*poses), change


def _adjusted(
    scene: Scene, pairs: Sequence[Pair], config: PosesConfig, progress: Progress | None
) -> Adjusted:
    cameras = scene.photo_cameras
    ties = tie_points(scene.photos, cameras, pairs, config.ties, progress or (lambda done, of: None))
    R, centre = cameras.R_scene_camera.double().numpy(), cameras.centre.double().numpy()
    return adjust(R, centre, ties, config.adjustment)


def _helps(found: Adjusted, config: PosesConfig) -> bool:
    loose = found.points >= config.min_points and found.before_px > config.loose_px
    return loose and found.after_px <= min(config.agree_px, config.gain * found.before_px)
