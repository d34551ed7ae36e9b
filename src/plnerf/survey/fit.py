"""Fits a wire to measured points on it: robustly, in float64, with the covariance of the curve.

Letters: s along the base, y to its left, z up (metres); m points; theta as in `line/wire.py`.  A steady wind
shows as points that bow sideways, and is its last number, the swing.  What wind is likely is a prior: of a
taut wire, or of points too few to show a bow, the swing stays near 0 and says how uncertain it is.
"""

import numpy as np
from jaxtyping import Bool, Float
from numpy.polynomial.legendre import Legendre, legvander
from scipy.optimize import least_squares

from plnerf.errors import SurveyError
from plnerf.line.base import Base, base_of, jacobian
from plnerf.line.curve import LEAST_BEND_M, curve_at
from plnerf.line.ends import Evidence, Open
from plnerf.line.wire import Wire
from plnerf.survey.config_wires import UNKNOWNS, FitConfig

NOT_KNOWN = Open("not known yet")
LEFT_BY_CURVE = (3, 4)
"""Orders of the Legendre polynomials along a wire that no curve of it follows."""
CERTAIN_SIGMAS = 2.0
"""Least of these that counts, in standard deviations of what chance leaves."""
ASIDE, UPWARD = np.array([1.0, 1, 0, 0, 0, 0]), np.array([0.0, 0, 1, 1, 0, 0])
"""How theta changes where a whole wire shifts by a metre."""


def fit_wire(
    points: Float[np.ndarray, "m 3"], base: Base | None = None, config: FitConfig = FitConfig()
) -> tuple[Wire, Bool[np.ndarray, " m"]]:
    """The wire that most of the points lie on, and which points those are.

    base: where the wire begins and ends; from the first to the last point where left out.  The wire's id is 0
    and its ends are open until a caller knows better.  Its covariance holds the points' scatter, as if they
    were independent, and what the curve does not follow (`_of_misfit`).  Raises SurveyError
    for too few points, or for points at one place.
    """
    if len(points) < config.min_points:
        raise SurveyError(
            f"A wire needs {config.min_points} points or more, but {len(points)} are given. Join the pieces "
            "of the wire, or leave it out."
        )
    base = base or base_of(points)
    L = base.length_m
    local = base.local(points) if L else np.zeros((len(points), 3))
    s = local[:, 0]
    if np.ptp(s) < 1e-3:
        raise SurveyError(
            f"A wire needs points along a span, but all {len(points)} lie within {np.ptp(s):.2g} m."
        )

    def residual(q: Float[np.ndarray, "6"]) -> Float[np.ndarray, "m 2"]:
        return curve_at(q, L, s) - local[:, 1:]

    swing, most = np.radians([config.swing_deg, config.max_swing_deg])
    bounds = np.array([[-np.inf] * 4 + [LEAST_BEND_M, -most], [np.inf] * 5 + [most]])
    q = _start(L, local)
    scale = np.array([np.inf, np.inf])
    for _ in range(config.max_rounds):
        apart = residual(q)
        # 1.4826 times the median is the standard deviation of normal errors, whatever a minority does.
        scale = np.maximum(1.4826 * np.median(np.abs(apart), axis=0), config.sigma_m)
        before, q = q, least_squares(
            lambda p, scale=scale: np.append(residual(p) / scale, p[5] / swing), q, loss="cauchy",
            f_scale=config.robust_sigmas, bounds=bounds, x_scale=np.maximum(np.abs(q), 0.1),
        ).x  # fmt: skip
        if np.abs(q - before).max() <= config.settled * np.abs(q).max():
            break
    apart = residual(q)
    inlier: Bool[np.ndarray, " m"] = (np.abs(apart) <= config.outlier_sigmas * scale).all(1)
    across, up = np.sqrt((apart[inlier] ** 2).mean(0))
    J = jacobian(lambda p: residual(p)[inlier].ravel(), q).reshape(-1, 2, UNKNOWNS)
    information = np.diag([0.0] * 5 + [swing**-2]) + sum(
        J[:, k].T @ J[:, k] / max(rms, config.sigma_m) ** 2 for k, rms in enumerate((across, up))
    )
    covariance = np.linalg.pinv(information, hermitian=True)
    misfit = _of_misfit(q, s[inlier] / L, apart[inlier], config)
    # Wind is no less likely for points that a curve does not follow: they make no swing less certain than it.
    room = max(swing**2 - covariance[5, 5], 0.0)
    limit = np.append(np.ones(5), min(1.0, np.sqrt(room / max(misfit[5, 5], LEAST_BEND_M**2))))
    covariance = covariance + misfit * np.outer(limit, limit)
    evidence = Evidence(
        f"{inlier.sum():,} points", int(inlier.sum()),
        residual_across_m=float(across), residual_up_m=float(up),
    )  # fmt: skip
    return Wire(0, base, q, covariance, (NOT_KNOWN, NOT_KNOWN), evidence), inlier


