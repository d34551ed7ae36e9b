"""A wire: the curve it hangs in, how well that is known, where it was seen, and what holds its ends.

Letters: s along the wire's base (`base.py`), y to its left, z up; L length of the base; metres.  The curve is

    theta = (y_A, y_B, z_A, z_B, b, phi)      offsets and heights at s = 0 and s = L, b = L^2 / 8p, swing

It lies in the plane of the chord AB and the load, which is down turned by phi about the base (wind), and is
in that plane a catenary of parameter p = H/w (w with wind: the resultant).  Along the chord's direction
across the load, x = s D / L exactly, with D the chord's length across the load.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from plnerf.line import catenary
from plnerf.line.base import Base, jacobian
from plnerf.line.curve import (
    LEAST_BEND_M,
    curve_at,
    curve_by_theta,
    lowest_at,
    plane_of,
    transport,
    vertical_sag,
)
from plnerf.line.ends import Attached, End, Evidence, Open, Quantity
from plnerf.line.polylines import require_samples

Kind = Literal["phase", "shield", "neutral", "communication", "unknown"]
STRAIGHT_M = 0.1
"""Spacing of polylines: between vertices d apart a wire departs d^2 / 8p, 0.1 mm for p as small as 12 m."""


@dataclass(frozen=True, eq=False)
class Wire:
    """One wire of one span, in the LineFrame; the same from detection to report."""

    id: int
    """From 1; what the cloud's points are labelled with."""
    base: Base
    """From below its first end to below its last."""
    theta: Float[np.ndarray, "6"]
    covariance: Float[np.ndarray, "6 6"]
    """Covariance of theta; zero for a swing that was held at 0 and not measured."""
    ends: tuple[End, End]
    evidence: Evidence
    kind: Kind = "unknown"
    bundle: int | None = None
    """Number of the bundle that it belongs to; None: it hangs alone."""
    diameter_m: float | None = None
    name: str | None = None
    """Of its phase, where somebody knows it."""
    notes: tuple[str, ...] = ()
    """What a reader must know of this wire."""
    circuit: str | None = None
    """Name of its circuit, likewise."""

    def at(self, s: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m 2"]:
        """y and z at s; beyond its ends the curve goes on."""
        return curve_at(self.theta, self.base.length_m, s)

    def by_theta(self, s: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m 2 6"]:
        """Derivatives of y and z at s by theta."""
        return curve_by_theta(self.theta, self.base.length_m, s)

    def points(self, s: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m 3"]:
        """Points at s."""
        return self.base.place(s, self.at(s))

    def polyline(self, step_m: float = STRAIGHT_M) -> Float[np.ndarray, "m 3"]:
        """Points from end to end, even in s, at most `step_m` of arc apart.

        Raises SurveyError where they do not fit into memory.
        """
        length_m = self.base.length_m * self.stretch
        require_samples(length_m, step_m)
        count = max(1, math.ceil(length_m / step_m))
        return self.points(np.linspace(0.0, self.base.length_m, count + 1))

    def sigma_at(self, s: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m 2"]:
        """Standard deviations of y and z at s."""
        J = self.by_theta(s)
        return np.sqrt(np.maximum(np.einsum("mij,jl,mil->mi", J, self.covariance, J), 0.0))

    def worst_sigma(self, count: int = 20) -> float:
        """Standard deviation across the wire in its least certain direction at its least certain place."""
        J = self.by_theta(np.linspace(0.0, self.base.length_m, count))
        return float(np.sqrt(np.linalg.eigvalsh(J @ self.covariance @ J.transpose(0, 2, 1))[:, -1].max()))

    @property
    def swing_rad(self) -> float:
        """phi."""
        return float(self.theta[5])

    @property
    def swing_deg(self) -> Quantity | None:
        """phi in degrees, positive to the left of the base; None where it was held at 0, not measured."""
        if not self.theta[5] and not self.covariance[5, 5]:
            return None
        return Quantity(math.degrees(self.theta[5]), math.degrees(math.sqrt(self.covariance[5, 5])))

    @property
    def plane(self) -> tuple[float, float, float]:
        """D, h and p of the curve in its own plane, as `catenary.py` has them."""
        return plane_of(self.theta, self.base.length_m)

    @property
    def stretch(self) -> float:
        """Length of wire per length of base where that is greatest: at its steeper end."""
        D, h, p = self.plane
        x0 = catenary.lowest(D, h, p)[0]
        return D / self.base.length_m * math.cosh(max(abs(x0), abs(D - x0)) / p)

    @property
    def length_m(self) -> float:
        """Length of the wire between its ends."""
        return catenary.arc_length(*self.plane)

    @property
    def open(self) -> str | None:
        """Why it has no sag, span length and p: which of its ends no structure holds; None if none is."""
        named = zip(("first", "last"), self.ends, strict=True)
        reasons = [f"the {name} end is open ({end.reason})" for name, end in named if isinstance(end, Open)]
        return " and ".join(reasons) or None

    @property
    def sag(self) -> Quantity | None:
        """Greatest vertical drop below the chord between the attachments; None where `open` says why.

        At a fixed p the sag goes with the square of the span: so much do uncertain ends add.
        """
        if self.open:
            return None
        value, length = vertical_sag(self.theta, self.base.length_m), self.base.length_m
        J = jacobian(lambda theta: np.array([vertical_sag(theta, length)]), self.theta)[0]
        by_ends = 2 * value / length * self._end_sigma_m
        return Quantity(value, float(np.sqrt(J @ self.covariance @ J + by_ends**2)))

    @property
    def span_m(self) -> Quantity | None:
        """Horizontal distance between the attachments; None where `open` says why."""
        if self.open:
            return None
        across = self.theta[1] - self.theta[0]
        length = float(np.hypot(self.base.length_m, across))
        J = np.array([-across, across, 0, 0, 0, 0]) / length
        return Quantity(length, float(np.sqrt(J @ self.covariance @ J + self._end_sigma_m**2)))

    @property
    def arc_m(self) -> Quantity | None:
        """Length of the wire itself between the attachments; None where `open` says why."""
        if self.open:
            return None
        value, length = self.length_m, self.base.length_m
        J = jacobian(lambda theta: np.array([catenary.arc_length(*plane_of(theta, length))]), self.theta)[0]
        by_ends = value / length * self._end_sigma_m
        return Quantity(value, float(np.sqrt(J @ self.covariance @ J + by_ends**2)))

    @property
    def p_m(self) -> Quantity | None:
        """H/w between the attachments; None where `open` says why."""
        if self.open:
            return None
        p, b = self.plane[2], max(float(self.theta[4]), LEAST_BEND_M)
        return Quantity(p, p / b * float(np.sqrt(self.covariance[4, 4])))

    @property
    def sag_at_m(self) -> float:
        """s at which the curve is farthest below its chord."""
        D, h, p = self.plane
        return catenary.sag_at(D, h, p) * self.base.length_m / D

    @property
    def lowest(self) -> tuple[float, float]:
        """s and z of the lowest point between its ends."""
        L = self.base.length_m
        s = min(max(lowest_at(self.theta, L), 0.0), L)
        return s, float(self.at(np.array([s]))[0, 1])

    def drop_between(self, low: float, high: float) -> float:
        """The curve's greatest vertical drop below the chord between two places s."""
        theta = transport(self.theta, self.base, self.base.cut(low, high))
        return vertical_sag(theta, high - low)

    def on(self, base: Base) -> "Wire":
        """The same curve counted from another base of about the same direction, with its covariance."""
        theta = transport(self.theta, self.base, base)
        J = jacobian(lambda old: transport(old, self.base, base), self.theta)
        seen = self.evidence.moved(float((self.base.a - base.a) @ base.u), base.length_m)
        return replace(self, base=base, theta=theta, covariance=J @ self.covariance @ J.T, evidence=seen)

    def between(self, low: float, high: float) -> "Wire":
        """The wire between s = low and s = high of its base; its curve goes on beyond its ends as it is."""
        return self.on(self.base.cut(low, high))

    @property
    def _end_sigma_m(self) -> float:
        return math.hypot(*(end.sigma_m for end in self.ends if isinstance(end, Attached)))
