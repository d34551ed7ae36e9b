"""Hanging curves as parabolas, and the odds that views give them.

Letters: the window's frame, in which lines run along +x; planes i at x_i across it.  A curve is theta =
(y_A, y_B, z_A, z_B, b, d): offset and height in the first and in the last plane, the sag b below the chord,
and how far wind blows it aside, d; y and z are quadratic in x (a parabola is within millimetres of a catenary
of the same sag).
"""

import math
from typing import NamedTuple, no_type_check

import numpy as np

from plnerf.detect.line_ridges import turned
from plnerf.detect.nearest import STEPS
from plnerf.detect.odds import place_odds, shown_at
from plnerf.detect.views import lenses_of, project_across, project_into_all
from plnerf.ops.kernel_cache import njit
from plnerf.ops.threads import share


class DirectedOdds(NamedTuple):
    """How the directions of ridges tell a wire's from others."""

    turn_rad: float
    """A wire's ridge runs as the wire does, to within this angle,"""
    shown: float
    """with this probability,"""
    chance: float
    """and another one with this."""
    end_on: float
    """Sine of the angle between curve and line of sight below which the way it runs in the image says
    nothing."""


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
def odds_directed(views, odds, tangents, curve, x, directed):
    """The same within the sharp radius, where it counts too whether ridges run as the curve does.

    tangents: of the pixels; directed: `DirectedOdds`.  A ridge that runs so has the density of all ridges
    times `chance`.
    """
    out = np.zeros((len(x), 2))
    lenses, radius = lenses_of(views), odds.sharp_px
    pixels, scales = np.empty(len(views.R), np.int32), np.empty(len(views.R))
    step, hidden = 1e-3, np.exp(odds.missed)
    likelier = (directed.shown / directed.chance, (1 - directed.shown) / (1 - directed.chance))
    for i in range(len(x)):
        s = i / (len(x) - 1)
        y, z = curve_point(curve, s)
        y_on, z_on = curve_point(curve, s + step)
        on = (x[i] + step * (x[-1] - x[0]), y_on, z_on)
        along = np.sqrt((on[0] - x[i]) ** 2 + (y_on - y) ** 2 + (z_on - z) ** 2)
        project_into_all(lenses, x[i], y, z, pixels, scales)
        finest = max([0.0, *[scales[n] for n in range(len(pixels)) if pixels[n] >= 0]])
        for n in range(len(pixels)):
            if pixels[n] < 0 or scales[n] < odds.coarsest * finest:
                continue
            out[i, 1] += 1
            pixel = views.starts[n] + pixels[n]
            if odds.free[pixel] > STEPS * radius:
                out[i, 0] += odds.missed if odds.ridge[pixel] > STEPS * radius else 0.0
                continue
            shown = shown_at(views, odds, n, pixels[n], radius)
            _, _, depth, nx, ny, length = project_across(views, n, (x[i], y, z), on)
            if depth > 0 and length >= directed.end_on * along * scales[n]:
                runs = runs_along(views, odds, tangents, n, pixels[n], np.arctan2(-nx, ny), directed.turn_rad)
                ratio = likelier[0] if runs else likelier[1]
                shown = np.log((np.exp(shown) - hidden) * ratio + hidden)
            out[i, 0] += shown
    return out


@njit(cache=True, error_model="numpy")
@no_type_check
def runs_along(views, odds, tangents, n, pixel, direction, turn_rad):
    """Whether a free ridge within the sharp radius of a pixel of view n has a direction, about."""
    w, h = views.sizes[n]
    row, column, reach = pixel // w, pixel % w, math.ceil(odds.sharp_px)
    for r in range(max(0, row - reach), min(h, row + reach + 1)):
        for c in range(max(0, column - reach), min(w, column + reach + 1)):
            k = views.starts[n] + r * w + c
            near = (r - row) ** 2 + (c - column) ** 2 <= (odds.sharp_px + 1 / STEPS) ** 2
            if near and odds.free[k] == 0 and turned(tangents[k], direction) <= turn_rad:
                return True
    return False


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
