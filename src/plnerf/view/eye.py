"""From where a browser looks: the viewer's camera as one camera of the LineFrame, and poses to send it to.

viser's cameras have OpenCV's axes, a vertical field of view, and the middle of the window as their axis.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from plnerf.scene.cameras import Cameras
from plnerf.view.display_frame import DisplayFrame


@dataclass(frozen=True, eq=False)
class Eye:
    """A pinhole in the LineFrame."""

    R_line_camera: Float[np.ndarray, "3 3"]
    centre: Float[np.ndarray, "3"]
    fov_rad: float
    """Vertical."""
    aspect: float
    """Width over height."""

    @classmethod
    def of_viewer(
        cls, frame: DisplayFrame, wxyz: np.ndarray, position: np.ndarray, fov_rad: float, aspect: float
    ) -> "Eye":
        """What a client reports of its camera."""
        R = Rotation.from_quat(np.asarray(wxyz, np.float64), scalar_first=True).as_matrix()
        return cls(R, frame.to_line(np.asarray(position, np.float64)), float(fov_rad), float(aspect))

    def camera(self, rays: int) -> Cameras:
        """As a camera of about so many pixels, in the LineFrame, float64."""
        height = max(1, round(math.sqrt(rays / self.aspect)))
        width = max(1, round(height * self.aspect))
        focal = height / 2 / math.tan(self.fov_rad / 2)
        return Cameras(
            R_scene_camera=torch.from_numpy(self.R_line_camera[None]),
            centre=torch.from_numpy(self.centre[None]),
            focal_px=torch.tensor([[focal, focal]], dtype=torch.float64),
            principal_px=torch.tensor([[width / 2, height / 2]], dtype=torch.float64),
            distortion=torch.zeros(1, 5, dtype=torch.float64),
            size_px=torch.tensor([[width, height]]),
        )

    @property
    def wxyz(self) -> Float[np.ndarray, "4"]:
        """The rotation as viser has it."""
        found: Float[np.ndarray, 4] = Rotation.from_matrix(self.R_line_camera).as_quat(scalar_first=True)
        return found


def looking(
    centre: Float[np.ndarray, "3"], at: Float[np.ndarray, "3"], fov_rad: float, aspect: float
) -> Eye:
    """An upright eye at a place that looks at another."""
    z = (at - centre) / np.linalg.norm(at - centre)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x = np.array([1.0, 0.0, 0.0]) if np.linalg.norm(x) < 1e-6 else x / np.linalg.norm(x)
    return Eye(np.stack([x, np.cross(z, x), z], 1), centre, fov_rad, aspect)


def eye_of(cameras: Cameras, i: int, aspect: float) -> Eye:
    """The eye that sees all that camera i of the LineFrame sees, in a window of some shape."""
    width, height = cameras.size_px[i].tolist()
    fx, fy = cameras.focal_px[i].tolist()
    tall, wide = height / 2 / fy, width / 2 / fx
    half = max(tall, wide / aspect)
    return Eye(
        cameras.R_scene_camera[i].double().numpy(), cameras.centre[i].double().numpy(), 2 * math.atan(half),
        aspect,
    )  # fmt: skip
