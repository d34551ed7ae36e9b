"""The six numbers of a wire's curve: where it is, how it depends on them, and what they are on another base.

Letters: s along the base, L its length, y to its left, z up; theta = (y_A, y_B, z_A, z_B, b, phi) as in
`wire.py`; c the chord from A to B, g the load's direction (0, sin phi, -cos phi) in (s, y, z).
"""

import math

import numpy as np
from jaxtyping import Float

from plnerf.line import catenary
from plnerf.line.base import Base, jacobian

LEAST_BEND_M = 1e-6
"""b of a wire without sag, whose p would be infinite."""
TURNS = 8
"""Steps towards where a curve passes the ends of a turned base; each gains a digit or more."""
PARALLEL = 1e-12
"""Sine of the angle within which bases count as parallel: a kilometre ends within a nanometre."""


def curve_at(theta: Float[np.ndarray, "6"], L: float, s: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m 2"]:
    """y and z at s of the curve of theta on a base of length L."""
    y_A, _, z_A, _, _, phi = theta
    D, h, p = plane_of(theta, L)
    height = catenary.heights(s * (D / L), D, h, p)
    if not phi:  # upright: y is exactly linear
        return np.stack([y_A + (theta[1] - y_A) * (s / L), z_A + height], 1)
    # c - (c . g) g, the chord across the load, at the share s / L of it; then the height against the load g.
    g = np.array([math.sin(phi), -math.cos(phi)])
    across = np.array([theta[1] - y_A, theta[3] - z_A]) + h * g
    return np.array([y_A, z_A]) + (s / L)[:, None] * across - height[:, None] * g


def curve_by_theta(
    theta: Float[np.ndarray, "6"], L: float, s: Float[np.ndarray, " m"]
) -> Float[np.ndarray, "m 2 6"]:
    """Derivatives of y and z at s by theta."""
    return jacobian(lambda other: curve_at(other, L, s).ravel(), theta).reshape(len(s), 2, 6)


def plane_of(theta: Float[np.ndarray, "6"], L: float) -> tuple[float, float, float]:
    """D, h and p in the plane of chord and load: c = (L, y, z), h = -c . g, D across the load."""
    y, z, phi = float(theta[1] - theta[0]), float(theta[3] - theta[2]), float(theta[5])
    h = z * math.cos(phi) - y * math.sin(phi)
    D = math.sqrt(max(L**2 + y**2 + z**2 - h**2, 0.0)) if phi else math.hypot(L, y)
    return D, h, L**2 / (8 * max(float(theta[4]), LEAST_BEND_M))


def transport(theta: Float[np.ndarray, "6"], old: Base, new: Base) -> Float[np.ndarray, "6"]:
    """theta of the same curve on another base, which runs in about the same direction.

    Exact where the bases are parallel, however far apart.  On a base turned by a, the load has a part along
    it that theta cannot say: with L = 100 m, b = 2 m, 20 degrees of swing and a = 3 degrees the curve
    moves by 4 mm.
    """
    L, shift = old.length_m, old.a - new.a
    along, aside = np.array([old.u, old.n]) @ new.u, np.array([old.u, old.n]) @ new.n
    t = np.array([0.0, new.length_m])
    s = (t - shift @ new.u) / along[0]
    for _ in range(TURNS if abs(along[1]) > PARALLEL else 0):
        s = (t - shift @ new.u - along[1] * curve_at(theta, L, s)[:, 0]) / along[0]
    y, z = curve_at(theta, L, s).T
    y = shift @ new.n + s * aside[0] + y * aside[1]
    b = max(float(theta[4]), LEAST_BEND_M) * (new.length_m / L) ** 2
    swing = math.atan2(math.sin(theta[5]) * aside[1], math.cos(theta[5]))
    return np.array([y[0], y[1], z[0], z[1], b, swing])


def bend_of_sag(theta: Float[np.ndarray, "6"], L: float, sag_m: float) -> float:
    """The b with which a curve of these ends and this swing has a greatest vertical drop of `sag_m`."""
    if sag_m <= LEAST_BEND_M:
        return LEAST_BEND_M
    D, h, _ = plane_of(theta, L)
    return L**2 / (8 * catenary.p_of_sag(D, h, sag_m / math.cos(float(theta[5]))))


def vertical_sag(theta: Float[np.ndarray, "6"], L: float) -> float:
    """The greatest vertical drop below the chord: the plane's own sag, times the cosine of the swing."""
    return math.cos(float(theta[5])) * catenary.sag(*plane_of(theta, L))


def lowest_at(theta: Float[np.ndarray, "6"], L: float) -> float:
    """s of the lowest point of the curve, which may lie beyond its ends.

    z grows along the chord's part across the load, by z_B - z_A - h cos(phi) over all, and by cos(phi) times
    the height against the load: where these two slopes cancel.
    """
    D, h, p = plane_of(theta, L)
    upright = math.cos(theta[5])
    slope = float(theta[3] - theta[2] - h * upright) / (D * upright)
    return (catenary.lowest(D, h, p)[0] - p * math.asinh(slope)) * L / D
