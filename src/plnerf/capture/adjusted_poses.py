"""Poses of a scene that agree better with its photos: an adjustment to tie points, where it helps.

Poses from satellite positions and an inertial unit are off by centimetres and hundredths of a degree, which
is some pixels; those of structure from motion were adjusted before and gain nothing.  A few groups of photos
show which is the case, and all are adjusted only where those agree clearly better afterwards.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from plnerf.capture.bundle_adjustment import Adjusted, adjust
from plnerf.capture.pairs import Pair
from plnerf.capture.poses_config import PosesConfig
from plnerf.capture.tie_points import (
    Features,
    Progress,
    features_of,
    images_of,
    neighbour_pairs,
    sampled_pairs,
    silent,
    tie_points,
)
from plnerf.scene.cameras import Cameras
from plnerf.scene.scene import Scene


@dataclass(frozen=True)
class PoseAdjustment:
    """What an adjustment of all poses did, in numbers."""

    images: int
    points: int
    before_px: float
    """Median reprojection error of the tie points, in the pixels in which features were found."""
    after_px: float
    moved: float
    """Median distance by which cameras moved, in the unit of the world."""
    turned_deg: float
    """Median angle by which they turned."""
    covariance: Float[np.ndarray, "p p"]
    """What is still unknown of all centres and rotations (scene frame, radians about its axes), a pose's six
    numbers after another's."""

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
    report, images = progress or silent, len(scene.names)
    if not config.adjust or not 3 <= images <= config.max_images:
        return scene, None
    cameras = scene.photo_cameras
    sampled = sampled_pairs(cameras, config.groups, config.group_size)
    features = features_of(scene.photos, cameras, images_of(sampled), config.ties)
    sample = _adjusted(cameras, features, sampled, config)
    if sample.points >= config.groups * config.min_points and not _helps(sample, config):
        report(1, 1)
        return scene, None
    pairs = neighbour_pairs(cameras, config.ties.partners)
    others = [image for image in images_of(pairs) if image not in features]
    first, steps = len(others), len(others) + len(pairs)
    more = features_of(scene.photos, cameras, others, config.ties, lambda done, of: report(done, steps))
    found = _adjusted(cameras, features | more, pairs, config, lambda done, of: report(first + done, steps))
    if not _helps(found, config):
        return scene, None
    moved_by = np.linalg.norm(found.centre - cameras.centre.double().numpy(), axis=1)
    R = found.R_scene_camera @ cameras.R_scene_camera.double().numpy().transpose(0, 2, 1)
    change = PoseAdjustment(
        images, found.points, found.before_px, found.after_px,
        moved=scene.frames.length_to_world(float(np.median(moved_by))),
        turned_deg=float(np.degrees(np.median(Rotation.from_matrix(R).magnitude()))),
        covariance=found.covariance,
    )  # fmt: skip
    poses = (torch.from_numpy(part).float() for part in (found.R_scene_camera, found.centre))
    return scene.with_poses(*poses), change


def _adjusted(
    cameras: Cameras,
    features: Mapping[int, Features],
    pairs: Sequence[Pair],
    config: PosesConfig,
    progress: Progress = silent,
) -> Adjusted:
    ties = tie_points(features, cameras, pairs, config.ties, progress)
    R, centre = cameras.R_scene_camera.double().numpy(), cameras.centre.double().numpy()
    return adjust(R, centre, ties, config.adjustment)


def _helps(found: Adjusted, config: PosesConfig) -> bool:
    loose = found.points >= config.min_points and found.before_px > config.loose_px
    return loose and found.after_px <= min(config.agree_px, config.gain * found.before_px)
