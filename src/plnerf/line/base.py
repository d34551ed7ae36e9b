"""The horizontal segment that a wire's offsets and heights are counted from.

Letters: s along the segment, y to its left, z up; u and n the unit vectors of s and y; metres.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, eq=False)
class Base:
    """From A0 to B0, horizontal."""

    a: Float[np.ndarray, "2"]
    b: Float[np.ndarray, "2"]

    @classmethod
    def along(cls, o: Float[np.ndarray, "2"], u: Float[np.ndarray, "2"], low: float, high: float) -> "Base":
        """From o + low u to o + high u."""
        return cls(o + low * u, o + high * u)

    @property
    def length_m(self) -> float:
        """L = |A0 B0|."""
        return float(np.linalg.norm(self.b - self.a))

    @property
    def u(self) -> Float[np.ndarray, "2"]:
        """Unit vector from A0 to B0."""
        u: Float[np.ndarray, 2] = (self.b - self.a) / self.length_m
        return u

    @property
    def n(self) -> Float[np.ndarray, "2"]:
        """Unit vector to the left of u."""
        u = self.u
        return np.array([-u[1], u[0]])

    def cut(self, low: float, high: float) -> "Base":
        """The segment from s = low to s = high of the same straight line."""
        return Base.along(self.a, self.u, low, high)

    def local(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        """s, y and z of points."""
        flat = points[:, :2] - self.a
        return np.stack([flat @ self.u, flat @ self.n, points[:, 2]], 1)

    def place(self, s: Float[np.ndarray, " m"], yz: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "m 3"]:
        """The points at s, y and z: the inverse of `local`."""
        flat = self.a + s[:, None] * self.u + yz[:, :1] * self.n
        return np.concatenate([flat, yz[:, 1:]], 1)


def base_of(points: Float[np.ndarray, "m 3"]) -> Base:
    """Along the main horizontal direction of points, from the first to the last of them."""
    middle = np.median(points[:, :2], axis=0)
    u = np.linalg.svd(points[:, :2] - points[:, :2].mean(0), full_matrices=False)[2][0]
    s = (points[:, :2] - middle) @ u
    return Base.along(middle, u, float(s.min()), float(s.max()))


def jacobian(
    function: Callable[[Float[np.ndarray, " k"]], Float[np.ndarray, " r"]], x: Float[np.ndarray, " k"]
) -> Float[np.ndarray, "r k"]:
    """Derivatives by central differences, good to ten digits for what is as smooth as a catenary."""
    columns = []
    for k in range(len(x)):
        h = np.zeros(len(x))
        h[k] = 1e-5 * max(1.0, abs(x[k]))
        columns.append((function(x + h) - function(x - h)) / (2 * h[k]))
    return np.stack(columns, 1)
