"""Spherical rectification: the images of a pair resampled so that a row of one matches that row of the other.

A direction has two angles about the baseline.  Its azimuth is that of the half plane through the baseline in
which it lies, the epipolar plane, and is the same from both centres; its elevation is measured from the plane
across the baseline, towards the partner.  Rows are azimuths and columns elevations, so that an image keeps
about as many pixels as it has, whichever way the baseline runs; a common image plane (A. Fusiello, E. Trucco,
A. Verri, "A compact algorithm for rectification of stereo pairs", Machine Vision and Applications 12, 2000)
stretches oblique pairs to many times their pixels.  M. Pollefeys, R. Koch, L. Van Gool, "A simple and
efficient rectification method for general motion", ICCV 1999, do the same within the images' own planes.

Letters: b baseline; e elevation of a direction in the left image; d >= 0 the disparity, an angle: the same
point has elevation e - d in the right image; t distance along the left ray; h x w pixels, n directions.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8

from plnerf.scene.cameras import distort
from plnerf.survey.stereo.stereo_views import Picture, View


@dataclass(frozen=True, eq=False)
class Sphere:
    """The grid of angles onto which both images of a pair are resampled."""

    R: Float[np.ndarray, "3 3"]
    """Rows: the axes of the grid.  x points to the partner, z forward."""
    per_rad: Float[np.ndarray, "2"]
    """Columns per radian of elevation, and rows per radian of azimuth."""
    low: Float[np.ndarray, "2"]
    """Column and row of the left upper corner, in pixels from where both angles are zero."""
    size: tuple[int, int]
    """Columns and rows."""

    def resampled(self, one: Picture) -> tuple[UInt8[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
        """The image on the grid, and which of its pixels are valid.

        Beyond its border the image goes on as it ends, since a border to black would be matched.
        """
        x, y = self._pixels(one.view)
        grey = cv2.remap(one.grey, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        valid = cv2.remap(one.valid.astype(np.uint8), x, y, cv2.INTER_NEAREST)
        return grey.astype(np.uint8), valid > 0

    def _pixels(self, view: View) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
        """Columns and rows of the grid's pixels in an image, float32.

        OpenCV's first pixel has its centre at (0, 0).
        """
        columns, rows = self.size
        e = (np.arange(columns) + 0.5 + self.low[0]) / self.per_rad[0]
        a = (np.arange(rows) + 0.5 + self.low[1]) / self.per_rad[1]
        M = (self.R @ view.R_line_camera).T
        # Of a unit vector (sin e, cos e sin a, cos e cos a), what belongs to rows and what to columns.
        along = (M[:, :1] * np.sin(e)).astype(np.float32)
        across = (M[:, 1:2] * np.sin(a) + M[:, 2:] * np.cos(a)).astype(np.float32)
        cos_e = np.cos(e).astype(np.float32)
        x, y, z = (along[k] + across[k][:, None] * cos_e for k in range(3))
        seen = z >= view.least_cosine  # beyond, the lens's polynomial may fold back into the image
        z[~seen] = 1.0
        x, y = x / z, y / z
        if view.distortion.any():
            plane = torch.from_numpy(np.stack([x, y], -1))
            x, y = distort(plane, torch.from_numpy(view.distortion).float()).unbind(-1)
            x, y = x.numpy(), y.numpy()
        focal, middle = view.focal_px.astype(np.float32), (view.principal_px - 0.5).astype(np.float32)
        x, y = x * focal[0] + middle[0], y * focal[1] + middle[1]
        x[~seen] = -2.0  # outside of the image
        return x, y


def axes_about(x: Float[np.ndarray, "3"], forward: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Rows: axes with x along the baseline and z as near to `forward` as may be."""
    z = forward - (forward @ x) * x
    z /= np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z])


def angles(
    rays: Float[np.ndarray, "3 *n"], R: Float[np.ndarray, "3 3"]
) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
    """Elevation and azimuth of unit vectors about the axes R, as exact as `rays` are."""
    x, y, z = np.tensordot(R.astype(rays.dtype), rays, 1)
    return np.arcsin(np.clip(x, -1, 1)), np.arctan2(y, z)


def disparity_at(t: float, elevation: Float[np.ndarray, "*n"], baseline: float) -> Float[np.ndarray, "*n"]:
    """Disparity, as an angle, of points at a distance along left rays."""
    right = np.arctan2(t * np.sin(elevation) - baseline, t * np.cos(elevation))
    return elevation - right


def inverse_distance_at(
    disparity: Float[np.ndarray, "*n"], elevation: Float[np.ndarray, "*n"], baseline: float
) -> Float[np.ndarray, "*n"]:
    """1/t of left rays, by the law of sines in the triangle of both centres and the point."""
    across: Float[np.ndarray, "*n"] = np.maximum(np.cos(elevation - disparity), 1e-3)
    return np.sin(disparity) / (baseline * across)
