"""The images of a capture as the viewer shows them: where each was taken, and its pixels when asked for."""

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8

from plnerf.errors import SceneError
from plnerf.scene.cameras import Cameras, distort, project
from plnerf.scene.listing import Listing
from plnerf.scene.photos import PhotoFiles, Pictures
from plnerf.scene.scene import scene_cameras
from plnerf.scene.transforms import Frames
from plnerf.view.display_frame import DisplayFrame
from plnerf.view.eye import Eye

NEAREST = 0.02
"""Depth in metres from which on a point counts as before a camera."""


@dataclass(frozen=True, eq=False)
class PosedViews:
    """The images of a scene, sorted by name."""

    names: tuple[str, ...]
    cameras: Cameras
    """In the LineFrame, float64, with the lenses of the photos at their full size."""
    photos: Pictures | None
    """None: they are not there, and only where they were taken is known."""

    def photo(self, i: int, most_px: int) -> UInt8[np.ndarray, "h w 3"] | None:
        """Photo i, its longer side reduced to at most so many pixels; None where it is not there."""
        if self.photos is None:
            return None
        try:
            rgb = self.photos.image(i)
        except SceneError:
            return None
        height, width = rgb.shape[:2]
        factor = min(1.0, most_px / max(height, width))
        size = (max(1, round(width * factor)), max(1, round(height * factor)))
        return rgb if factor == 1 else cv2.resize(rgb, size, interpolation=cv2.INTER_AREA).astype(np.uint8)

    def pixels(self, i: int, points: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, "p 2"]:
        """Where photo i shows points of the LineFrame, in pixels of its full size; NaN where it cannot.

        That is behind the camera, and so far aside that the lens's polynomial has turned back.
        """
        camera = self.cameras[[i]]
        pixels, depth = project(camera, torch.from_numpy(points))
        local = (points - camera.centre[0].numpy()) @ camera.R_scene_camera[0].numpy()
        aside = np.hypot(local[:, 0], local[:, 1]) / np.maximum(local[:, 2], NEAREST)
        seen = (depth[0].numpy() > NEAREST) & (aside < widest(camera.distortion[0].numpy()))
        found: Float[np.ndarray, "p 2"] = np.where(seen[:, None], pixels[0].numpy(), np.nan)
        return found

    def seen_by(
        self, i: int, eye: Eye, size_px: tuple[int, int], photo: UInt8[np.ndarray, "h w 3"]
    ) -> tuple[UInt8[np.ndarray, "k l 3"], Bool[np.ndarray, "k l"]]:
        """Photo i as an eye at the same place sees it, without the lens's distortion, and where it shows it.

        size_px: width and height of the result.
        """
        width, height = size_px
        focal = height / 2 / np.tan(eye.fov_rad / 2)
        x, y = np.meshgrid(np.arange(width) + 0.5 - width / 2, np.arange(height) + 0.5 - height / 2)
        rays = np.stack([x / focal, y / focal, np.ones_like(x)], -1).reshape(-1, 3)
        camera = self.cameras[[i]]
        local = rays @ eye.R_line_camera.T @ camera.R_scene_camera[0].numpy()
        ahead = local[:, 2] > 1e-6
        plane = local[:, :2] / np.maximum(local[:, 2:], 1e-6)
        ahead &= np.hypot(plane[:, 0], plane[:, 1]) < widest(camera.distortion[0].numpy())
        bent = distort(torch.from_numpy(plane), camera.distortion).numpy()
        at = bent * camera.focal_px.numpy() + camera.principal_px.numpy()
        at *= np.array([photo.shape[1], photo.shape[0]]) / camera.size_px.numpy()
        inside = ahead & ((at >= 0) & (at <= [photo.shape[1], photo.shape[0]])).all(1)
        maps = (np.where(ahead[:, None], at, 0.0) - 0.5).astype(np.float32).reshape(height, width, 2)
        seen = cv2.remap(
            photo, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return seen.astype(np.uint8), inside.reshape(height, width)


def views_of(listing: Listing, frames: Frames, frame: DisplayFrame) -> PosedViews:
    """The images of a listing whose scene frame is `frames`."""
    cameras = frame.line_cameras(frames, scene_cameras(listing, frames, 1))
    return PosedViews(tuple(shot.name for shot in listing.shots), cameras, PhotoFiles(listing.shots))


def widest(distortion: Float[np.ndarray, "5"]) -> float:
    """Distance from the axis, at depth 1, up to which the lens's polynomial r (1 + k1 r^2 + k2 r^4 + k3 r^6)
    grows: farther out it turns back into the image."""
    k1, k2, _, _, k3 = distortion
    squares = np.roots([7 * k3, 5 * k2, 3 * k1, 1.0])
    real = squares[(np.abs(squares.imag) < 1e-9) & (squares.real > 0)].real
    return float(np.sqrt(real.min())) if len(real) else np.inf
