"""A conductor hanging under its own weight between two points.

Letters: A, B attachment points in the world frame (metres, z up); s horizontal distance from A towards B;
L horizontal distance and h height difference B - A; p = horizontal tension / weight per length, in metres.

    z(s) = z0 + p (cosh((s - s0) / p) - 1)          lowest point (s0, z0), which may lie outside the span
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq

from plnerf.errors import ConfigError

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Catenary:
    """The curve of parameter `p_m` through `a` and `b` (world, metres)."""

    a: Point
    b: Point
    p_m: float

    @property
    def span_m(self) -> float:
        """L, the horizontal distance between the attachment points."""
        return math.hypot(self.b[0] - self.a[0], self.b[1] - self.a[1])

    @property
    def direction(self) -> tuple[float, float]:
        """Horizontal unit vector from A towards B."""
        return (self.b[0] - self.a[0]) / self.span_m, (self.b[1] - self.a[1]) / self.span_m

    @property
    def s0_m(self) -> float:
        """Horizontal distance from A to the lowest point: from h = 2 p sinh(L/2p) sinh((L/2 - s0)/p)."""
        rise = self.b[2] - self.a[2]
        half = self.span_m / 2
        return half - self.p_m * math.asinh(rise / (2 * self.p_m * math.sinh(half / self.p_m)))

    @property
    def z0_m(self) -> float:
        """Height of the lowest point."""
        return self.a[2] - 2 * self.p_m * math.sinh(self.s0_m / (2 * self.p_m)) ** 2

    @property
    def lowest(self) -> Point:
        """The lowest point of the whole curve (world, metres)."""
        ux, uy = self.direction
        return self.a[0] + ux * self.s0_m, self.a[1] + uy * self.s0_m, self.z0_m

    @property
    def sag_m(self) -> float:
        """Greatest vertical drop below the chord AB, reached where the curve's slope is the chord's."""
        slope = (self.b[2] - self.a[2]) / self.span_m
        s = self.s0_m + self.p_m * math.asinh(slope)
        return self.a[2] + slope * s - float(self.heights(np.array([s]))[0])

    @property
    def length_m(self) -> float:
        """Arc length between the attachment points: p (sinh((L - s0)/p) + sinh(s0/p))."""
        p, s0 = self.p_m, self.s0_m
        return p * (math.sinh((self.span_m - s0) / p) + math.sinh(s0 / p))

    def heights(self, s_m: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """z at horizontal distances s from A; cosh(u) - 1 as 2 sinh(u/2)^2 loses no digits for flat wires."""
        return self.z0_m + 2 * self.p_m * np.sinh((s_m - self.s0_m) / (2 * self.p_m)) ** 2

    def points(self, s_m: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 3"]:
        """World points at horizontal distances s from A."""
        ux, uy = self.direction
        return np.stack([self.a[0] + ux * s_m, self.a[1] + uy * s_m, self.heights(s_m)], axis=1)

    def polyline(self, step_m: float) -> Float[np.ndarray, "n 3"]:
        """Points from A to B, evenly spaced horizontally, at most `step_m` of arc apart."""
        steepest = math.cosh(max(abs(self.s0_m), abs(self.span_m - self.s0_m)) / self.p_m)
        count = max(1, math.ceil(self.span_m * steepest / step_m))
        return self.points(np.linspace(0.0, self.span_m, count + 1))


def hang(a: Point, b: Point, sag_m: float) -> Catenary:
    """The catenary between `a` and `b` whose greatest drop below the chord is `sag_m`.

    Sag falls strictly with p, from any depth to nothing, so the root is unique.
    """
    if not sag_m > 0:
        raise ConfigError(f"A conductor's sag must be greater than 0 m, got {sag_m}. Give a positive sag.")
    guess = Catenary(a, b, 1.0).span_m ** 2 / (8 * sag_m)  # the parabola's answer

    def excess(p_m: float) -> float:
        return Catenary(a, b, p_m).sag_m - sag_m

    low, high = guess / 2, guess * 2
    while excess(low) < 0:
        low /= 1.5
    while excess(high) > 0:
        high *= 1.5
    return Catenary(a, b, float(brentq(excess, low, high, xtol=1e-12 * guess, rtol=1e-14)))
