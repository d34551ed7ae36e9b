"""The curve of a true wire: of stated numbers, or through the vertices of a polyline, in any frame.

Letters: v vertices; s, y, z as in a wire's base; theta as in `line/wire.py`.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from plnerf.capture.similarity import Similarity
from plnerf.line.base import Base
from plnerf.line.curve import LEAST_BEND_M, curve_at
from plnerf.line.ends import Attached, End
from plnerf.line.wire import Wire

UPRIGHT_M = 5e-4
"""A polyline within this distance of an upright catenary hangs upright: a swing would fit its rounding."""
MOST_LEAN = 1e-12
"""1 - cosine of the angle by which a motion may lean and still keep what is upright so: 1e-6 rad."""


def theta_of(line: Float[np.ndarray, "v 3"], base: Base) -> Float[np.ndarray, "6"]:
    """The catenary nearest to the vertices: upright where that fits, else swung."""
    upright = _fitted(line, base, swings=False)
    if departure_m(line, base, upright) <= UPRIGHT_M:
        return upright
    swung = _fitted(line, base, swings=True)
    return swung if departure_m(line, base, swung) < departure_m(line, base, upright) else upright


def departure_m(line: Float[np.ndarray, "v 3"], base: Base, theta: Float[np.ndarray, "6"]) -> float:
    """Greatest distance of a vertex from the curve at the same place along the base."""
    local = base.local(line)
    off = curve_at(theta, base.length_m, local[:, 0]) - local[:, 1:]
    return float(np.hypot(off[:, 0], off[:, 1]).max())


def moved(wire: Wire, motion: Similarity) -> Wire:
    """The wire in another frame.

    Exact where both frames have the same vertical.  Else its load leans along the line too, which no
    catenary between the same ends has: it is the nearest one, to the third order of the lean.
    """
    L, scale = wire.base.length_m, motion.scale
    a, b = motion(wire.base.place(np.array([0.0, L]), np.zeros((2, 2))))
    if 1 - motion.R[2, 2] < MOST_LEAN:
        base = Base(a[:2], b[:2])
        y, z = scale * wire.theta[:2], scale * wire.theta[2:4] + motion.shift[2]
        theta = np.array([*y, *z, scale * wire.theta[4], wire.theta[5]])
    else:
        line = motion(wire.polyline())
        base = Base(line[0, :2], line[-1, :2])
        theta = theta_of(line, base)
    factors = np.array([scale] * 5 + [1.0])
    evidence = wire.evidence
    if evidence.seen_m is not None:
        by = base.length_m / L
        evidence = replace(evidence, seen_m=tuple((low * by, high * by) for low, high in evidence.seen_m))
    return replace(
        wire,
        base=base,
        theta=theta,
        covariance=wire.covariance * np.outer(factors, factors),
        ends=(_moved_end(wire.ends[0], motion), _moved_end(wire.ends[1], motion)),
        evidence=evidence,
    )


def _moved_end(end: End, motion: Similarity) -> End:
    if not isinstance(end, Attached):
        return end
    return Attached(end.structure, motion(end.point), motion.scale * end.sigma_m)


def _fitted(line: Float[np.ndarray, "v 3"], base: Base, *, swings: bool) -> Float[np.ndarray, "6"]:
    """Least squares of the vertices' distances, from the parabola through them."""
    local, L = base.local(line), base.length_m
    s, yz = local[:, 0], local[:, 1:]
    t = s / L
    chord = np.stack([1 - t, t], 1)
    y = np.linalg.lstsq(chord, yz[:, 0], rcond=None)[0]
    z = np.linalg.lstsq(np.column_stack([chord, -4 * t * (1 - t)]), yz[:, 1], rcond=None)[0]
    start = np.array([*y, z[0], z[1], max(float(z[2]), 2 * LEAST_BEND_M)])
    low = np.array([-np.inf] * 4 + [LEAST_BEND_M])

    def theta(x: Float[np.ndarray, " k"]) -> Float[np.ndarray, "6"]:
        return x if swings else np.append(x, 0.0)

    if swings:
        # The bow to the side is b sin(phi) of the parabola's 4 t (1 - t).
        bow = np.linalg.lstsq(np.column_stack([chord, 4 * t * (1 - t)]), yz[:, 0], rcond=None)[0][2]
        start = np.append(start, np.arctan2(bow, start[4]))
        start[4] = float(np.hypot(bow, start[4]))
        low = np.append(low, -np.inf)
    found = least_squares(
        lambda x: (curve_at(theta(x), L, s) - yz).ravel(),
        start,
        bounds=(low, np.full(len(start), np.inf)),
        x_scale="jac",
        ftol=1e-15,
        xtol=1e-15,
        gtol=1e-15,
    )
    return theta(found.x)
