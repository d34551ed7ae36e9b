"""Two wires side by side whose images were paired crosswise.

Where all photos look at two parallel wires from two directions only, as those of a flight to and fro do, a
photo of the one and a photo of the other see two lines each, and which belong together they do not say.  Seen
across the wires, the lines of sight are the sides of a parallelogram: the wires are at two opposite corners,
and at the other two the same lines cross.  With h half of the way from wire to wire across them, and n_1, n_2
normals of the two directions, the other pair of corners is at +-h', where

    n_1 . h' = n_1 . h,    n_2 . h' = -n_2 . h

All that tells both apart is that no photo looks quite as the others of its direction: of the right pair more
is seen.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from plnerf.line.wire import Wire
from plnerf.survey.posed_photos import Photos
from plnerf.survey.refine.config import CrossedConfig, RefineConfig
from plnerf.survey.refine.refine import Refinement, refine_wires

HALF_TURN = 180.0
SHARES = np.linspace(0.1, 0.9, 9)
"""Places along wires that are compared."""


@dataclass(frozen=True)
class _Pair:
    """Two wires by their indices, and what moves the first one to its other corner, y and z; the second
    moves by the opposite."""

    one: int
    other: int
    move: Float[np.ndarray, "2"]


def uncrossed(photos: Photos, refined: Refinement, config: RefineConfig) -> Refinement:
    """The wires of a span with the pairs at their other corners of which the photos show more there.

    refined: of the span, on one common base; photos: those that show it, at their full size.
    """
    pairs = _pairs(photos, refined.wires, config.crossed)
    if not pairs:
        return refined
    crossed = refine_wires(photos, _moved(refined.wires, pairs), config)
    more = config.crossed.least_more
    better = [pair for pair in pairs if _seen(crossed, pair) > more * _seen(refined, pair)]
    if not better:
        return refined
    if len(better) == len(pairs):
        return crossed
    return refine_wires(photos, _moved(refined.wires, better), config)


def _seen(refined: Refinement, pair: _Pair) -> int:
    return refined.counts[pair.one] + refined.counts[pair.other]


def _moved(wires: Sequence[Wire], pairs: Sequence[_Pair]) -> list[Wire]:
    found = list(wires)
    for pair in pairs:
        for k, sign in ((pair.one, 1.0), (pair.other, -1.0)):
            theta = wires[k].theta.copy()
            theta[:4] += sign * np.repeat(pair.move, 2)  # y and z at both ends
            found[k] = replace(wires[k], theta=theta)
    return found


def _pairs(photos: Photos, wires: Sequence[Wire], config: CrossedConfig) -> list[_Pair]:
    """Wires that are each other's nearest, and that photos see from two directions only."""
    if len(wires) < 2:
        return []
    s = SHARES * wires[0].base.length_m
    places = np.array([wire.points(s) for wire in wires])
    apart = np.median(np.linalg.norm(places[:, None] - places, axis=3), axis=2)
    np.fill_diagonal(apart, np.inf)
    nearest = apart.argmin(1)
    found = []
    for i, j in enumerate(nearest.tolist()):
        if i < j and nearest[j] == i and apart[i, j] <= config.near_m:
            move = _other_corner(photos, wires[i], places[i] - places[j], places[[i, j]].mean(0), config)
            if move is not None:
                found.append(_Pair(i, j, move))
    return found


def _other_corner(
    photos: Photos,
    wire: Wire,
    between: Float[np.ndarray, "k 3"],
    middles: Float[np.ndarray, "k 3"],
    config: CrossedConfig,
) -> Float[np.ndarray, "2"] | None:
    """What moves the first of two wires to the other corner; None where photos see them from more than two
    directions, or from one."""
    n = wire.base.n
    half = np.median(np.column_stack([between[:, :2] @ n, between[:, 2]]), axis=0) / 2
    rays = middles[len(middles) // 2] - photos.cameras.centre.numpy()[list(photos.train)]
    rays = rays[np.isfinite(photos.distances(middles[[len(middles) // 2]])[:, 0])]
    if len(rays) < config.least_photos:
        return None
    angles = np.sort(np.degrees(np.arctan2(rays[:, 2], rays[:, :2] @ n)) % HALF_TURN)
    gaps = np.diff(angles, append=angles[0] + HALF_TURN)
    widest = int(gaps.argmax())
    fan = np.concatenate([angles[widest + 1 :], angles[: widest + 1] + HALF_TURN])  # without a jump
    steps = np.diff(fan)
    cut = int(steps.argmax())
    groups = fan[: cut + 1], fan[cut + 1 :]
    if steps[cut] < config.distinct * max(np.ptp(groups[0]), np.ptp(groups[1]), config.least_deg):
        return None
    turned = np.radians([np.median(group) for group in groups])
    normals = np.column_stack([-np.sin(turned), np.cos(turned)])
    other = np.linalg.solve(normals, np.array([1.0, -1.0]) * (normals @ half))
    if np.linalg.norm(other) > config.near_m:
        return None
    return np.asarray(other - half)
