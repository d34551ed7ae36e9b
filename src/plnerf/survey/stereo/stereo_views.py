"""Views: posed images at the size at which stereo matches them.

Letters: p points or pixels.  LineFrame, float64; pixels as in `scene/cameras.py`: the first one's centre is
(0.5, 0.5).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, UInt8

from plnerf.line.wire import Wire
from plnerf.rays.lens import undistort_plane
from plnerf.scene.cameras import distort
from plnerf.survey.posed_photos import Photos
from plnerf.survey.stereo.config import StereoConfig


@dataclass(frozen=True, eq=False)
class View:
    """One posed image."""

    R_line_camera: Float[np.ndarray, "3 3"]
    centre: Float[np.ndarray, "3"]
    focal_px: Float[np.ndarray, "2"]
    principal_px: Float[np.ndarray, "2"]
    distortion: Float[np.ndarray, "5"]
    width: int
    height: int

    @property
    def axis(self) -> Float[np.ndarray, "3"]:
        """Direction of view."""
        return self.R_line_camera[:, 2]

    @cached_property
    def border(self) -> Float[np.ndarray, "n 3"]:
        """Directions once around the image's border, a pixel apart, unit length."""
        x, y = np.arange(float(self.width)), np.arange(float(self.height))
        right, low = self.width + 0 * y, self.height + 0 * x
        sides = [(x, 0 * x), (right, y), (self.width - x, low), (0 * y, self.height - y)]
        return self.directions(np.concatenate([np.stack(side, -1) for side in sides]))

    @cached_property
    def pixels_per_rad(self) -> float:
        """Pixels per radian: the root of the image's pixels per steradian.

        The solid angle is that of the triangles between axis and border (A. van Oosterom, J. Strackee, "The
        solid angle of a plane triangle", IEEE Transactions on Biomedical Engineering 30, 1983).
        """
        here, after = self.border, np.roll(self.border, -1, 0)
        below = 1 + here @ self.axis + after @ self.axis + (here * after).sum(1)
        angle = 2 * np.arctan2(np.cross(here, after) @ self.axis, below)
        return float(np.sqrt(self.width * self.height / abs(angle.sum())))

    @cached_property
    def least_cosine(self) -> float:
        """Cosine of the widest angle between the axis and a direction of the image."""
        return float((self.border @ self.axis).min())

    def rays(self) -> Float[np.ndarray, "h w 3"]:
        """Directions of all pixels' centres, unit length."""
        return self.directions(_centres(self.width, self.height))

    def directions(self, pixels: Float[np.ndarray, "*p 2"]) -> Float[np.ndarray, "*p 3"]:
        """Unit vectors from the centre through pixels."""
        rays = _through(pixels, self.focal_px, self.principal_px, self.distortion)
        turned: Float[np.ndarray, "*p 3"] = rays @ self.R_line_camera.T
        return turned

    @property
    def camera_rays(self) -> Float32[np.ndarray, "3 h w"]:
        """Unit vectors through all pixels' centres in the camera's axes; views of one lens share them."""
        lens = (self.focal_px, self.principal_px, self.distortion)
        return _camera_rays(*(tuple(one.tolist()) for one in lens), self.width, self.height)

    def project(
        self, points: Float[np.ndarray, "p 3"]
    ) -> tuple[Float[np.ndarray, "p 2"], Bool[np.ndarray, " p"]]:
        """Pixels of points, and which of them lie before the camera and inside of the image."""
        local = (points - self.centre) @ self.R_line_camera
        before = local[:, 2] > 0
        plane = torch.from_numpy(local[:, :2] / np.where(before, local[:, 2], 1.0)[:, None])
        bent = distort(plane, torch.from_numpy(self.distortion)).numpy()
        pixels: Float[np.ndarray, "p 2"] = bent * self.focal_px + self.principal_px
        inside = before & (pixels >= 0).all(1) & (pixels < (self.width, self.height)).all(1)
        return pixels, inside


