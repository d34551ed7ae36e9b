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
    """theta of the same curve on another base along the same straight line, in the same direction."""
    low = float((new.a - old.a) @ old.u)
    high = low + new.length_m
    (y_A, z_A), (y_B, z_B) = curve_at(theta, old.length_m, np.array([low, high]))
    b = max(float(theta[4]), LEAST_BEND_M) * (new.length_m / old.length_m) ** 2
    return np.array([y_A, y_B, z_A, z_B, b, theta[5]])


def bend_of_sag(theta: Float[np.ndarray, "6"], L: float, sag_m: float) -> float:
    """The b with which an upright curve of these ends has a greatest vertical drop of `sag_m`."""
    if sag_m <= LEAST_BEND_M:
        return LEAST_BEND_M
    D, h, _ = plane_of(theta, L)
    return L**2 / (8 * catenary.p_of_sag(D, h, sag_m))


def vertical_sag(theta: Float[np.ndarray, "6"], L: float) -> float:
    """The greatest vertical drop below the chord: the plane's own sag, times the cosine of the swing."""
    return math.cos(float(theta[5])) * catenary.sag(*plane_of(theta, L))
