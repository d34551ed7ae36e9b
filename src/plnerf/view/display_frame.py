"""Where things are in the viewer: near an origin of its own, so that float32 holds them.

    x_viewer = (x_line - origin) / LINE_PER_UNIT

The axes are those of the LineFrame (z up).  Large coordinates of a map are subtracted in float64 before
anything is sent.
"""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Float32

from plnerf.line.frame import LineFrame
from plnerf.scene.cameras import Cameras
from plnerf.scene.transforms import Frames

LINE_PER_UNIT = 10.0
"""Metres (or units of an unscaled line) of a viewer's unit.  viser sends depths of pictures as 24 bits of
1e-5 units, so that they end at 167 units: 1.7 km, in steps of 0.1 mm."""


@dataclass(frozen=True, eq=False)
class DisplayFrame:
    """The viewer's frame of one line."""

    line: LineFrame
    origin: Float[np.ndarray, "3"]
    """In the LineFrame."""

    def to_viewer(self, x_line: Float[np.ndarray, "*b 3"]) -> Float32[np.ndarray, "*b 3"]:
        """Points of the LineFrame, subtracted in float64 and then rounded to float32."""
        return ((x_line - self.origin) / LINE_PER_UNIT).astype(np.float32)

    def to_line(self, x_viewer: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3"]:
        """The inverse of `to_viewer`, float64."""
        moved: Float[np.ndarray, "*b 3"] = x_viewer.astype(np.float64) * LINE_PER_UNIT + self.origin
        return moved

    def line_cameras(self, frames: Frames, cameras: Cameras) -> Cameras:
        """Cameras of a scene or a run in the LineFrame, float64."""
        own = LineFrame.of_scene(frames)
        scale, R, shift = (torch.from_numpy(np.asarray(one)) for one in self.line.from_frame(own))
        found = own.cameras(cameras)
        return replace(
            found, R_scene_camera=R @ found.R_scene_camera, centre=scale * found.centre @ R.T + shift
        )

    def scene_camera(self, frames: Frames, camera: Cameras) -> Cameras:
        """One camera of the LineFrame in the frame of a scene or a run, float32."""
        own = LineFrame.of_scene(frames)
        scale, R, shift = own.from_frame(self.line)
        centre = own.to_scene(scale * camera.centre.numpy() @ R.T + shift)
        return Cameras(
            R_scene_camera=(torch.from_numpy(R) @ camera.R_scene_camera).float(),
            centre=torch.from_numpy(centre).float(),
            focal_px=camera.focal_px.float(),
            principal_px=camera.principal_px.float(),
            distortion=camera.distortion.float(),
            size_px=camera.size_px,
        )

    def depth_to_viewer(self, frames: Frames, depth: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
        """Depths of a scene or a run, in its scene units, in the viewer's."""
        own = LineFrame.of_scene(frames)
        scale, _, _ = self.line.from_frame(own)
        found: Float[np.ndarray, "h w"] = own.from_scene(depth) * (scale / LINE_PER_UNIT)
        return found
