"""Where a line runs on the map: its structures' feet, the directions of its spans, and places along it.

Letters: s station along the line, 0 in the middle of its main span; t across it, left positive; x, y world.
World frame, metres.  Within BLEND_M of a structure at which the line turns, "across" turns with it steadily,
so that a path beside the line has no step; before the first and beyond the last structure the line goes on
straight.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from plnerf.synth.line_config import LineConfig

BLEND_M = 8.0


@dataclass(frozen=True)
class Route:
    """The course of one line."""

    feet: tuple[tuple[float, float], ...]
    """x and y of each structure"""
    stations_m: tuple[float, ...]
    """of each structure"""
    azimuths_deg: tuple[float, ...]
    """of each span, from +x towards +y; they go on beyond 180 rather than jump"""
    main: int
    """index of the main span"""
    middle: tuple[float, float]
    """x and y of the middle of the main span"""

    @classmethod
    def of(cls, line: LineConfig) -> "Route":
        """The course that a line's lengths and turns describe, outwards from the middle of its main span."""
        count = len(line.lengths_m)
        azimuths = [line.azimuth_deg] * count
        for k in range(line.main + 1, count):
            azimuths[k] = azimuths[k - 1] + line.structure(k).turn_deg
        for k in range(line.main - 1, -1, -1):
            azimuths[k] = azimuths[k + 1] - line.structure(k + 1).turn_deg
        half = line.lengths_m[line.main] / 2
        mx, my = line.middle_m
        ux, uy = unit(line.azimuth_deg)
        feet = {
            line.main: (mx + ux * -half, my + uy * -half),
            line.main + 1: (mx + ux * half, my + uy * half),
        }
        stations = {line.main: -half, line.main + 1: half}
        for k in range(line.main + 1, count):
            ux, uy = unit(azimuths[k])
            feet[k + 1] = (feet[k][0] + ux * line.lengths_m[k], feet[k][1] + uy * line.lengths_m[k])
            stations[k + 1] = stations[k] + line.lengths_m[k]
        for k in range(line.main - 1, -1, -1):
            ux, uy = unit(azimuths[k])
            feet[k] = (feet[k + 1][0] - ux * line.lengths_m[k], feet[k + 1][1] - uy * line.lengths_m[k])
            stations[k] = stations[k + 1] - line.lengths_m[k]
        order = range(count + 1)
        return cls(
            tuple(feet[k] for k in order), tuple(stations[k] for k in order), tuple(azimuths), line.main,
            line.middle_m,
        )  # fmt: skip

    def span_at(self, s: float) -> int:
        """Index of the span that a station lies in; the first or last one beyond the ends."""
        k = int(np.searchsorted(self.stations_m, s, side="right")) - 1
        return min(max(k, 0), len(self.azimuths_deg) - 1)

    def share(self, k: int, s: float) -> float:
        """How far along span k a station lies, 0 to 1; the nearer end outside of it."""
        half = (self.stations_m[k + 1] - self.stations_m[k]) / 2
        middle = 0.0 if k == self.main else self.stations_m[k] + half
        return float(np.clip((s - middle + half) / (2 * half), 0.0, 1.0))

    def azimuth_deg(self, s: float) -> float:
        """Of the line at a station; at a structure where it turns, half of the turn."""
        k = self.span_at(s)
        azimuth = self.azimuths_deg[k]
        for edge, other in ((k, k - 1), (k + 1, k + 1)):
            if 0 <= other < len(self.azimuths_deg) and self.azimuths_deg[other] != azimuth:
                away = abs(s - self.stations_m[edge])
                if away < BLEND_M:
                    return azimuth + 0.5 * (1 - away / BLEND_M) * (self.azimuths_deg[other] - azimuth)
        return azimuth

    def at(self, s: float, t: float) -> tuple[float, float]:
        """World x, y of a point given by station and distance across."""
        k = self.span_at(s)
        if k == self.main:
            (x, y), along = self.middle, s
        else:
            (x, y), along = self.feet[k], s - self.stations_m[k]
        ux, uy = unit(self.azimuths_deg[k])
        vx, vy = unit(self.azimuth_deg(s))
        return x + (ux * along - vy * t), y + (uy * along + vx * t)

    def stations_of(self, points: Float[np.ndarray, "n _"]) -> Float[np.ndarray, " n"]:
        """Stations of the nearest places on the line, on its straight continuation beyond its ends."""
        return self._nearest(points)[0]

    def away_from(self, points: Float[np.ndarray, "n _"]) -> Float[np.ndarray, " n"]:
        """Horizontal distances from the line or its continuation."""
        return self._nearest(points)[1]

    def _nearest(
        self, points: Float[np.ndarray, "n _"]
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        best = np.full(len(points), np.inf)
        stations = np.zeros(len(points))
        last = len(self.azimuths_deg) - 1
        for k, azimuth in enumerate(self.azimuths_deg):
            u = np.array(unit(azimuth))
            start, off = (
                (0.0, points[:, :2] - np.array(self.middle))
                if k == self.main
                else (self.stations_m[k], points[:, :2] - np.array(self.feet[k]))
            )
            s = start + off @ u
            low = -math.inf if k == 0 else self.stations_m[k]
            high = math.inf if k == last else self.stations_m[k + 1]
            held = np.clip(s, low, high)
            away = np.hypot(off @ np.array([-u[1], u[0]]), s - held)
            nearer = away < best
            best[nearer], stations[nearer] = away[nearer], held[nearer]
        return stations, best


def unit(azimuth_deg: float) -> tuple[float, float]:
    """The horizontal unit vector of an azimuth."""
    azimuth = math.radians(azimuth_deg)
    return math.cos(azimuth), math.sin(azimuth)
