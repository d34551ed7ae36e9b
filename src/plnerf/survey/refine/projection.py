"""A wire as one camera sees it, and where other wires cross its neighbourhood.

Letters: k samples along the wire; u the pixel's place relative to the principal point, over the focal length.
LineFrame.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Bool, Float

from plnerf.line.base import Base
from plnerf.line.curve import curve_at
from plnerf.ops.kernel_cache import INNER, njit
from plnerf.scene.cameras import Cameras

MOVES = 6
"""Numbers of an image's pose residual."""


@dataclass(frozen=True, eq=False)
class Projection:
    """A wire in one image."""

    s: Float[np.ndarray, " k"]
    """Along the wire's base."""
    pixel: Float[np.ndarray, "k 2"]
    tangent: Float[np.ndarray, "k 2"]
    normal: Float[np.ndarray, "k 2"]
    """Unit vectors in the image."""
    by_yz: Float[np.ndarray, "k 2"]
    """How far the curve moves along its normal when the wire moves along y, and along z: pixels per metre."""
    by_pose: Float[np.ndarray, "k 6"]
    """How far it moves along its normal by a unit of each pose residual (du, dv, roll, mu, mv, mw): the image
    moves by a pixel right, by one down, and turns by one at the focal length from its middle; what is at the
    usual distance in it moves by a pixel right, by one down, and outwards by one at the focal length from the
    middle, and what is farther by less."""
    front: Bool[np.ndarray, " k"]
    """In front of the camera."""
    good: Bool[np.ndarray, " k"]
    """Within the image and not seen end-on, too."""


class Places(NamedTuple):
    """Points of a wire and what is a step beside each, the same for all cameras."""

    s: Float[np.ndarray, " k"]
    """Along the wire's base."""
    points: Float[np.ndarray, "4 k 3"]
    """On the wire; a step on along it; a step to y, and to z."""
    step: float


def places_along(base: Base, theta: Float[np.ndarray, "6"], s: Float[np.ndarray, " k"]) -> Places:
    """A wire's points at s."""
    L = base.length_m
    step = 1e-4 * L
    here = curve_at(theta, L, s)
    on = base.place(s + step, curve_at(theta, L, s + step))
    beside = [base.place(s, here + step * axis) for axis in np.eye(2)]
    return Places(s, np.stack([base.place(s, here), on, *beside]), step)


def project_wire(
    camera: Cameras, places: Places, pose_residual: Float[np.ndarray, "6"], usual_m: float, end_on: float
) -> Projection:
    """Projects a wire.  camera: one, in float64.  pose_residual: of its image; usual_m: distance, see
    `Projection.by_pose`; end_on: sine of the angle to the line of sight below which a place is not good."""
    k = len(places.s)
    pixel, tangent, normal, by_yz = (np.empty((k, 2)) for _ in range(4))
    by_pose, front, good = np.empty((k, 6)), np.empty(k, np.bool_), np.empty(k, np.bool_)
    lens = (camera.R_scene_camera, camera.centre, camera.focal_px, camera.principal_px, camera.distortion)
    _project(
        places.points, places.step, *(part[0].numpy() for part in (*lens, camera.size_px)), pose_residual,
        usual_m, end_on, pixel, tangent, normal, by_yz, by_pose, front, good,
    )  # fmt: skip
    return Projection(places.s, pixel, tangent, normal, by_yz, by_pose, front, good)


@njit(cache=True, error_model="numpy")
@no_type_check
def _project(  # noqa: PLR0913 (a camera's and a projection's arrays, one by one)
    points, step, R, centre, focal, principal, distortion, size, pose, usual_m, end_on,
    pixel, tangent, normal, by_yz, by_pose, front, good,
):  # fmt: skip
    """Into the arrays of a `Projection`.  points, step: of `Places`; R to size: of a camera."""
    for k in range(points.shape[1]):
        x, y, depth = _seen(points[0, k], R, centre, focal, principal, distortion)
        x_on, y_on, depth_on = _seen(points[1, k], R, centre, focal, principal, distortion)
        x_y, y_y, depth_y = _seen(points[2, k], R, centre, focal, principal, distortion)
        x_z, y_z, depth_z = _seen(points[3, k], R, centre, focal, principal, distortion)
        front[k] = min(depth, depth_on, depth_y, depth_z) > 1e-6
        length = np.hypot(x_on - x, y_on - y)
        t_x, t_y = (x_on - x) / max(length, 1e-12), (y_on - y) / max(length, 1e-12)
        n_x, n_y = -t_y, t_x
        tangent[k, 0], tangent[k, 1], normal[k, 0], normal[k, 1] = t_x, t_y, n_x, n_y
        by_yz[k, 0] = ((x_y - x) * n_x + (y_y - y) * n_y) / step
        by_yz[k, 1] = ((x_z - x) * n_x + (y_z - y) * n_y) / step
        u, v = (x - principal[0]) / focal[0], (y - principal[1]) / focal[0]
        near = usual_m / depth if front[k] else 0.0
        x += pose[0] - pose[2] * v + near * (pose[3] + pose[5] * u)
        y += pose[1] + pose[2] * u + near * (pose[4] + pose[5] * v)
        pixel[k, 0], pixel[k, 1] = x, y
        by_pose[k, 0], by_pose[k, 1], by_pose[k, 2] = n_x, n_y, n_y * u - n_x * v
        by_pose[k, 3], by_pose[k, 4], by_pose[k, 5] = n_x * near, n_y * near, (n_x * u + n_y * v) * near
        square_on = focal[0] * step / (depth if front[k] else 1.0)
        inside = 0 < x < size[0] and 0 < y < size[1]
        good[k] = front[k] and inside and length > end_on * square_on