@dataclass(frozen=True, eq=False)
class Picture:
    """The grey values of a view, and which of its pixels count."""

    view: View
    grey: UInt8[np.ndarray, "h w"]
    valid: Bool[np.ndarray, "h w"]


def view_of(photos: Photos, i: int, longest_px: int) -> View:
    """Camera i, reduced as `picture` reduces its image."""
    cameras = photos.cameras
    full = cameras.size_px[i].numpy()
    size = full // _reduction(full, longest_px)
    shrink = size / full
    return View(
        cameras.R_scene_camera[i].numpy(), cameras.centre[i].numpy(), cameras.focal_px[i].numpy() * shrink,
        cameras.principal_px[i].numpy() * shrink, cameras.distortion[i].numpy(), int(size[0]), int(size[1]),
    )  # fmt: skip


def picture(
    photos: Photos, i: int, view: View, longest_px: int
) -> tuple[Picture, UInt8[np.ndarray, "h w 3"]]:
    """Image i at the size of its view, for matching, and its colours."""
    rgb, valid = _reduced(photos, i, longest_px)
    return Picture(view, cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.uint8), valid), rgb


def shows_wires(view: View, wires: Sequence[Wire], config: StereoConfig) -> Bool[np.ndarray, "h w"]:
    """The pixels of a view within `wire_px` of a projected wire."""
    near = np.zeros((view.height, view.width), np.uint8)
    for wire in wires:
        pixel, inside = view.project(wire.points(np.linspace(0.0, wire.base.length_m, config.wire_samples)))
        column, row = pixel[inside].astype(int).T
        near[row, column] = 1
    side = 2 * config.wire_px + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    return cv2.dilate(near, disc) > 0


def _centres(width: int, height: int) -> Float[np.ndarray, "h w 2"]:
    return np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), -1)


def _through(
    pixels: Float[np.ndarray, "*p 2"],
    focal_px: Float[np.ndarray, "2"],
    principal_px: Float[np.ndarray, "2"],
    distortion: Float[np.ndarray, "5"],
) -> Float[np.ndarray, "*p 3"]:
    """Unit vectors through pixels, in the camera's axes."""
    plane = torch.from_numpy((pixels - principal_px) / focal_px)
    if distortion.any():
        plane = undistort_plane(plane, torch.from_numpy(distortion).expand(*plane.shape[:-1], 5))
    rays = np.concatenate([plane.numpy(), np.ones((*pixels.shape[:-1], 1))], -1)
    unit: Float[np.ndarray, "*p 3"] = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    return unit


@lru_cache(maxsize=4)
def _camera_rays(
    focal_px: tuple[float, ...],
    principal_px: tuple[float, ...],
    distortion: tuple[float, ...],
    width: int,
    height: int,
) -> Float32[np.ndarray, "3 h w"]:
    rays = _through(_centres(width, height), *map(np.array, (focal_px, principal_px, distortion)))
    shared = np.ascontiguousarray(np.moveaxis(rays, -1, 0), np.float32)
    shared.flags.writeable = False
    return shared


def _reduced(
    photos: Photos, i: int, longest_px: int
) -> tuple[UInt8[np.ndarray, "h w 3"], Bool[np.ndarray, "h w"]]:
    """Colours of image i, reduced by a whole number to at most `longest_px`, and which of its pixels no mask
    hides."""
    rgb, valid = photos.images.image(i), photos.images.valid(i)
    height, width = valid.shape
    reduced = _reduction(np.array([width, height]), longest_px)
    if reduced == 1:
        return rgb, valid
    size = width // reduced, height // reduced
    small: UInt8[np.ndarray, "h w 3"] = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
    share = cv2.resize(valid.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return small, share > 1 - 1e-4


def _reduction(size_px: np.ndarray, longest_px: int) -> int:
    return -(-int(size_px.max()) // longest_px)
