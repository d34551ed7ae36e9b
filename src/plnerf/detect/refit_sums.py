"""The normal equations of a curve's fit to ridges: derivatives, sums over each view, and what views leave.

Letters: m rows as `refit.observe` gives them, v views.  The ten columns are the curve's numbers (0 to 5),
what light from one side does (6), the shift and the turn that a view's pose gives all its ridges (7 and 8),
and the distance e itself (9).
"""

from typing import no_type_check

import numpy as np

from plnerf.ops.kernel_cache import INNER, njit

COLUMNS = 10
LEAST_SPREAD = 1e-3
"""Standard deviation of directions, in radians, below which views look from one place."""


@njit(cache=True, error_model="numpy")
@no_type_check
def design_matrix(rows, views, planes):
    """Derivatives of each row's distance by all that may move it, and that distance: (m, 10)."""
    J = np.empty((len(rows), COLUMNS))
    low, high = np.ones(views), np.zeros(views)
    for row in rows:
        n, s = int(row[5]), row[0] / (planes - 1)
        low[n], high[n] = min(low[n], s), max(high[n], s)
    light = aside(rows, planes)
    for k in range(len(rows)):
        s, e, by_y, by_z = rows[k, 0] / (planes - 1), rows[k, 1], rows[k, 3], rows[k, 4]
        n, hump = int(rows[k, 5]), 4 * s * (1 - s)
        J[k, 0], J[k, 1], J[k, 2], J[k, 3] = by_y * (1 - s), by_y * s, by_z * (1 - s), by_z * s
        J[k, 4], J[k, 5], J[k, 6], J[k, 7] = -hump * by_z, hump * by_y, light[k], 1.0
        # The turn is -1 and 1 at the ends of the stretch that the view shows.
        J[k, 8] = (s - (low[n] + high[n]) / 2) / max((high[n] - low[n]) / 2, 1e-9)
        J[k, 9] = e
    return J


@njit(cache=True, error_model="numpy")
@no_type_check
def aside(rows, planes):
    """How far from the side each row's view looks, in standard deviations of those that show the place: (m,).

    Each row holds the normal of the plane through its camera and the line.  The side is where they fix the
    line least: what moves ridges in proportion to this looks as if the line lay nearer or farther, the more
    so the less the directions differ from which views look.
    """
    normals, count, moments = np.empty((len(rows), 2)), np.zeros(planes), np.zeros((planes, 3))
    for k in range(len(rows)):
        plane, length = int(rows[k, 0]), np.hypot(rows[k, 3], rows[k, 4])
        y, z = rows[k, 3] / length, rows[k, 4] / length
        normals[k, 0], normals[k, 1] = y, z
        count[plane] += 1
        moments[plane, 0] += y * y
        moments[plane, 1] += y * z
        moments[plane, 2] += z * z
    mean = np.zeros(3)
    for i in range(planes):
        moments[i] /= max(count[i], 1.0)
        mean += moments[i]
    overall, turned = weakest(mean[0], mean[1], mean[2]), np.empty((planes, 2))
    for i in range(planes):
        yy, yz, zz = moments[i]
        angle = weakest(yy, yz, zz)
        angle -= np.pi * np.round((angle - overall) / np.pi)  # the same side in all planes
        least = (yy + zz) / 2 - np.hypot((yy - zz) / 2, yz)
        spread = np.sqrt(max(least, LEAST_SPREAD**2))
        turned[i, 0], turned[i, 1] = np.cos(angle) / spread, np.sin(angle) / spread
    out = np.empty(len(rows))
    for k in range(len(rows)):
        side = turned[int(rows[k, 0])]
        out[k] = normals[k, 0] * side[0] + normals[k, 1] * side[1]
    return out


@njit(cache=True, error_model="numpy", **INNER)
@no_type_check
def weakest(yy, yz, zz):
    """Angle of the eigenvector of the least eigenvalue of [[yy, yz], [yz, zz]]."""
    return np.arctan2(2 * yz, yy - zz) / 2 + np.pi / 2


@njit(cache=True, error_model="numpy")
@no_type_check
def sums_of_views(J, weight, view, views):
    """The weighted products of columns, summed over each view's rows: (v, 10, 10)."""
    out = np.zeros((views, COLUMNS, COLUMNS))
    for k in range(len(J)):
        n = view[k]
        for a in range(COLUMNS):
            weighted = weight[k] * J[k, a]
            for b in range(a, COLUMNS):
                out[n, a, b] += weighted * J[k, b]
    for n in range(views):
        for a in range(COLUMNS):
            for b in range(a):
                out[n, a, b] = out[n, b, a]
    return out


@njit(cache=True, error_model="numpy")
@no_type_check
def left_by_views(sums, view_px):
    """What the views say of the curve's numbers, once each has a shift and a turn of its own: (6, 10).

    A Schur complement, summed over the views; view_px: standard deviation of shifts and turns.
    """
    out = np.zeros((6, COLUMNS))
    for of_view in sums:
        a, b, d = of_view[7, 7] + 1 / view_px**2, of_view[7, 8], of_view[8, 8] + 1 / view_px**2
        determinant = a * d - b * b
        for i in range(6):
            shift = (d * of_view[i, 7] - b * of_view[i, 8]) / determinant
            turn = (a * of_view[i, 8] - b * of_view[i, 7]) / determinant
            for j in range(COLUMNS):
                out[i, j] += of_view[i, j] - shift * of_view[7, j] - turn * of_view[8, j]
    return out


@njit(cache=True, error_model="numpy")
@no_type_check
def rests(J, view, moved, sums, step, view_px):
    """Each row's distance that neither the curve's step nor its view's shift and turn explain: (m,).

    moved: (v, 2), what of the distances speaks for a shift and a turn after the step.
    """
    out, own = np.empty(len(J)), np.empty((len(sums), 2))
    for n in range(len(sums)):
        a, b, d = sums[n, 7, 7] + 1 / view_px**2, sums[n, 7, 8], sums[n, 8, 8] + 1 / view_px**2
        determinant = a * d - b * b
        own[n, 0] = (d * moved[n, 0] - b * moved[n, 1]) / determinant
        own[n, 1] = (a * moved[n, 1] - b * moved[n, 0]) / determinant
    for k in range(len(J)):
        n = view[k]
        out[k] = J[k, 9] - J[k, 7] * own[n, 0] - J[k, 8] * own[n, 1]
        for i in range(6):
            out[k] -= J[k, i] * step[i]
    return out
