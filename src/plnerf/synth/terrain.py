"""The ground: its height, and the track or road on it.

World frame (metres, z up, origin on the ground at mid-span); `along` is the line's horizontal unit vector.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from plnerf.line.hang import Point
from plnerf.synth.config import TerrainConfig

ROAD_ACROSS_M = -6.5  # the road's centre line, to the right of the wires
ROAD_HALF_M = 2.6


@dataclass(frozen=True)
class Ground:
    """The ground under one span."""

    terrain: TerrainConfig
    along: tuple[float, float]
    span_m: float

    def heights(self, x_m: Float[np.ndarray, "*n"], y_m: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Gentle waves near the line, hills from 150 m on, and a slope along the line; 0 at the origin."""

        dx, dy = self.terrain.shift_m

        def waves(x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
            return (
                0.45 * np.sin(x / 17.0 + y / 31.0 + 0.4)
                + 0.55 * np.sin(y / 14.0 - x / 40.0 + 1.1)
                + 0.10 * np.sin(x / 4.3 - y / 5.1)
            )

        far = np.clip((np.hypot(x_m, y_m) - 120.0) / 450.0, 0.0, 1.0)
        hills = (
            34.0
            + 22.0 * np.sin((x_m + dx) / 97.0 + 0.8) * np.cos((y_m + dy) / 121.0)
            + 9.0 * np.sin(((x_m + dx) - (y_m + dy)) / 41.0)
        )
        zero = np.zeros(1)
        near = self.terrain.waves * (waves(x_m + dx, y_m + dy) - waves(zero + dx, zero + dy)[0])
        level = near + far * far * (3 - 2 * far) * hills * self.terrain.hills
        if self.terrain.hills < 1:  # flat land rises far away, lest one look over the model's edge
            rim = np.clip((np.hypot(x_m, y_m) - 600.0) / 400.0, 0.0, 1.0)
            level = level + (1 - self.terrain.hills) * 80.0 * rim * rim * (3 - 2 * rim)
        if self.terrain.rise_m == 0:
            return level
        # A slope that ends in plains: the full rise between the supports, 3 times as much in all.
        reach = 1.5 * self.span_m
        s = self.along[0] * x_m + self.along[1] * y_m
        return level + 0.5 * self.terrain.rise_m * np.tanh(s / reach) / math.tanh(self.span_m / 2 / reach)

    def height(self, x_m: float, y_m: float) -> float:
        """Height of one point of the ground."""
        return float(self.heights(np.array([x_m]), np.array([y_m]))[0])

    def point(self, x_m: float, y_m: float) -> Point:
        """The ground's point above x, y."""
        return float(x_m), float(y_m), self.height(x_m, y_m)

    def track_offset(
        self, x_m: Float[np.ndarray, "*n"], y_m: Float[np.ndarray, "*n"]
    ) -> Float[np.ndarray, "*n"]:
        """Signed distance (roughly) from the track's centre line; far away if there is none."""
        if self.terrain.track == "dirt":
            return y_m - (-8.5 + 2.2 * np.sin(x_m / 15.0) + 0.03 * x_m)
        if self.terrain.track == "road":
            return self.along[0] * y_m - self.along[1] * x_m - ROAD_ACROSS_M
        return np.full_like(x_m, 1e6)