@njit(cache=True, error_model="numpy", **INNER)
@no_type_check
def _seen(point, R, centre, focal, principal, distortion):
    """Pixel and depth of a point, as `scene.cameras.project` has them."""
    d0, d1, d2 = point[0] - centre[0], point[1] - centre[1], point[2] - centre[2]
    depth = R[0, 2] * d0 + R[1, 2] * d1 + R[2, 2] * d2
    x = (R[0, 0] * d0 + R[1, 0] * d1 + R[2, 0] * d2) / depth
    y = (R[0, 1] * d0 + R[1, 1] * d1 + R[2, 1] * d2) / depth
    k1, k2, p1, p2, k3 = distortion
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    column = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    row = y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)
    return column * focal[0] + principal[0], row * focal[1] + principal[1], depth


def crossings(
    seen: Projection, others: Sequence[Projection], within_px: float, most: int, least_sine: float
) -> Float[np.ndarray, "k most"]:
    """Where other wires cross the normals of a wire: signed distances from it (px), the nearest first, NaN
    where there are fewer.

    0 stands for a wire that runs along the normal (the sine of their angle below `least_sine`), so that it is
    nowhere in particular.
    """
    if not seen.good.any():
        return np.full((len(seen.s), most), np.nan)
    low, high = seen.pixel[seen.good].min(0) - within_px, seen.pixel[seen.good].max(0) + within_px
    apart = np.full((len(seen.s), len(others) + most), np.nan)
    for k, other in enumerate(others):
        _cross(
            seen.pixel, seen.normal, seen.good, other.pixel, other.tangent, other.front, low, high,
            within_px, least_sine, apart[:, k],
        )  # fmt: skip
    order = np.argsort(np.where(np.isnan(apart), np.inf, np.abs(apart)), 1)[:, :most]
    nearest: Float[np.ndarray, "k most"] = np.take_along_axis(apart, order, 1)
    return nearest


@njit(cache=True, error_model="numpy")
@no_type_check
def _cross(  # noqa: PLR0913 (two projections' arrays, one by one)
    pixel, normal, good, other, tangent, front, low, high, within_px, least_sine, out
):
    """Into out (k,): where one other wire, samples other (n, 2), crosses: by the straight line through the
    nearest of them.  low, high: the box outside of which none is near enough."""
    some, count, spacing = np.empty(len(other), np.int64), 0, 0.0
    for n in range(len(other)):
        # A sample beyond the edge on either side, so that no crossing is lost at it.
        for m in range(max(0, n - 1), min(len(other), n + 2) if front[n] else 0):
            x, y = other[m]
            if front[m] and low[0] < x < high[0] and low[1] < y < high[1]:
                some[count] = n
                count += 1
                break
    for j in range(1, count):
        step = other[some[j]] - other[some[j - 1]]
        spacing = max(spacing, np.hypot(step[0], step[1]))
    farthest = (1.5 * within_px + spacing) ** 2
    for k in range(len(pixel) if count else 0):
        nearest, least = -1, farthest
        for n in some[: count if good[k] else 0]:
            away = (other[n, 0] - pixel[k, 0]) ** 2 + (other[n, 1] - pixel[k, 1]) ** 2
            if away < least:
                nearest, least = n, away
        if nearest < 0:
            continue
        x, y = other[nearest, 0] - pixel[k, 0], other[nearest, 1] - pixel[k, 1]
        t_x, t_y = tangent[nearest]
        sine = normal[k, 0] * t_y - normal[k, 1] * t_x
        off = (x * t_y - y * t_x) / sine if abs(sine) >= least_sine else 0.0
        if abs(off) <= within_px:
            out[k] = off
