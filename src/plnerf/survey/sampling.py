"""How much nearer than its nearest measured point an obstacle may be.

A scanner samples what it sees, and so does stereo: the twig or the roof's edge that is nearest to a wire lies
between points, or beyond the last of them.  How far apart points are there depends on what they are of: n
neighbours within r lie 2 r / n apart on a bar, r sqrt(pi / n) on a surface, and r (4 pi / 3 n)^(1/3) in a
crown.
"""

import math

import numpy as np
from jaxtyping import Float, Int

from plnerf.line.cloud import HIGH_VEGETATION, Cloud
from plnerf.survey.config_ground import SamplingConfig

BALLS = (2.0, math.pi, 4 * math.pi / 3)
"""Size of the ball of radius 1 in one, two and three dimensions."""


def end_sigma_m(
    cloud: Cloud, index: Int[np.ndarray, " m"], of: int, config: SamplingConfig,
    *, group: str, towards: Float[np.ndarray, "3"],
) -> float:  # fmt: skip
    """Standard deviation of where an obstacle ends, at one of its points: of `sampling_sigma_m`, or as the
    cloud states it, of plants with the former, and of high ones with the leaves that images do not match.

    group: of the obstacles; towards: unit vector from the point to the wire.
    """
    crown = group == "vegetation"
    stated = None if cloud.sigma_m is None else float(cloud.sigma_m[of])
    if stated is not None and not crown:
        return stated
    bar = towards if group == "other" else None
    leaves = config.leaves_m if stated is not None and cloud.label[of] == HIGH_VEGETATION else 0.0
    spaced = sampling_sigma_m(cloud.xyz, index, of, config, crown=crown, towards=bar)
    return math.hypot(stated or 0.0, leaves, spaced)


def sampling_sigma_m(
    xyz: Float[np.ndarray, "n 3"], index: Int[np.ndarray, " m"], of: int, config: SamplingConfig,
    *, crown: bool, towards: Float[np.ndarray, "3"] | None = None,
) -> float:  # fmt: skip
    """Standard deviation of where an obstacle ends, at one of its points; index: the points like it.

    Grows with the spacing of the points around; where there are none, it is that of `max_spacing_m`.  crown:
    beams enter it, so that its few outermost points do not show its shape: they count as spread in space.
    towards: unit vector to the wire from a bar: so far as its points do not spread along it, what lies
    between them is no nearer.
    """
    around = xyz[index] - xyz[of]
    around = around[(np.abs(around) <= config.reach_m).all(1)]
    r = np.linalg.norm(around, axis=1)
    order = np.argsort(r, kind="stable")[: config.neighbours + 1]
    spacing, share = config.max_spacing_m, config.share if towards is None else config.bar_share
    if len(order) == config.neighbours + 1:
        dimension = 3.0 if crown else _dimension(around[order])
        spacing = min(spacing, _spacing(config.neighbours, float(r[order[-1]]), dimension))
        if towards is not None:
            along = float(((around[order] @ towards) ** 2).sum() / max((r[order] ** 2).sum(), 1e-12))
            spacing *= math.sqrt(min(1.0, dimension * along))
        elif not crown:
            share = config.surface_share
    return math.hypot(config.point_m, share * spacing)


def _spacing(n: int, radius_m: float, dimension: float) -> float:
    """Of points of which n others lie within the radius of one."""
    of = [radius_m * (ball / n) ** (1 / k) for k, ball in enumerate(BALLS, 1)]
    return float(np.interp(dimension, (1, 2, 3), of))


def _dimension(around: Float[np.ndarray, "k 3"]) -> float:
    """1 of a bar, 2 of a plane, 3 of a ball: by how many directions share the spread."""
    spread = np.maximum(np.linalg.eigvalsh(around.T @ around), 0.0)
    total = float((spread**2).sum())
    return float(np.clip(spread.sum() ** 2 / total, 1.0, 3.0)) if total > 0 else 1.0
