"""Spans seen from the side: what lies below their wires, and the scale of a drawing.

Letters: t station along the line (`line/stations.py`); z height, in the LineFrame; x and y pixels of the
drawing, y down; g places along t.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from plnerf.line.clearances import Profile
from plnerf.line.stations import Chain, Stretch

WIDTH, LEFT, RIGHT, TOP, BOTTOM = 1100, 64, 60, 14, 46
"""Width of a drawing and its margins, in pixels."""
MOST_HEIGHT, LEAST_HEIGHT = 440, 200
"""Bounds on the height of the plotting area, in pixels."""
EXAGGERATIONS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 8.0, 10.0, 15.0, 20.0, 30.0, 50.0)
MOST_SPANS = 4
"""In one drawing; a longer line takes several, one below the other."""
PLACES = 400
"""Along a span, where the heights below its wires are drawn."""


def sheets(chain: Chain) -> list[Chain]:
    """A chain in pieces of MOST_SPANS or fewer, about as many in each."""
    count = -(-len(chain) // MOST_SPANS)
    edges = [round(k * len(chain) / count) for k in range(count + 1)]
    return [chain[first:last] for first, last in pairwise(edges)]


@dataclass(frozen=True)
class Scale:
    """LineFrame to pixels."""

    per_unit: float
    """Pixels per unit of length along t."""
    exaggeration: float
    first: float
    """t at the left edge."""
    top: float
    """z at the upper edge."""
    width: float
    height: float
    """Of the plotting area, in pixels."""

    @property
    def bottom(self) -> float:
        """z at the lower edge."""
        return self.top - self.height / self.per_unit / self.exaggeration

    def x(self, t: float) -> float:
        """Pixels from the left."""
        return LEFT + (t - self.first) * self.per_unit

    def y(self, z: float) -> float:
        """Pixels from above."""
        return TOP + (self.top - z) * self.per_unit * self.exaggeration

    def path(self, t: Float[np.ndarray, " k"], z: Float[np.ndarray, " k"]) -> str:
        """Points of a polyline."""
        return " ".join(f"{self.x(a):.1f},{self.y(b):.1f}" for a, b in zip(t, z, strict=True))


@dataclass(frozen=True, eq=False)
class Below:
    """Heights at places t, over all wires of a span; NaN where none of the profiles knows any."""

    t: Float[np.ndarray, " g"]
    lowest: Float[np.ndarray, " g"]
    """Of the ground below the wires."""
    highest: Float[np.ndarray, " g"]
    """Of the ground below the wires."""
    vegetation: Float[np.ndarray, " g"]
    """Its highest top."""


def below(stretch: Stretch, profiles: Sequence[Profile]) -> Below:
    """The heights of the profiles of a span's wires, taken together."""
    grid, nothing = np.linspace(stretch.from_m, stretch.to_m, PLACES), np.full(PLACES, np.nan)
    ground, vegetation = [nothing], [nothing]
    for one in profiles:
        t = stretch.station(one.points)
        order = np.argsort(t)
        for rows, z in ((ground, one.ground_z), (vegetation, one.vegetation_z)):
            rows.append(np.interp(grid, t[order], z[order], left=np.nan, right=np.nan))
    lowest, highest = np.fmin.reduce(ground), np.fmax.reduce(ground)  # which pass over NaN
    return Below(grid, lowest, highest, np.fmax.reduce(vegetation))


def fitting(first: float, last: float, low: float, high: float) -> Scale:
    """The largest drawing within the page, with the greatest of EXAGGERATIONS that fits."""
    aside = 0.015 * (last - first)
    first, last = first - aside, last + aside
    wide = max(last - first, 1e-9)
    tall = max(high - low, 0.02 * wide) * 1.06
    per_unit = min((WIDTH - LEFT - RIGHT) / wide, MOST_HEIGHT / tall)
    exaggeration = max(k for k in EXAGGERATIONS if k == 1 or k * tall * per_unit <= MOST_HEIGHT * 0.8)
    height = max(tall * per_unit * exaggeration, LEAST_HEIGHT)
    middle = (low + high) / 2 + height / per_unit / exaggeration / 2
    return Scale(per_unit, exaggeration, first, middle, wide * per_unit, height)


def ticks(low: float, high: float, count: float) -> Float[np.ndarray, " k"]:
    """About `count` round values from low to high."""
    raw = (high - low) / max(count, 1)
    power = 10.0 ** np.floor(np.log10(raw))
    step = min((k * power for k in (1, 2, 5, 10)), key=lambda s: abs(np.log(s / raw)))
    found: Float[np.ndarray, " k"] = step * np.arange(
        np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1
    )
    return found


def runs(good: Bool[np.ndarray, " g"]) -> list[slice]:
    """Stretches of two or more neighbours that are true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(np.int8)))
    return [slice(a, b) for a, b in edges.reshape(-1, 2) if b - a > 1]
