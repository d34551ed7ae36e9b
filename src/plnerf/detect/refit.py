"""Least-squares fit of a curve to the ridges: Gauss-Newton on distances in pixels, with its covariance.

Letters as in `parabola.py`.  One observation is one view's ridge in one plane: its signed distance e (px)
across the projected curve, and the derivatives of that distance by y and z.  m rows, v views.
"""

from collections.abc import Sequence
from typing import no_type_check

import numpy as np
from jaxtyping import Float

from plnerf.detect.candidate import Candidate
from plnerf.detect.config import RefitConfig
from plnerf.detect.line_ridges import LineRidges, turned
from plnerf.detect.parabola import curve_point
from plnerf.detect.refit_sums import design_matrix, left_by_views, rests, sums_of_views
from plnerf.detect.views import Views, project_across, project_point
from plnerf.ops.kernel_cache import njit


def refit(
    views: Views,
    ridges: LineRidges,
    theta: Float[np.ndarray, "6"],
    x: Float[np.ndarray, " i"],
    min_response: float,
    config: RefitConfig,
) -> Candidate | None:
    """The curve where the ridges near it are; None where hardly any are seen.

    A pose that is off moves a view's ridges together: each view has a shift and a turn of its own, random
    ones of a standard deviation that is learnt from the views.  What remains is each ridge's own noise.
    Light from one side moves the ridges of all views, the more so the farther they look from the side, which
    no number of them averages out: the covariance says how far that may move the curve.
    """
    count, turn_rad = len(views.R), np.radians(config.turn_deg)
    view_px, noise_px = config.view_px[-1], 0.0
    for window in config.windows_px:
        rows = observe(views, ridges, theta, x, window, min_response, config.end_on, turn_rad)
        if len(rows) < config.min_rows:
            return None
        view, e = rows[:, 5].astype(np.int64), rows[:, 1]
        J = design_matrix(rows, count, len(x))
        weight = rows[:, 2] / (1 + (e / max(1.0, window / 3)) ** 2)  # Cauchy: the far ones are other lines'
        rms = float(np.sqrt((weight * e**2).sum() / weight.sum()))
        weight /= max(config.sigma_px, noise_px or rms) ** 2 * config.planes_alike
        sums = sums_of_views(J, weight, view, count)
        left = left_by_views(sums, view_px)
        calm = 1 / (config.swing_rad * max(abs(theta[4]), config.prior**2)) ** 2
        information = left[:, :6] + np.diag([config.prior**-2.0] * 5 + [calm])
        step = np.linalg.solve(information, left[:, 9] - np.eye(6)[5] * calm * theta[5])
        theta = theta + step
        moved = sums[:, 7:9, 9] - sums[:, 7:9, :6] @ step
        rest = rests(J, view, moved, sums, step, view_px)
        noise_px = float(np.sqrt((weight * rest**2).sum() / weight.sum()))
        view_px = likeliest(sums[:, 7:9, 7:9], moved, config.view_px)
    by_light = config.bias_px * np.linalg.solve(information, left[:, 6])
    covariance = np.linalg.inv(information) + np.outer(by_light, by_light)
    return Candidate(theta, covariance, rms, images=len(np.unique(view)))


def likeliest(
    information: Float[np.ndarray, "v 2 2"], moved: Float[np.ndarray, "v 2"], choices: Sequence[float]
) -> float:
    """The standard deviation of random effects under which what they explain is likeliest.

    information: Z^T W Z of each view's effects; moved: its Z^T W r, r the residuals without them.
    """
    variance = np.square(choices)[:, None]
    a, b, d = information[:, 0, 0], information[:, 0, 1], information[:, 1, 1]
    # For all choices at once, r^T (Z^T W Z + 1 / sigma^2)^-1 r and its determinant, written out.
    own_a, own_d = a + 1 / variance, d + 1 / variance
    r0, r1 = moved.T
    determinant = own_a * own_d - b * b
    explained = (own_d * r0**2 - 2 * b * r0 * r1 + own_a * r1**2) / determinant
    likelihood = (explained - np.log(variance**2 * determinant)).sum(1)
    return choices[int(np.argmax(likelihood))]


@njit(cache=True, error_model="numpy")
@no_type_check
def observe(views, ridges, theta, x, window_px, min_response, end_on, turn_rad):
    """Rows (plane, e, response, de/dy, de/dz, view): the strongest ridge near the curve in each view.

    Of those that run as it does, to within `turn_rad`.
    """
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
            best, e, tangent = 0.0, 0.0, np.arctan2(-nx, ny)
            w, h = views.sizes[n]
            for k in range(-2 * window_px, 2 * window_px + 1):
                column, row = int(u + 0.5 * k * nx), int(v + 0.5 * k * ny)
                if column < 0 or row < 0 or column >= w or row >= h:
                    continue
                near = 1 - 0.25 * abs(k) / window_px
                pixel = views.starts[n] + row * w + column
                response = ridges.response[pixel] * near
                if response > best and turned(ridges.tangent[pixel], tangent) <= turn_rad:
                    best, e = response, (column + 0.5 - u) * nx + (row + 0.5 - v) * ny
            if best < min_response:
                continue
            out[count, 0], out[count, 1], out[count, 2] = i, e, best
            out[count, 3] = ((u_y - u) * nx + (v_y - v) * ny) / tiny
            out[count, 4] = ((u_z - u) * nx + (v_z - v) * ny) / tiny
            out[count, 5] = n
            count += 1
    return out[:count]