def _of_misfit(
    q: Float[np.ndarray, "6"], t: Float[np.ndarray, " m"], apart: Float[np.ndarray, "m 2"], config: FitConfig
) -> Float[np.ndarray, "6 6"]:
    """Covariance of what the wire departs from its curve: gusts, a bow that is no plane curve's.

    t: share of the length.  The curve follows its points up to a parabola, so that what it leaves begins with
    the Legendre polynomials P3 and P4: least in the middle, greatest at the ends.  What the points show of
    each beyond chance, where that is certain, counts as deviations of the ends against or with each other; of
    P4 also of the middle against them.
    """
    found = np.zeros((UNKNOWNS, UNKNOWNS))
    if len(t) <= LEFT_BY_CURVE[-1] + 1:
        return found
    P = legvander(2 * (t - t.min()) / np.ptp(t) - 1, LEFT_BY_CURVE[-1])
    shown = np.linalg.lstsq(P, apart, rcond=None)[0]
    scatter = np.maximum(((apart - P @ shown) ** 2).sum(0) / (len(t) - P.shape[1]), config.sigma_m**2)
    by_chance = np.diag(np.linalg.pinv(P.T @ P, hermitian=True))[:, None] * scatter
    certain = shown**2 > CERTAIN_SIGMAS**2 * by_chance
    variance = np.where(certain, shown**2 - by_chance, 0.0)[list(LEFT_BY_CURVE)]
    for order, (across, up) in zip(LEFT_BY_CURVE, variance, strict=True):
        first = (-1.0) ** order
        bow = float(Legendre.basis(order)(0.0)) - (1.0 + first) / 2  # of the middle against the ends
        y = np.array([first, 1, 0, 0, 0, bow / max(float(q[4]), LEAST_BEND_M)])
        z = np.array([0, 0, first, 1, -bow, 0])
        # P3 is 0 in the middle, but nearly half its greatest beside it: its mean square counts everywhere.
        everywhere = 1.0 / (2 * order + 1) if order % 2 else 0.0
        found += (1 - everywhere) * (across * np.outer(y, y) + up * np.outer(z, z))
        found += everywhere * (across * np.outer(ASIDE, ASIDE) + up * np.outer(UPWARD, UPWARD))
    return found


def _start(L: float, local: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "6"]:
    """Upright: a line in y and a parabola in z, which minimise absolute distances rather than squares."""
    s = local[:, 0] / L
    line = np.stack([1 - s, s], 1)
    hanging = np.stack([1 - s, s, -4 * s * (1 - s)], 1)
    y = _least_absolute(line, local[:, 1])
    z = _least_absolute(hanging, local[:, 2])
    return np.array([y[0], y[1], z[0], z[1], max(float(z[2]), 1e-3), 0.0])


def _least_absolute(A: Float[np.ndarray, "m k"], b: Float[np.ndarray, " m"]) -> Float[np.ndarray, " k"]:
    """Least squares, weighted anew with the inverse of the distances."""
    w = np.ones(len(b))
    for _ in range(20):
        root = np.sqrt(w)
        x = np.linalg.lstsq(A * root[:, None], b * root, rcond=None)[0]
        w = 1 / np.maximum(np.abs(A @ x - b), 1e-4)
    return x
