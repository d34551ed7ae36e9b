"""Least-squares fit of a curve to the ridges: Gauss-Newton on distances in pixels, with its covariance.

Letters as in `parabola.py`.  One observation is one view's ridge in one plane: its signed distance e (px)
across the projected curve, and the derivatives of that distance by y and z.
"""

from typing import no_type_check

import numpy as np
from jaxtyping import Float

from plnerf.detect.candidate import Candidate
from plnerf.detect.config import RefitConfig
from plnerf.detect.parabola import curve_point
from plnerf.detect.views import Views, project_across, project_point
from plnerf.ops.kernel_cache import njit, prange


def refit(
    views: Views,
    responses: Float[np.ndarray, " p"],
    theta: Float[np.ndarray, "5"],
    x: Float[np.ndarray, " i"],
    min_response: float,
    config: RefitConfig,
) -> Candidate | None:
    """The curve where the ridges near it are; None where hardly any are seen."""
    s = np.linspace(0, 1, len(x))
    for window in config.windows_px:
        rows = observe(views, responses, theta, x, window, min_response, config.end_on)
        along = s[rows[:, 0].astype(np.int64)]
        e, g_y, g_z = rows[:, 1], rows[:, 3], rows[:, 4]
        J = np.stack(
            [g_y * (1 - along), g_y * along, g_z * (1 - along), g_z * along, -4 * along * (1 - along) * g_z],
            1,
        )
        weight = rows[:, 2] / (1 + (e / max(1.0, window / 3)) ** 2)  # Cauchy: the far ones are other lines'
        if len(rows) < config.min_rows:
            return None
        rms = float(np.sqrt((weight * e**2).sum() / weight.sum()))
        weight /= max(config.sigma_px, rms) ** 2 * config.planes_alike
        information = (J * weight[:, None]).T @ J + np.eye(5) / config.prior**2
        theta = theta + np.linalg.solve(information, (J * weight[:, None]).T @ e)
    return Candidate(theta, np.linalg.inv(information), rms, images=len(np.unique(rows[:, 5])))


@njit(cache=True, error_model="numpy")
@no_type_check
def observe(views, responses, theta, x, window_px, min_response, end_on):
    """Rows (plane, e, response, de/dy, de/dz, view): the strongest ridge near the curve in each view."""
    out = np.empty((len(x) * len(views.R), 6))
    count = 0
    tiny = 1e-4 * (x[-1] - x[0])
    for i in range(len(x)):
        s = i / (len(x) - 1)
        y, z = curve_point(theta, s)
        y_on, z_on = curve_point(theta, s + 1e-4)
        for n in range(len(views.R)):
            u, v, depth, nx, ny, length = project_across(views, n, (x[i], y, z), (x[i] + tiny, y_on, z_on))
            if depth < 0 or length * depth < end_on * tiny * views.focal[n, 0]:
                continue
            u_y, v_y, depth_y = project_point(views, n, x[i], y + tiny, z)
            u_z, v_z, depth_z = project_point(views, n, x[i], y, z + tiny)
            if depth_y < 0 or depth_z < 0:
                continue
            best, e = 0.0, 0.0
            w, h = views.sizes[n]
            for k in range(-2 * window_px, 2 * window_px + 1):
                column, row = int(u + 0.5 * k * nx), int(v + 0.5 * k * ny)
                if column < 0 or row < 0 or column >= w or row >= h:
                    continue
                near = 1 - 0.25 * abs(k) / window_px
                response = responses[views.starts[n] + row * w + column] * near
                if response > best:
                    best, e = response, (column + 0.5 - u) * nx + (row + 0.5 - v) * ny
            if best < min_response:
                continue
            out[count, 0], out[count, 1], out[count, 2] = i, e, best
            out[count, 3] = ((u_y - u) * nx + (v_y - v) * ny) / tiny
            out[count, 4] = ((u_z - u) * nx + (v_z - v) * ny) / tiny
            out[count, 5] = n
            count += 1
    return out[:count]


@njit(cache=True, parallel=True)
@no_type_check
def mask_ridges(views, theta, x, radius_px, masks):
    """Adds 1 to the pixels along a curve: their ridges are its own."""
    for n in prange(len(views.R)):
        w, h = views.sizes[n]
        mine = np.zeros((h, w), np.uint8)
        for i in range(len(x)):
            y, z = curve_point(theta, i / (len(x) - 1))
            u, v, depth = project_point(views, n, x[i], y, z)
            if depth < 0:
                continue
            for row in range(max(0, int(v) - radius_px), min(h, int(v) + radius_px + 1)):
                for column in range(max(0, int(u) - radius_px), min(w, int(u) + radius_px + 1)):
                    mine[row, column] = 1
        for row in range(h):
            for column in range(w):
                masks[views.starts[n] + row * w + column] += mine[row, column]
