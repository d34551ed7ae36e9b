"""Two wires side by side whose images were paired crosswise.

Where all photos look at two parallel wires from two directions only, as those of a flight to and fro do, a
photo of the one and a photo of the other see two lines each, and which belong together they do not say.  Seen
across the wires, the lines of sight are the sides of a parallelogram: the wires are at two opposite corners,
and at the other two the same lines cross.  With h half of the way from wire to wire across them, and n_1, n_2
normals of the two directions, the other pair of corners is at +-h', where

    n_1 . h' = n_1 . h,    n_2 . h' = -n_2 . h

All that tells both apart is that no photo looks quite as the others of its direction: of the right pair more
is seen.  Where that does not tell, the intervals of both wires hold both places.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from plnerf.line.ends import TWO_SIDED_95
from plnerf.line.wire import Wire
from plnerf.survey.posed_photos import Photos
from plnerf.survey.refine.config import CrossedConfig, RefineConfig
from plnerf.survey.refine.refine import Refinement, refine_wires

HALF_TURN = 180.0
SHARES = np.linspace(0.1, 0.9, 9)
"""Places along wires that are compared."""


@dataclass(frozen=True, eq=False)
class _Pair:
    """Two wires by their indices, and what moves the first one to its other corner, y and z; the second
    moves by the opposite."""

    one: int
    other: int
    move: Float[np.ndarray, "2"]


def uncrossed(photos: Photos, refined: Refinement, config: RefineConfig) -> Refinement:
    """The wires of a span with the pairs at their other corners of which the photos show more there, and with
    intervals that hold both places where they show about as much.

    refined: of the span, on one common base; photos: those that show it, at their full size.
    """
    pairs = _pairs(photos, refined.wires, config.crossed)
    if not pairs:
        return refined
    rounds = config.crossed.rounds  # it begins near to where it ends
    few = replace(config, least_rounds=min(config.least_rounds, rounds), most_rounds=rounds)
    crossed = refine_wires(photos, _moved(refined.wires, pairs), few)
    pairs = [pair for pair in pairs if _differ(refined, crossed, pair) > config.crossed.same_m]
    more = config.crossed.least_more
    better = [pair for pair in pairs if _seen(crossed, pair) > more * _seen(refined, pair)]
    sure = [pair for pair in pairs if _seen(refined, pair) >= more * _seen(crossed, pair)]
    doubted = [pair for pair in pairs if pair not in better and pair not in sure]
    found = refine_wires(photos, _moved(refined.wires, better), config) if better else refined
    return _doubted(found, doubted) if doubted else found


def _differ(one: Refinement, other: Refinement, pair: _Pair) -> float:
    """How far the two wires of a pair are in one fit from where they are in the other, whichever is which."""
    s, both = SHARES * one.wires[0].base.length_m, (pair.one, pair.other)
    here, there = (np.array([fit.wires[k].points(s) for k in both]) for fit in (one, other))
    apart = [np.linalg.norm(here - wires, axis=2) for wires in (there, there[::-1])]
    return float(min(np.median(each, axis=1).max() for each in apart))


def _doubted(refined: Refinement, pairs: Sequence[_Pair]) -> Refinement:
    """With intervals that hold the other corner, and a note."""
    wires = list(refined.wires)
    for pair in pairs:
        away = float(np.linalg.norm(pair.move))
        covariance = np.zeros((6, 6))
        covariance[:4, :4] = np.kron(np.outer(pair.move, pair.move), np.ones((2, 2))) / TWO_SIDED_95**2
        text = (
            "Photos see it and the wire beside it from two directions only: it may as well be "
            f"{away:.2f} m away, where the same lines of sight cross."
        )
        for k in (pair.one, pair.other):
            one = wires[k]
            wires[k] = replace(one, covariance=one.covariance + covariance, notes=(*one.notes, text))
    return replace(refined, wires=tuple(wires))


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
    moved = min(np.linalg.norm(other - half), np.linalg.norm(other + half))  # the latter: each other's place
    if np.linalg.norm(other) > config.near_m or moved <= config.same_m:
        return None
    return np.asarray(other - half)
