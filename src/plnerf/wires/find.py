"""All conductors of a scene, found in its training images: sweep, climb, fit, and one curve for each ridge.

The axis of the line must be known (it is the scene frame's x).  Occlusion is ignored: what hides a conductor
from some views only lowers its support.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from plnerf.scene.scene import Scene
from plnerf.wires.climb import climb, curve_point
from plnerf.wires.curves import Curve
from plnerf.wires.evidence import line_evidence
from plnerf.wires.refit import Fit, erase, refit, support
from plnerf.wires.sweep import FEWEST_VIEWS, Box, candidates, pool
from plnerf.wires.views import Views, views_of

LEVELS = 6
PLANES = 48
STEPS = (2.0, 1.0, 0.5, 0.25, 0.125)
"""Of a cell: the steps of the climb."""
TRIED = 60
"""Climbed curves that are fitted."""
NEAR_PX, BESIDE_PX, WEAKEST = 2, 12, 0.15
ERASED_PX = 4
SETTLING = 2
LEAST_SUPPORT = 0.25
"""Share of the views, beyond chance, that show a ridge on a conductor."""
LONGEST_GAP = 0.15
"""Of the span: a curve ends where it has no support for so long."""


@dataclass(frozen=True)
class FindConfig:
    """How finely conductors are looked for; lengths in units of the scene frame."""

    cell: float = 0.004
    """Width of a cell across the line: 9 cm where the span's longest side is 44 m."""
    most: int = 40
    """Conductors at most."""


def find_curves(scene: Scene, config: FindConfig | None = None) -> tuple[Curve, ...]:
    """The conductors that the training images show, best supported first."""
    config = config or FindConfig()
    cameras = scene.cameras[list(scene.train)]
    views = views_of(cameras)
    values = line_evidence(scene.images, scene.cameras, scene.train)
    box = search_box(scene, config.cell)
    pooled = pool(values, views, LEVELS)
    rough = candidates(views, pooled, box)
    maps = np.cumsum(pooled, 0) / np.arange(1, LEVELS + 1, dtype=np.float32)[:, None]
    x = np.linspace(box.x[0], box.x[-1], 2 * PLANES)
    climbed, scores = climb(views, maps, config.cell * np.array(STEPS), rough, x, FEWEST_VIEWS)
    order = np.argsort(-scores, kind="stable")[:TRIED]
    fits = [fit for c in order if (fit := refit(views, values, climbed[c], x)) is not None]
    fits.sort(key=lambda fit: -mean_support(views, values, fit.q, x))
    chosen = _choose(views, values, fits, x, config.most)
    for _ in range(SETTLING):
        chosen = _settle(views, values, chosen, x)
    return tuple(curve for fit in chosen if (curve := _curve(views, values, fit, x)) is not None)


def _curve(
    views: Views, values: Float[np.ndarray, " p"], fit: Fit, x: Float[np.ndarray, " i"]
) -> Curve | None:
    ends = extent(per_plane(views, values, fit.q, x), x)
    if ends is None:
        return None
    return Curve.of_fit(fit.q, fit.covariance, (x[0], x[-1]), ends, typical_footprint(views, fit.q, x))


def _choose(
    views: Views, values: Float[np.ndarray, " p"], fits: list[Fit], x: Float[np.ndarray, " i"], most: int
) -> list[Fit]:
    """Takes the best supported curve, its ridges away from the others, and so on."""
    left, fine = values.copy(), np.linspace(x[0], x[-1], 40 * len(x))
    chosen: list[Fit] = []
    for first in fits:
        if len(chosen) == most or mean_support(views, left, first.q, x) < LEAST_SUPPORT:
            continue
        fit = refit(views, left, first.q, x)
        if fit is None or mean_support(views, left, fit.q, x) < LEAST_SUPPORT:
            continue
        chosen.append(fit)
        erase(views, left, fit.q, fine, ERASED_PX)
    return chosen


def _settle(
    views: Views, values: Float[np.ndarray, " p"], chosen: list[Fit], x: Float[np.ndarray, " i"]
) -> list[Fit]:
    """Each curve again where the others are: what was taken first had others' ridges before it."""
    fine = np.linspace(x[0], x[-1], 40 * len(x))
    settled: list[Fit] = []
    for k, fit in enumerate(chosen):
        mine = values.copy()
        for other in (*settled, *chosen[k + 1 :]):
            erase(views, mine, other.q, fine, ERASED_PX)
        settled.append(refit(views, mine, fit.q, x) or fit)
    return settled


def per_plane(
    views: Views, values: Float[np.ndarray, " p"], q: Float[np.ndarray, "5"], x: Float[np.ndarray, " i"]
) -> Float[np.ndarray, " i"]:
    """Support in each plane: share of the views with a ridge there, beyond the share that has one beside."""
    on, beside, weight = support(views, values, q, x, NEAR_PX, BESIDE_PX, WEAKEST).T
    return (on - beside) / np.maximum(weight, 1e-12)


def mean_support(
    views: Views, values: Float[np.ndarray, " p"], q: Float[np.ndarray, "5"], x: Float[np.ndarray, " i"]
) -> float:
    """Support over all planes."""
    on, beside, weight = support(views, values, q, x, NEAR_PX, BESIDE_PX, WEAKEST).T
    return float((on - beside).sum() / max(weight.sum(), 1e-12))


def typical_footprint(views: Views, q: Float[np.ndarray, "5"], x: Float[np.ndarray, " i"]) -> float:
    """Median width of a pixel on the curve, over planes, of the nearest views: those that resolve it."""
    s = np.linspace(0, 1, len(x))
    y, z = curve_point(q, s)
    points = np.stack([x, y, z], 1)
    distance = np.linalg.norm(points[:, None] - views.centre[None], axis=2) / views.focal[:, 0]
    return float(np.median(np.sort(distance, 1)[:, : max(3, len(views.centre) // 4)]))


def extent(supported: Float[np.ndarray, " i"], x: Float[np.ndarray, " i"]) -> tuple[float, float] | None:
    """From the first to the last plane of the longest stretch that has support."""
    there = np.flatnonzero(np.convolve(supported, np.ones(3) / 3, "same") > 0.5 * LEAST_SUPPORT)
    if len(there) < 2:
        return None
    longest = LONGEST_GAP * len(x)
    runs = np.split(there, np.flatnonzero(np.diff(there) > longest) + 1)
    run = max(runs, key=lambda r: r[-1] - r[0])
    return float(x[run[0]]), float(x[run[-1]])


def search_box(scene: Scene, cell: float) -> Box:
    """Where to look: the span's box where the scene names it, else around the cameras."""
    low, high = scene.box
    shape = np.ceil((high - low)[1:] / cell).astype(int) + 1
    inset = 0.5 * (high[0] - low[0]) / PLANES
    x = np.linspace(low[0] + inset, high[0] - inset, PLANES)
    return Box(x, (float(low[1]), float(low[2])), cell, (int(shape[0]), int(shape[1])))
