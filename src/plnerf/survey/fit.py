"""A catenary through measured points of one wire, robustly and in float64, with its covariance.

Letters: u horizontal unit vector along the span, n to its left, o where both are counted from (metres, z up);
the ends A and B of the stretch lie at s = 0 and s = L along u.

    q = (y0, y1, z0, z1, b)     offsets along n and heights at A and B; b = L^2 / 8p, nearly the sag

The wire's own plane is upright and goes through A and B: a steady wind that swings it shows as a wire that
bows sideways, which `residual_across_m` then tells.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import least_squares

from plnerf.errors import SurveyError
from plnerf.line.old_catenary import Catenary

LEAST_POINTS = 6
LEAST_BEND_M = 1e-6
"""b of a wire without sag, whose p would be infinite."""
ROBUST_SIGMAS = 2.5
"""Residuals beyond so many standard deviations count less (Cauchy)."""
OUTLIER_SIGMAS = 5.0
ROUNDS, SETTLED = 30, 1e-7
"""Most rounds of scales and fit, and the relative change at which they end: a deep wire is no parabola, and
comes to its points by steps."""


@dataclass(frozen=True, eq=False)
class Base:
    """Where q is counted from."""

    o: Float[np.ndarray, "2"]
    """World x and y."""
    u: Float[np.ndarray, "2"]
    length_m: float

    @property
    def n(self) -> Float[np.ndarray, "2"]:
        """To the left of u."""
        return np.array([-self.u[1], self.u[0]])

    def local(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        """s, y and z of world points."""
        flat = points[:, :2] - self.o
        return np.stack([flat @ self.u, flat @ self.n, points[:, 2]], 1)

    def curve(self, q: Float[np.ndarray, "5"]) -> Catenary:
        """The wire in the world."""
        a, b = self.o + q[0] * self.n, self.o + self.length_m * self.u + q[1] * self.n
        bend = max(float(q[4]), LEAST_BEND_M)
        return Catenary(
            (float(a[0]), float(a[1]), float(q[2])),
            (float(b[0]), float(b[1]), float(q[3])),
            self.length_m**2 / (8 * bend),
        )

    def at(self, q: Float[np.ndarray, "5"], s: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m 2"]:
        """y and z of the wire at s."""
        share, curve = s / self.length_m, self.curve(q)
        return np.stack([q[0] + (q[1] - q[0]) * share, curve.heights(share * curve.span_m)], 1)

    def by_q(self, q: Float[np.ndarray, "5"], s: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m 2 5"]:
        """Derivatives of y and z at s by q."""
        return jacobian(lambda p: self.at(p, s).ravel(), q).reshape(len(s), 2, 5)


def base_of(points: Float[np.ndarray, "m 3"]) -> Base:
    """Along the main horizontal direction of points, from the first to the last of them."""
    middle = np.median(points[:, :2], axis=0)
    u = np.linalg.svd(points[:, :2] - points[:, :2].mean(0), full_matrices=False)[2][0]
    s = (points[:, :2] - middle) @ u
    return Base(middle + s.min() * u, u, float(np.ptp(s)))


@dataclass(frozen=True, eq=False)
class CatenaryFit:
    """A wire, how well it is known, and how well its points lie on it."""

    base: Base
    q: Float[np.ndarray, "5"]
    covariance: Float[np.ndarray, "5 5"]
    """Of q, in square metres."""
    inlier: Bool[np.ndarray, " m"]
    residual_across_m: float
    """Root mean square of the inliers' horizontal distances."""
    residual_up_m: float
    end_sigma_m: tuple[float, float] = (0.0, 0.0)
    """Standard deviation of where along u each end is: of a support's place."""

    @property
    def curve(self) -> Catenary:
        """The wire between its ends."""
        return self.base.curve(self.q)

    def sigma_at(self, s: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k 2"]:
        """Standard deviations of y and z at s."""
        J = self.base.by_q(self.q, s)
        variance = np.einsum("kij,jl,kil->ki", J, self.covariance, J)
        return np.sqrt(variance)

    @property
    def sag_sigma_m(self) -> float:
        """Standard deviation of the sag, by the wire's own and by that of its ends: at a fixed p the sag goes
        with the square of the span."""
        curve = self.curve
        J = jacobian(lambda q: np.array([self.base.curve(q).sag_m]), self.q)[0]
        by_end = 2 * curve.sag_m / curve.span_m
        return float(np.sqrt(J @ self.covariance @ J + by_end**2 * np.square(self.end_sigma_m).sum()))


def fit_catenary(
    points: Float[np.ndarray, "m 3"],
    base: Base | None = None,
    sigma_m: float = 0.02,
) -> CatenaryFit:
    """The catenary that most of the points lie on; the others are told from them.

    sigma_m: least standard deviation of a point across the wire; what the points show instead wins where it
    is more.  Points are taken for independent.  Raises SurveyError for fewer than LEAST_POINTS points, or
    points at one place.
    """
    if len(points) < LEAST_POINTS:
        raise SurveyError(
            f"A catenary needs {LEAST_POINTS} points or more, but {len(points)} are given. Join the pieces "
            "of the wire, or leave it out."
        )
    base = base or base_of(points)
    local = base.local(points)
    s = local[:, 0]
    if np.ptp(s) < 1e-3:
        raise SurveyError(
            f"A catenary needs points along a span, but all {len(points)} lie within {np.ptp(s):.2g} m."
        )

    def off(q: Float[np.ndarray, "5"]) -> Float[np.ndarray, "m 2"]:
        return base.at(q, s) - local[:, 1:]

    q = _start(base, local)
    scale = np.array([np.inf, np.inf])
    for _ in range(ROUNDS):
        apart = off(q)
        # 1.4826 times the median is the standard deviation of normal errors, whatever a minority does.
        scale = np.maximum(1.4826 * np.median(np.abs(apart), axis=0), sigma_m)
        before, q = q, least_squares(
            lambda p, scale=scale: (off(p) / scale).ravel(), q, loss="cauchy", f_scale=ROBUST_SIGMAS,
            bounds=([-np.inf] * 4 + [LEAST_BEND_M], np.inf), x_scale=np.maximum(np.abs(q), 0.1),
        ).x  # fmt: skip
        if np.abs(q - before).max() <= SETTLED * np.abs(q).max():
            break
    apart = off(q)
    inlier = (np.abs(apart) <= OUTLIER_SIGMAS * scale).all(1)
    J = jacobian(lambda p: base.at(p, s[inlier]).ravel(), q).reshape(-1, 2, 5)
    rms = np.sqrt((apart[inlier] ** 2).mean(0))
    information = sum(J[:, k].T @ J[:, k] / max(rms[k], sigma_m) ** 2 for k in range(2))
    return CatenaryFit(
        base, q, np.linalg.pinv(information, hermitian=True), inlier, float(rms[0]), float(rms[1])
    )


def _start(base: Base, local: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "5"]:
    """A straight line in y and a parabola in z, by medians of absolute distances rather than squares."""
    s = local[:, 0] / base.length_m
    line = np.stack([1 - s, s], 1)
    hanging = np.stack([1 - s, s, -4 * s * (1 - s)], 1)
    y = _least_absolute(line, local[:, 1])
    z = _least_absolute(hanging, local[:, 2])
    return np.array([y[0], y[1], z[0], z[1], max(float(z[2]), 1e-3)])


def _least_absolute(A: Float[np.ndarray, "m k"], b: Float[np.ndarray, " m"]) -> Float[np.ndarray, " k"]:
    """By squares weighted anew with the inverse distance."""
    w = np.ones(len(b))
    for _ in range(20):
        root = np.sqrt(w)
        x = np.linalg.lstsq(A * root[:, None], b * root, rcond=None)[0]
        w = 1 / np.maximum(np.abs(A @ x - b), 1e-4)
    return x


def jacobian(
    function: Callable[[Float[np.ndarray, " k"]], Float[np.ndarray, " r"]], q: Float[np.ndarray, " k"]
) -> Float[np.ndarray, "r k"]:
    """By central differences, good to ten digits for what is as smooth as a catenary."""
    columns = []
    for k in range(len(q)):
        h = np.zeros(len(q))
        h[k] = 1e-5 * max(1.0, abs(q[k]))
        columns.append((function(q + h) - function(q - h)) / (2 * h[k]))
    return np.stack(columns, 1)
