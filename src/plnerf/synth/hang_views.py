"""The photos of a scene as posed views at full size, in an upright world.

Letters: p points or pixels; plane: coordinates on the camera's plane z = 1, lens distortion taken out.
Camera axes are OpenCV's; pixels count from the image's top-left corner, the first one's centre is (0.5, 0.5).
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float

from plnerf.capture.similarity import upright_rotation
from plnerf.rays.lens import undistort_plane
from plnerf.scene.cameras import distort
from plnerf.scene.listing import Listing

UPRIGHT = 1e-9
"""1 - cosine of the angle by which a world's z may lean from up and still be up: 0.003 degrees."""
BEYOND = 1.1
"""Points further out on the plane than so many times the image's farthest corner are not seen: the lens's
polynomial may fold back there."""


@dataclass(frozen=True, eq=False)
class PhotoView:
    """One photo's file, pose and lens."""

    name: str
    """File name, without folder."""
    path: Path
    R_world_camera: Float[np.ndarray, "3 3"]
    centre: Float[np.ndarray, "3"]
    focal_px: Float[np.ndarray, "2"]
    principal_px: Float[np.ndarray, "2"]
    distortion: Float[np.ndarray, "5"]
    """k1 k2 p1 p2 k3."""
    width: int
    height: int

    @property
    def axis(self) -> Float[np.ndarray, "3"]:
        """Direction of view."""
        return self.R_world_camera[:, 2]

    @cached_property
    def reach(self) -> float:
        """Distance from the plane's origin beyond which nothing is seen."""
        x, y = float(self.width), float(self.height)
        edge = np.array([[0, 0], [x / 2, 0], [x, 0], [x, y / 2], [x, y], [x / 2, y], [0, y], [0, y / 2]])
        return BEYOND * float(np.linalg.norm(self.plane(edge), axis=1).max())

    def plane(self, pixels: Float[np.ndarray, "*p 2"]) -> Float[np.ndarray, "*p 2"]:
        """Where the rays through pixels meet the plane z = 1."""
        flat = (pixels - self.principal_px) / self.focal_px
        if not self.distortion.any():
            return flat
        lens = torch.from_numpy(self.distortion).expand(*flat.shape[:-1], 5)
        bent: Float[np.ndarray, "*p 2"] = undistort_plane(torch.from_numpy(flat), lens).numpy()
        return bent

    def pixels(self, plane: Float[np.ndarray, "*p 2"]) -> Float[np.ndarray, "*p 2"]:
        """The inverse of `plane`."""
        bent = distort(torch.from_numpy(plane), torch.from_numpy(self.distortion)).numpy()
        return bent * self.focal_px + self.principal_px

    def local(self, points: Float[np.ndarray, "*p 3"]) -> Float[np.ndarray, "*p 3"]:
        """World points in camera axes."""
        turned: Float[np.ndarray, "*p 3"] = (points - self.centre) @ self.R_world_camera
        return turned

    def project(
        self, points: Float[np.ndarray, "p 3"]
    ) -> tuple[Float[np.ndarray, "p 2"], Float[np.ndarray, " p"], Bool[np.ndarray, " p"]]:
        """Pixels of world points, their depths, and which of them lie before the camera within its reach.

        A pixel within reach may still lie outside of the image.
        """
        local = self.local(points)
        z = local[:, 2]
        plane = local[:, :2] / np.where(z > 0, z, 1.0)[:, None]
        ahead = (z > 0) & (np.linalg.norm(plane, axis=1) < self.reach)
        return self.pixels(np.where(ahead[:, None], plane, 0.0)), z, ahead

    def inside(self, pixels: Float[np.ndarray, "p 2"], margin_px: float = 0.0) -> Bool[np.ndarray, " p"]:
        """Which pixels lie in the image, or at most `margin_px` outside of it."""
        size = np.array([self.width, self.height])
        within: Bool[np.ndarray, "p 2"] = (pixels >= -margin_px) & (pixels < size + margin_px)
        return np.logical_and.reduce(within, axis=1)

    def T_world_camera_opengl(self) -> Float[np.ndarray, "4 4"]:
        """Camera to world with OpenGL camera axes (x right, y up, z backward), for truth.json."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.R_world_camera * np.array([1.0, -1.0, -1.0])
        matrix[:3, 3] = self.centre
        return matrix


def upright(up: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """The rotation of a world that makes `up` its z axis; the identity where it is that already."""
    unit = up / np.linalg.norm(up)
    return np.eye(3) if 1 - unit[2] < UPRIGHT else upright_rotation(unit)


def photo_views(listing: Listing, up: Float[np.ndarray, "3"]) -> list[PhotoView]:
    """All photos of a scene, in the order of their names, in the world turned by `upright(up)`."""
    R_upright_world = upright(up)
    paths = [Path(shot.name) for shot in listing.shots]
    plain = len({path.name for path in paths}) == len(paths)
    views = []
    for path, shot in zip(paths, listing.shots, strict=True):
        lens, pose = shot.intrinsics, shot.T_world_camera
        views.append(
            PhotoView(
                path.name if plain else "_".join(part for part in path.parts if part not in {"/", ".."}),
                shot.path,
                R_upright_world @ pose[:3, :3],
                R_upright_world @ pose[:3, 3],
                np.array([lens.fl_x, lens.fl_y]),
                np.array([lens.cx, lens.cy]),
                np.array(lens.distortion, np.float64),
                lens.width,
                lens.height,
            )
        )
    return views
