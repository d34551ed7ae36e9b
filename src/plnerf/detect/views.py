"""Cameras as arrays for the kernels of this room, and the projection of a point into them.

Letters: n views.  Everything in scene units, float64.
"""

from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float, Int

from plnerf.detect.reduction import reduction
from plnerf.ops.kernel_cache import njit
from plnerf.scene.cameras import Cameras

NEAREST = 1e-6
"""Least depth of a point in front of a camera, in scene units."""


class Views(NamedTuple):
    """n cameras, and where each one's pixels begin in a flat array over all of them."""

    R: Float[np.ndarray, "n 3 3"]  # scene to camera
    centre: Float[np.ndarray, "n 3"]
    focal: Float[np.ndarray, "n 2"]
    principal: Float[np.ndarray, "n 2"]
    distortion: Float[np.ndarray, "n 5"]
    sizes: Int[np.ndarray, "n 2"]
    starts: Int[np.ndarray, " n"]


def views_of(cameras: Cameras, most_px: int | None = None) -> Views:
    """Cameras as arrays; most_px: of images reduced to blocks, which count as pixels (`reduction.py`)."""
    R_camera_scene = np.ascontiguousarray(cameras.R_scene_camera.double().numpy().transpose(0, 2, 1))
    full = cameras.size_px.numpy()
    k = np.array([reduction((int(w), int(h)), most_px) if most_px else 1 for w, h in full]).reshape(-1, 1)
    sizes = -(-full // k)
    starts = np.concatenate([[0], np.cumsum(sizes.prod(1))[:-1]]).astype(np.int64)
    return Views(
        R_camera_scene,
        cameras.centre.double().numpy(),
        cameras.focal_px.double().numpy() / k,
        cameras.principal_px.double().numpy() / k,
        cameras.distortion.double().numpy(),
        sizes,
        starts,
    )


@njit(cache=True, error_model="numpy")
@no_type_check
def distort(lens, u, v):
    """The lens distortion of u, v in the plane at depth 1; NaN beyond what the lens can see."""
    r2 = u * u + v * v
    if r2 > 16:
        return np.nan, np.nan  # 76 degrees off the axis: no lens of this model sees it
    radial = 1 + r2 * (lens[0] + r2 * (lens[1] + r2 * lens[4]))
    return (
        u * radial + 2 * lens[2] * u * v + lens[3] * (r2 + 2 * u * u),
        v * radial + 2 * lens[3] * u * v + lens[2] * (r2 + 2 * v * v),
    )


@njit(cache=True, error_model="numpy")
@no_type_check
def project_point(views, n, x, y, z):
    """Pixel (u, v) of a point in view n, and its depth; depth -1 where it is not in the image."""
    R, c = views.R[n], views.centre[n]
    dx, dy, dz = x - c[0], y - c[1], z - c[2]
    depth = R[2, 0] * dx + R[2, 1] * dy + R[2, 2] * dz
    if depth <= NEAREST:
        return 0.0, 0.0, -1.0
    u = (R[0, 0] * dx + R[0, 1] * dy + R[0, 2] * dz) / depth
    v = (R[1, 0] * dx + R[1, 1] * dy + R[1, 2] * dz) / depth
    u, v = distort(views.distortion[n], u, v)
    x_px, y_px = u * views.focal[n, 0] + views.principal[n, 0], v * views.focal[n, 1] + views.principal[n, 1]
    if not (0 <= x_px < views.sizes[n, 0] and 0 <= y_px < views.sizes[n, 1]):
        return 0.0, 0.0, -1.0
    return x_px, y_px, depth


@njit(cache=True, error_model="numpy")
@no_type_check
def project_across(views, n, point, on):
    """Pixel and depth of a point of a curve, the unit normal of its image, and how far `on` is along it.

    `on` is a little further on the curve; depth -1 where one of the two is not in the image.
    """
    u, v, depth = project_point(views, n, point[0], point[1], point[2])
    u_on, v_on, depth_on = project_point(views, n, on[0], on[1], on[2])
    if depth < 0 or depth_on < 0:
        return 0.0, 0.0, -1.0, 0.0, 0.0, 0.0
    length = max(np.hypot(u_on - u, v_on - v), 1e-12)
    return u, v, depth, -(v_on - v) / length, (u_on - u) / length, length
