"""Bodies of structures in a cloud: where the wires' corridor is filled below them.

Cameras that fly beside wires see the upper half of a support best: that is what is asked for.

Letters: n points (x along the line, y to its left, z up).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import minimum_filter1d

from plnerf.survey.config_wires import BodyConfig, PoleConfig


@dataclass(frozen=True, eq=False)
class Body:
    """A structure's body."""

    x_m: float
    """Of its axis, along the line."""
    y_m: float
    foot_m: float
    top_m: float

    def holds(
        self, points: Float[np.ndarray, "n 3"], wires: Sequence[Float[np.ndarray, "_ 3"]], config: BodyConfig
    ) -> Bool[np.ndarray, " n"]:
        """Which points are its own."""
        near = np.abs(points[:, 0] - self.x_m) <= config.half_depth_m
        return near & _between_wires(points, wires, config) & (points[:, 2] > self.foot_m + config.foot_m)


def find_bodies(
    points: Float[np.ndarray, "n 3"],
    wires: Sequence[Float[np.ndarray, "_ 3"]],
    config: BodyConfig,
    also: Float[np.ndarray, "m 3"] | None = None,
) -> tuple[Body | None, Body | None]:
    """The bodies at the first and the last end of wires (polylines along x); None where none is seen.

    also: points of another kind, which must show something at the same place.
    """
    if not len(points) or not wires:
        return None, None
    every = np.concatenate(wires)
    low, high = float(every[:, 0].min()), float(every[:, 0].max())
    corridor = _between_wires(points, wires, config) & (points[:, 0] >= low) & (points[:, 0] <= high)
    count = max(1, int((high - low) / config.step_m))
    piece = np.clip(((points[:, 0] - low) / (high - low) * count).astype(int), 0, count - 1)
    ground = np.full(count, np.inf)
    np.minimum.at(ground, piece[corridor], points[corridor, 2])
    ground = minimum_filter1d(ground, 2 * int(config.around_m / config.step_m) + 1, mode="nearest")
    x = low + (np.arange(count) + 0.5) / count * (high - low)
    lowest = np.min([np.interp(x, wire[:, 0], wire[:, 2]) for wire in wires], axis=0)
    filled = np.zeros(count)
    for k in np.flatnonzero(np.isfinite(ground)):
        filled[k] = _filled(points[corridor & (piece == k), 2], ground[k], lowest[k], config)
    found: list[Body | None] = []
    for outer in (x < low + config.outer * (high - low), x > high - config.outer * (high - low)):
        tall = np.flatnonzero(outer & (filled >= config.filled))
        for best in tall[np.argsort(-filled[tall], kind="stable")]:
            if also is None or _seen(also, x[best], ground[best], lowest[best], wires, config):
                break
        else:
            found.append(None)
            continue
        # Lattice and poles are symmetric about their axis; plants at the foot are not.
        half = (ground[best] + lowest[best]) / 2
        near = np.abs(points[:, 0] - x[best]) <= config.half_depth_m
        upper = points[corridor & near & (points[:, 2] > half)]
        body = body_at(float(np.median(upper[:, 0])), points, wires, config)
        highest = max(float(np.interp(body.x_m, wire[:, 0], wire[:, 2])) for wire in wires)
        found.append(body if body.top_m >= highest - config.short_m else None)
    return found[0], found[1]


def body_at(
    x_m: float,
    points: Float[np.ndarray, "n 3"],
    wires: Sequence[Float[np.ndarray, "_ 3"]],
    config: BodyConfig,
) -> Body:
    """The structure at a place: from the lowest ground around it to the highest of its points."""
    at = np.array([[np.interp(x_m, wire[:, 0], wire[:, axis]) for axis in (1, 2)] for wire in wires])
    lowest_m = float(at[:, 1].min())
    around = points[_between_wires(points, wires, config) & (np.abs(points[:, 0] - x_m) <= config.around_m)]
    foot_m = float(around[:, 2].min()) if len(around) else lowest_m
    near = np.abs(around[:, 0] - x_m) <= config.half_depth_m
    upper = around[near & (around[:, 2] > (foot_m + lowest_m) / 2)]
    y_m = float(np.median(upper[:, 1])) if len(upper) else float(at[:, 0].mean())
    return Body(x_m, y_m, foot_m, float(upper[:, 2].max(initial=lowest_m)))


def pole_axis(
    body: Body, held_sigma_m: float, points: Float[np.ndarray, "n 3"], lowest_m: float, config: PoleConfig
) -> float | None:
    """Where along the line the axis of a pole stands that is seen where a body holds wires; None where no
    pole is.

    A crossarm may carry its wires before the pole or behind it, so that these do not say where it stands;
    what stands farther from them is another thing, such as a leg of a lattice.  Where they are
    held is uncertain, points are looked at so much farther along the line: else the edge of something wide
    would look slender.
    held_sigma_m: standard deviation of where they are held; lowest_m: height of the lowest wire there.
    """
    low, high = body.foot_m + config.foot_m, lowest_m - config.below_wires_m
    within = config.about_m + np.array([held_sigma_m, 0.0])
    beside = (np.abs(points[:, :2] - [body.x_m, body.y_m]) <= within).all(1)
    own = points[beside & (points[:, 2] > low) & (points[:, 2] < high)]
    if len(own) < config.least_points:
        return None
    tall_m = len(np.unique(np.floor(own[:, 2] / config.step_m))) * config.step_m
    first, last = np.percentile(own[:, 0], config.edges)
    axis, slender = float(first + last) / 2, last - first <= config.widest_m
    carries = abs(axis - body.x_m) <= config.carries_m + held_sigma_m
    return axis if slender and carries and tall_m >= config.least_tall_m else None


def _seen(
    points: Float[np.ndarray, "n 3"], x_m: float, ground: float, lowest: float,
    wires: Sequence[Float[np.ndarray, "_ 3"]], config: BodyConfig,
) -> bool:  # fmt: skip
    """Whether points show something below the wires at a place."""
    near = points[np.abs(points[:, 0] - x_m) <= config.confirmed_within_m]
    z = near[_between_wires(near, wires, config), 2]
    return _filled(z, ground, lowest, config) >= config.confirmed


def _filled(z: Float[np.ndarray, " k"], ground: float, lowest: float, config: BodyConfig) -> float:
    """Share of the upper half of the heights between the ground and the lowest wire that hold points."""
    half = (ground + lowest) / 2
    bins = max(1, int((lowest - half) / config.step_m))
    inside = z[(z > half) & (z < half + bins * config.step_m)]
    return len(np.unique(((inside - half) / config.step_m).astype(int))) / bins


def _between_wires(
    points: Float[np.ndarray, "n 3"], wires: Sequence[Float[np.ndarray, "_ 3"]], config: BodyConfig
) -> Bool[np.ndarray, " n"]:
    """Those that lie, seen from above, no further than `beside_m` outside of the outer wires."""
    across = np.array([np.interp(points[:, 0], wire[:, 0], wire[:, 1]) for wire in wires])
    between: Bool[np.ndarray, " n"] = (points[:, 1] >= across.min(0) - config.beside_m) & (
        points[:, 1] <= across.max(0) + config.beside_m
    )
    return between
