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


@njit(cache=True, error_model="numpy", forceinline=True)
@no_type_check
def distort(lens, n, u, v):
    """The lens distortion of view n at u, v in the plane at depth 1; NaN beyond what the lens can see."""
    r2 = u * u + v * v
    if r2 > 16:
        return np.nan, np.nan  # 76 degrees off the axis: no lens of this model sees it
    radial = 1 + r2 * (lens[n, 0] + r2 * (lens[n, 1] + r2 * lens[n, 4]))
    return (
        u * radial + 2 * lens[n, 2] * u * v + lens[n, 3] * (r2 + 2 * u * u),
        v * radial + 2 * lens[n, 3] * u * v + lens[n, 2] * (r2 + 2 * v * v),
    )


@njit(cache=True, error_model="numpy", forceinline=True)
@no_type_check
def project_point(views, n, x, y, z):
    """Pixel (u, v) of a point in view n, and its depth; depth -1 where it is not in the image.

    Numbers are read one by one: a row of an array as an array of its own would cost more than the projection.
    """
    R, c, size = views.R, views.centre, views.sizes
    dx, dy, dz = x - c[n, 0], y - c[n, 1], z - c[n, 2]
    depth = R[n, 2, 0] * dx + R[n, 2, 1] * dy + R[n, 2, 2] * dz
    if depth <= NEAREST:
        return 0.0, 0.0, -1.0
    u = (R[n, 0, 0] * dx + R[n, 0, 1] * dy + R[n, 0, 2] * dz) / depth
    v = (R[n, 1, 0] * dx + R[n, 1, 1] * dy + R[n, 1, 2] * dz) / depth
    u, v = distort(views.distortion, n, u, v)
    x_px, y_px = u * views.focal[n, 0] + views.principal[n, 0], v * views.focal[n, 1] + views.principal[n, 1]
    if not (0 <= x_px < size[n, 0] and 0 <= y_px < size[n, 1]):
        return 0.0, 0.0, -1.0
    return x_px, y_px, depth


@njit(cache=True, error_model="numpy")
@no_type_check
def seen_places(views, places):
    """Whether view n has a place p of places (p, 3) in its image: (n, p)."""
    out = np.zeros((len(views.R), len(places)), np.bool_)
    for n in range(len(out)):
        for p in range(len(places)):
            out[n, p] = project_point(views, n, places[p, 0], places[p, 1], places[p, 2])[2] > 0
    return out


@njit(cache=True, error_model="numpy")
@no_type_check
def lenses_of(views):
    """The views for `project_into_all`: a row for each of a camera's numbers (23, n)."""
    out = np.empty((23, len(views.R)))
    for n in range(len(views.R)):
        for i in range(3):
            out[9 + i, n] = 0.0
            for j in range(3):
                out[3 * i + j, n] = views.R[n, i, j]
                out[9 + i, n] -= views.R[n, i, j] * views.centre[n, j]
        for i in range(2):
            out[12 + i, n], out[14 + i, n] = views.focal[n, i], views.principal[n, i]
            out[21 + i, n] = views.sizes[n, i]
        for i in range(5):
            out[16 + i, n] = views.distortion[n, i]
    return out


@njit(cache=True, error_model="numpy")
@no_type_check
def project_into_all(lenses, x, y, z, pixels, scales):
    """Into pixels (n,): the pixel of a point in each view, row by row, -1 where it is not in the image.

    As `project_point` has it, but for several views at a time: without branches, and with the numbers of
    neighbouring views beside each other.  scales (n,): pixels of a unit of length there.
    """
    r00, r01, r02, r10, r11, r12 = lenses[0], lenses[1], lenses[2], lenses[3], lenses[4], lenses[5]
    r20, r21, r22, t0, t1, t2 = lenses[6], lenses[7], lenses[8], lenses[9], lenses[10], lenses[11]
    fx, fy, cx, cy, k1, k2 = lenses[12], lenses[13], lenses[14], lenses[15], lenses[16], lenses[17]
    p1, p2, k3, w, h = lenses[18], lenses[19], lenses[20], lenses[21], lenses[22]
    for n in range(len(pixels)):
        depth = r20[n] * x + r21[n] * y + r22[n] * z + t2[n]
        near = 1 / depth
        u = (r00[n] * x + r01[n] * y + r02[n] * z + t0[n]) * near
        v = (r10[n] * x + r11[n] * y + r12[n] * z + t1[n]) * near
        r2 = u * u + v * v
        radial, uv = 1 + r2 * (k1[n] + r2 * (k2[n] + r2 * k3[n])), 2 * u * v
        column = np.floor((u * radial + p1[n] * uv + p2[n] * (r2 + 2 * u * u)) * fx[n] + cx[n])
        row = np.floor((v * radial + p2[n] * uv + p1[n] * (r2 + 2 * v * v)) * fy[n] + cy[n])
        inside = (depth > NEAREST) & (r2 <= 16) & (column >= 0) & (row >= 0) & (column < w[n]) & (row < h[n])
        pixels[n] = np.int32(row * w[n] + column if inside else -1.0)
        scales[n] = fx[n] * near


@njit(cache=True, error_model="numpy")
@no_type_check
def project_across(views, n, point, on):
    """Pixel and depth of a point of a curve, the unit normal of its image, and how far `on` is along it.

    `on` is a little further on the curve; depth -1 where one of the two is not in the image.
    """
    u, v, depth = project_point(views, n, point[0], point[1], point[2])
    if depth < 0:
        return 0.0, 0.0, -1.0, 0.0, 0.0, 0.0
    u_on, v_on, depth_on = project_point(views, n, on[0], on[1], on[2])
    if depth_on < 0:
        return 0.0, 0.0, -1.0, 0.0, 0.0, 0.0
    length = max(np.hypot(u_on - u, v_on - v), 1e-12)
    return u, v, depth, -(v_on - v) / length, (u_on - u) / length, length
