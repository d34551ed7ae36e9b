"""The parabola that stands for a wire or a bundle while it is followed through a cloud.

A span of 400 m that sags 12 m departs from its parabola by 1 cm.  Letters: s along a horizontal direction u,
y to its left, z up, all in metres; m points.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy.polynomial.polynomial import polyval

from plnerf.survey.lidar.config import TrackConfig


@dataclass(frozen=True, eq=False)
class Parabola:
    """y = y0 + y1 s + y2 s^2 and z likewise for s in `ends`, counted from o; y2 is the effect of wind."""

    o: Float[np.ndarray, "2"]
    u: Float[np.ndarray, "2"]
    y: Float[np.ndarray, "3"]
    z: Float[np.ndarray, "3"]
    ends: tuple[float, float]
    places: int
    """Number of points that it was fitted to."""
    gate_m: Float[np.ndarray, "2"]
    """Greatest distances of points that belong to it, sideways and in height."""

    @property
    def length_m(self) -> float:
        """Between its ends."""
        return self.ends[1] - self.ends[0]

    def local(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """s of points, and their distances y and z from the curve there."""
        flat = points[:, :2] - self.o
        s = flat @ self.u
        y = flat @ np.array([-self.u[1], self.u[0]])
        return np.stack([s, y - polyval(s, self.y), points[:, 2] - polyval(s, self.z)], 1)

    def points(self, s: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """Points of the curve at s."""
        flat = self.o + s[:, None] * self.u + polyval(s, self.y)[:, None] * np.array([-self.u[1], self.u[0]])
        return np.concatenate([flat, polyval(s, self.z)[:, None]], 1)

    def turned(self) -> "Parabola":
        """The same curve, directed the other way."""
        back, up = np.array([-1.0, 1.0, -1.0]), np.array([1.0, -1.0, 1.0])
        ends = (-self.ends[1], -self.ends[0])
        return Parabola(self.o, -self.u, self.y * back, self.z * up, ends, self.places, self.gate_m)

    @property
    def middle(self) -> Float[np.ndarray, "3"]:
        """The point midway between its ends."""
        return self.points(np.array([sum(self.ends) / 2]))[0]

    def near(self, points: Float[np.ndarray, "n 3"], beyond_m: float) -> Bool[np.ndarray, " n"]:
        """Which points lie within the gate of the curve, or of its continuation beyond its ends."""
        local = self.local(points)
        inside = (local[:, 0] >= self.ends[0] - beyond_m) & (local[:, 0] <= self.ends[1] + beyond_m)
        return inside & (np.abs(local[:, 1:]) <= self.gate_m).all(1)

    def spread(self, points: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "2"]:
        """Root mean square distances of points from the curve, sideways and in height."""
        return np.sqrt((self.local(points)[:, 1:] ** 2).mean(0))


def fit_parabola(points: Float[np.ndarray, "m 3"], config: TrackConfig) -> Parabola:
    """The parabola through points, robustly; it is never an arch, and bows sideways as wind can do it."""
    o = points[:, :2].mean(0)
    u = np.linalg.svd(points[:, :2] - o, full_matrices=False)[2][0]
    u = u if (u[0], u[1]) > (0, 0) else -u
    flat = points[:, :2] - o
    s, across, up = flat @ u, flat @ np.array([-u[1], u[0]]), points[:, 2]
    line = np.stack([np.ones_like(s), s], 1)
    hanging = np.stack([np.ones_like(s), s, s * s], 1)
    z = _robust(hanging, up, config.min_cauchy_scale_m)
    if z[2] < 0:
        z = np.append(_robust(line, up, config.min_cauchy_scale_m), 0.0)
    y = _robust(hanging, across, config.min_cauchy_scale_m)
    if np.ptp(s) < config.bow_from_m or abs(y[2]) > config.max_bow_share * z[2]:
        y = np.append(_robust(line, across, config.min_cauchy_scale_m), 0.0)
    off = np.abs([across - polyval(s, y), up - polyval(s, z)])
    sigma = 1.4826 * np.median(off, axis=1)
    gate = np.clip(config.gate_sigmas * sigma, config.min_gate_m, config.max_gate_m)
    return Parabola(o, u, y, z, (float(s.min()), float(s.max())), len(points), gate)


def _robust(
    A: Float[np.ndarray, "m k"], b: Float[np.ndarray, " m"], least_scale: float
) -> Float[np.ndarray, " k"]:
    """Least squares, weighted anew by Cauchy's function."""
    x = np.linalg.lstsq(A, b, rcond=None)[0]
    for _ in range(4):
        off = A @ x - b
        scale = max(1.4826 * float(np.median(np.abs(off))), least_scale)
        root = 1 / np.sqrt(1 + (off / (2 * scale)) ** 2)
        x = np.linalg.lstsq(A * root[:, None], b * root, rcond=None)[0]
    return x
