"""The catenary in a plane: the curve of a wire under an even load, as functions of plain numbers.

Letters: the curve begins at the origin and ends at (D, h); x is measured across the load, heights against
it; p = H/w, tension across the load over load per length.  With all lengths in one unit,

    height(x) = h0 + p (cosh((x - x0) / p) - 1)          lowest point (x0, h0), which may lie outside [0, D]
"""

import math

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq

from plnerf.errors import ConfigError


def lowest(D: float, h: float, p: float) -> tuple[float, float]:
    """x0 and h0, from h = 2 p sinh(D/2p) sinh((D/2 - x0)/p)."""
    x0 = D / 2 - p * math.asinh(h / (2 * p * math.sinh(D / (2 * p))))
    return x0, -2 * p * math.sinh(x0 / (2 * p)) ** 2


def heights(x: Float[np.ndarray, " n"], D: float, h: float, p: float) -> Float[np.ndarray, " n"]:
    """Heights at x, as a product: above a far lowest point they are differences of large numbers."""
    x0, _ = lowest(D, h, p)
    height: Float[np.ndarray, " n"] = 2 * p * np.sinh(x / (2 * p)) * np.sinh((x / 2 - x0) / p)
    return height


def sag(D: float, h: float, p: float) -> float:
    """The greatest drop along the load below the chord, reached where the curve's slope is the chord's."""
    x = lowest(D, h, p)[0] + p * math.asinh(h / D)
    return h / D * x - float(heights(np.array([x]), D, h, p)[0])


def sag_at(D: float, h: float, p: float) -> float:
    """The x at which the sag is reached."""
    return lowest(D, h, p)[0] + p * math.asinh(h / D)


def arc_length(D: float, h: float, p: float) -> float:
    """Length of the wire: p (sinh((D - x0)/p) + sinh(x0/p)), as a product."""
    x0, _ = lowest(D, h, p)
    return 2 * p * math.sinh(D / (2 * p)) * math.cosh((D / 2 - x0) / p)


def p_of_sag(D: float, h: float, sag_m: float) -> float:
    """The parameter p of the curve whose greatest drop below its chord is `sag_m`.

    Sag falls strictly with p, from any depth to nothing, so the root is unique.  Raises ConfigError for a sag
    that is not positive.
    """
    if not sag_m > 0:
        raise ConfigError(f"A conductor's sag must be greater than 0 m, got {sag_m}. Give a positive sag.")
    guess = D**2 / (8 * sag_m)  # the parabola's answer
    low, high = guess / 2, guess * 2
    while sag(D, h, low) < sag_m:
        low /= 1.5
    while sag(D, h, high) > sag_m:
        high *= 1.5
    root = brentq(lambda p: sag(D, h, p) - sag_m, low, high, xtol=1e-12 * guess, rtol=1e-14)
    return float(root)
