"""Supports in the cloud of a field: where the wires' corridor is filled below them.

Cameras that fly beside wires see the upper half of a support best: that is what is asked for.

Letters: n points in the scene frame in metres (x along the line, z up); e wires' ends.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import minimum_filter1d

STEP_M = 0.5
"""Pieces of the corridor, along it and in height."""
BESIDE_M = 1.0
"""How much wider than the wires the corridor is, on either side."""
FILLED = 0.6
"""Share of the heights below the lowest wire, down to half of its height, that a support has points in."""
FOOT_M = 1.0
"""Points nearer to the ground are taken for the ground."""
AROUND_M = 20.0
"""The ground at a place is the lowest within this distance along the corridor."""
OUTER = 0.3
"""Share of the line, at either end, in which a support is looked for."""
SHORT_M = 1.5
"""What a support may lack of the height of its highest wire; what ends further below holds up none."""
HALF_DEPTH_M = 2.5
"""Of a support's body along the line, from its axis."""


@dataclass(frozen=True, eq=False)
class Column:
    """A support."""

    x_m: float
    """Of its axis, along the line."""
    y_m: float
    foot_m: float
    top_m: float

    def holds(
        self, points: Float[np.ndarray, "n 3"], wires: Sequence[Float[np.ndarray, "_ 3"]]
    ) -> Bool[np.ndarray, " n"]:
        """Which points are its own."""
        mine = _between_wires(points, wires) & (np.abs(points[:, 0] - self.x_m) <= HALF_DEPTH_M)
        return mine & (points[:, 2] > self.foot_m + FOOT_M)


def find_columns(
    points: Float[np.ndarray, "n 3"], wires: Sequence[Float[np.ndarray, "_ 3"]]
) -> tuple[Column | None, Column | None]:
    """The supports at the first and the last end of wires (polylines along x); None where none is seen."""
    if not len(points) or not wires:
        return None, None
    every = np.concatenate(wires)
    low, high = float(every[:, 0].min()), float(every[:, 0].max())
    corridor = _between_wires(points, wires) & (points[:, 0] >= low) & (points[:, 0] <= high)
    count = max(1, int((high - low) / STEP_M))
    piece = np.clip(((points[:, 0] - low) / (high - low) * count).astype(int), 0, count - 1)
    ground = np.full(count, np.inf)
    np.minimum.at(ground, piece[corridor], points[corridor, 2])
    ground = minimum_filter1d(ground, 2 * int(AROUND_M / STEP_M) + 1, mode="nearest")
    x = low + (np.arange(count) + 0.5) / count * (high - low)
    lowest = np.min([np.interp(x, wire[:, 0], wire[:, 2]) for wire in wires], axis=0)
    filled = np.zeros(count)
    for k in np.flatnonzero(np.isfinite(ground)):
        z = points[corridor & (piece == k), 2]
        half = (ground[k] + lowest[k]) / 2
        bins = max(1, int((lowest[k] - half) / STEP_M))
        inside = z[(z > half) & (z < half + bins * STEP_M)]
        filled[k] = len(np.unique(((inside - half) / STEP_M).astype(int))) / bins
    found: list[Column | None] = []
    for outer in (x < low + OUTER * (high - low), x > high - OUTER * (high - low)):
        tall = np.flatnonzero(outer & (filled >= FILLED))
        if not len(tall):
            found.append(None)
            continue
        best = tall[np.argmax(filled[tall])]
        # Lattice and poles are symmetric about their axis; plants at the foot are not.
        half = (ground[best] + lowest[best]) / 2
        upper = points[corridor & (np.abs(points[:, 0] - x[best]) <= HALF_DEPTH_M) & (points[:, 2] > half)]
        column = column_at(float(np.median(upper[:, 0])), points, wires)
        highest = max(float(np.interp(column.x_m, wire[:, 0], wire[:, 2])) for wire in wires)
        found.append(column if column.top_m >= highest - SHORT_M else None)
    return found[0], found[1]


def column_at(
    x_m: float, points: Float[np.ndarray, "n 3"], wires: Sequence[Float[np.ndarray, "_ 3"]]
) -> Column:
    """The support at a place: from the lowest ground around it to the highest of its points."""
    at = np.array([[np.interp(x_m, wire[:, 0], wire[:, axis]) for axis in (1, 2)] for wire in wires])
    lowest_m = float(at[:, 1].min())
    around = points[_between_wires(points, wires) & (np.abs(points[:, 0] - x_m) <= AROUND_M)]
    foot_m = float(around[:, 2].min()) if len(around) else lowest_m
    near = np.abs(around[:, 0] - x_m) <= HALF_DEPTH_M
    upper = around[near & (around[:, 2] > (foot_m + lowest_m) / 2)]
    y_m = float(np.median(upper[:, 1])) if len(upper) else float(at[:, 0].mean())
    return Column(x_m, y_m, foot_m, float(upper[:, 2].max(initial=lowest_m)))


def _between_wires(
    points: Float[np.ndarray, "n 3"], wires: Sequence[Float[np.ndarray, "_ 3"]]
) -> Bool[np.ndarray, " n"]:
    """Those that lie, seen from above, no further than BESIDE_M outside of the outer wires."""
    across = np.array([np.interp(points[:, 0], wire[:, 0], wire[:, 1]) for wire in wires])
    between: Bool[np.ndarray, " n"] = (points[:, 1] >= across.min(0) - BESIDE_M) & (
        points[:, 1] <= across.max(0) + BESIDE_M
    )
    return between
