"""What is known of the images' pose residuals before wires are measured in them.

An image's residual is what tie points leave unknown of its pose, and what is its own.  The former is shared:
neighbouring images are off together, and all of them by the mean error of the given positions, so that many
images do not make a wire's place that much more certain.  It comes from the bundle adjustment; poses that
were not adjusted have only what is their own, and how much that is the wires tell.

Letters: n images.  Residuals as in `Projection.by_pose`, pixels.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from plnerf.scene.cameras import Cameras
from plnerf.survey.posed_photos import Photos
from plnerf.survey.refine.projection import MOVES

TURNED, MOVED = slice(0, 2), slice(3, 5)
"""The numbers of a pose residual by which an image is turned, right and down, and by which it is moved."""


@dataclass(frozen=True, eq=False)
class PosePrior:
    """Normal distributions around zero."""

    sd_px: Float[np.ndarray, "6"]
    """Standard deviations of what is each image's own."""
    shared: Float[np.ndarray, "p p"] | None = None
    """Covariance of what tie points leave unknown of all images, p = 6 n; None: nothing is known of it."""

    def precision(self, images: int) -> Float[np.ndarray, "p p"]:
        """The inverse of the covariance of both together."""
        own = np.tile(self.sd_px**2, images)
        if self.shared is None:
            return np.diag(1 / own)
        inverse: Float[np.ndarray, "p p"] = np.linalg.inv(self.shared + np.diag(own))
        return inverse

    def learnt(
        self, pose: Float[np.ndarray, "n 6"], covariance: Float[np.ndarray, "p p"], least_px: float
    ) -> "PosePrior":
        """With the deviations that residuals and how well they are known suggest (expectation maximisation).

        Images are turned by as much to the right as down, and as much about their axis; likewise moved.
        """
        own = np.tile(self.sd_px**2, len(pose))
        share = own[:, None] * self.precision(len(pose))  # of a residual, what is the image's own
        unknown = own - (share * own).diagonal() + ((share @ covariance) * share).sum(1)
        squares = ((share @ pose.ravel()) ** 2 + unknown).reshape(-1, MOVES)
        turned, moved = (float(np.sqrt(squares[:, two].mean())) for two in (TURNED, MOVED))
        return replace(self, sd_px=np.maximum(np.repeat([turned, moved], 3), least_px))


def prior_of(photos: Photos, usual_m: float, sd_px: float) -> PosePrior:
    """Before anything was measured.  usual_m: distance, see `Projection.by_pose`; sd_px: of what is an
    image's own."""
    sd, views = np.full(MOVES, sd_px), list(photos.train)
    if photos.pose_covariance is None or not views:
        return PosePrior(sd)
    by_pose = _by_pose(photos.cameras[views], usual_m)
    of_pose = photos.pose_covariance.reshape(len(photos.names), MOVES, -1, MOVES)[views][:, :, views]
    shared = np.einsum("nij,njmk,mlk->niml", by_pose, of_pose, by_pose)
    return PosePrior(sd, shared.reshape(MOVES * len(views), -1))


def _by_pose(cameras: Cameras, usual_m: float) -> Float[np.ndarray, "n 6 6"]:
    """Derivatives of the residuals by a camera's centre and by its turn, both along the frame's axes.

    Of a camera that turns by w and moves by d, both in its own axes, a point (u, v, 1) z moves in the picture
    by f (w_z v - w_y, w_x - w_z u) and by f / z (u d_z - d_x, v d_z - d_y), but for squares of u and v.
    """
    axes = cameras.R_scene_camera.numpy().transpose(0, 2, 1)
    focal = cameras.focal_px[:, 0].numpy()[:, None]
    right, down, ahead = axes[:, 0], axes[:, 1], axes[:, 2]
    found = np.zeros((len(axes), MOVES, 6))
    found[:, 0, 3:], found[:, 1, 3:], found[:, 2, 3:] = -focal * down, focal * right, -focal * ahead
    found[:, 3, :3], found[:, 4, :3], found[:, 5, :3] = (
        -focal / usual_m * right, -focal / usual_m * down, focal / usual_m * ahead,
    )  # fmt: skip
    return found
