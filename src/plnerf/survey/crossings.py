"""Where the wires of one line pass over those of another, and how near they come to each other.

Letters: s along a wire's base from its first end; LineFrame, metres, z up.
"""

from itertools import combinations

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from plnerf.line.clearances import Crossing
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire

OUTSIDE = 0.1
"""Chords that meet farther outside than this share of either are not tried: wires leave them by less."""


def find_crossings(survey: Survey) -> tuple[Crossing, ...]:
    """Every pair of wires of two lines that cross as seen from above, between their ends; the nearest first.

    The variance of a distance is that of both wires along the line between them.
    """
    found = []
    for one, other in combinations(survey.lines, 2):
        pairs = ((a, b) for a in one.wires for b in other.wires)
        found += [crossing for a, b in pairs if (crossing := crossing_of(a, b)) is not None]
    return tuple(sorted(found, key=lambda crossing: crossing.distance_m))


def crossing_of(one: Wire, other: Wire) -> Crossing | None:
    """Where two wires cross as seen from above; None where they do not."""
    lengths = np.array([one.base.length_m, other.base.length_m])
    ends = [wire.points(np.array([0.0, wire.base.length_m]))[:, :2] for wire in (one, other)]
    (p, u), (q, v) = ((first, last - first) for first, last in ends)
    turned = float(u[0] * v[1] - u[1] * v[0])
    if abs(turned) < 1e-9 * np.linalg.norm(u) * np.linalg.norm(v):  # side by side
        return None
    # p + a u = q + b v of the chords, which a swung wire leaves by little.
    shares = np.array([[v[1], -v[0]], [u[1], -u[0]]]) @ (q - p) / turned
    if np.abs(shares - 0.5).max() > 0.5 + OUTSIDE:
        return None

    def apart(s: Float[np.ndarray, "2"]) -> Float[np.ndarray, "3"]:
        gap: Float[np.ndarray, 3] = one.points(s[:1])[0] - other.points(s[1:])[0]
        return gap

    flat = least_squares(lambda s: apart(s)[:2], np.clip(shares, 0, 1) * lengths)
    if not flat.success or np.abs(flat.fun).max() > 1e-6 or ((flat.x < 0) | (flat.x > lengths)).any():
        return None
    vertical = float(apart(flat.x)[2])
    near = least_squares(apart, flat.x, bounds=(np.zeros(2), lengths))
    gap = apart(near.x)
    distance = float(np.linalg.norm(gap))
    towards = gap / max(distance, 1e-9)
    variance = sum(variance_towards(wire, s, towards) for wire, s in zip((one, other), near.x, strict=True))
    found = (one, float(near.x[0])), (other, float(near.x[1]))
    (upper, s_upper), (lower, s_lower) = found if vertical >= 0 else found[::-1]
    return Crossing(
        upper.id, lower.id, distance, float(np.sqrt(variance)), s_upper, s_lower,
        upper.points(np.array([s_upper]))[0], lower.points(np.array([s_lower]))[0], abs(vertical),
    )  # fmt: skip


def variance_towards(wire: Wire, s: float, towards: Float[np.ndarray, "3"]) -> float:
    """Of the wire's place at s along a direction."""
    by_theta = np.array([towards[:2] @ wire.base.n, towards[2]]) @ wire.by_theta(np.array([s]))[0]
    return max(float(by_theta @ wire.covariance @ by_theta), 0.0)
