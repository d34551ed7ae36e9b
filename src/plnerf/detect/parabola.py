"""Hanging curves as parabolas, and the odds that views give them.

Letters: the window's frame, in which lines run along +x; planes i at x_i across it.  A curve is theta =
(y_A, y_B, z_A, z_B, b, d): offset and height in the first and in the last plane, the sag b below the chord,
and how far wind blows it aside, d; y and z are quadratic in x (a parabola is within millimetres of a catenary
of the same sag).
"""

from typing import no_type_check

import numpy as np

from plnerf.detect.odds import place_odds
from plnerf.detect.views import lenses_of
from plnerf.ops.kernel_cache import njit
from plnerf.ops.threads import share


@no_type_check
def curve_points(theta, s):
    """y, z of curves theta (5, ...) at s in [0, 1] along them; shapes as NumPy broadcasts them."""
    hump = 4 * s * (1 - s)
    y = theta[0] + (theta[1] - theta[0]) * s + theta[5] * hump
    return y, theta[2] + (theta[3] - theta[2]) * s - theta[4] * hump


curve_point = njit(cache=True)(curve_points)
"""The same in kernels, for one curve and one place."""


@njit(cache=True, error_model="numpy")
@no_type_check
def odds_along(views, odds, curve, x, reach):
    """Log odds of one curve in each plane, and the number of views that see it there: (i, 2)."""
    out = np.zeros((len(x), 2))
    lenses = lenses_of(views)
    pixels, scales = np.empty(len(views.R), np.int32), np.empty(len(views.R))
    for i in range(len(x)):
        y, z = curve_point(curve, i / (len(x) - 1))
        out[i, 0], out[i, 1] = place_odds(views, odds, lenses, (x[i], y, z), reach, pixels, scales)
    return out


@njit(cache=True, error_model="numpy")
@no_type_check
def _curve_odds(views, odds, curves, x, reach, out, start, stop):
    for c in range(start, stop):
        out[c] = odds_along(views, odds, curves[c], x, reach)


@no_type_check
def curve_odds(views, odds, curves, x, reach):
    """The same of many curves: (c, i, 2)."""
    out = np.empty((len(curves), len(x), 2))
    share(_curve_odds, views, odds, curves, x, reach, out, of=len(curves))
    return out
