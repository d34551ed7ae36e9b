"""Two wires side by side whose images were paired crosswise.

Where all photos look at two parallel wires from two directions only, as those of a flight to and fro do, a
photo of the one and a photo of the other see two lines each, and which belong together they do not say.  Seen
across the wires, the lines of sight are the sides of a parallelogram: the wires are at two opposite corners,
and at the other two the same lines cross.  With h half of the way from wire to wire across them, and n_1, n_2
normals of the two directions, the other pair of corners is at +-h', where

    n_1 . h' = n_1 . h,    n_2 . h' = -n_2 . h

No photo looks quite as the others of its direction: of the right pair more is seen.  Lines of sight turn as
the wires sag, so that a wrong pair hangs less alike in the middle than wires side by side do.  Where neither
decides, the intervals of both wires hold both places.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from plnerf.line.curve import curve_at
from plnerf.line.ends import TWO_SIDED_95
from plnerf.line.two_directions import by_ends_and_middle, second_direction, through_sights
from plnerf.line.wire import Wire
from plnerf.survey.posed_photos import Photos
from plnerf.survey.refine.config import CrossedConfig, RefineConfig
from plnerf.survey.refine.refine import Refinement, refine_wires
from plnerf.survey.refine.twins import side_by_side

SHARES = np.linspace(0.1, 0.9, 9)
"""Places along wires that are compared."""
BY_THETA = by_ends_and_middle(SHARES)
"""How y, and z, at SHARES depend on their values at both ends and on the middle's offset from the chord."""


@dataclass(frozen=True, eq=False)
class Pair:
    """Two wires by their indices, and theta of each at its other corner."""

    one: int
    other: int
    thetas: Float[np.ndarray, "2 6"]


def uncrossed(photos: Photos, refined: Refinement, config: RefineConfig) -> Refinement:
    """The wires of a span with the pairs at their other corners that the photos show better there, and with
    intervals that hold both places where they show them about as well.

    refined: of the span, on one common base; photos: those that show it, at their full size.
    """
    pairs = _pairs(photos, refined.wires, config.crossed)
    if not pairs:
        return refined
    crossed = refitted(photos, refined, pairs, config)
    pairs = [pair for pair in pairs if _differ(refined, crossed, pair) > config.crossed.same_m]
    better = [pair for pair in pairs if _better(crossed, refined, pair, config.crossed)]
    doubted = [
        pair for pair in pairs if pair not in better and not _better(refined, crossed, pair, config.crossed)
    ]
    found = refitted(photos, refined, better, config) if 0 < len(better) < len(pairs) else crossed
    found = found if better else refined
    return _doubted(found, doubted) if doubted else found


def _better(one: Refinement, other: Refinement, pair: Pair, config: CrossedConfig) -> bool:
    """Whether more is seen of a pair in one fit than in the other, or about as much, and it hangs alike."""
    seen, seen_there = seen_of(one, pair), seen_of(other, pair)
    if max(seen, seen_there) > config.least_more * min(seen, seen_there):
        return seen > seen_there
    unlike, unlike_there = (
        max(float(np.linalg.norm(_hang(fit.wires[pair.one]) - _hang(fit.wires[pair.other]))), config.alike_m)
        for fit in (one, other)
    )
    return unlike_there >= config.least_unlike * unlike


def seen_of(fit: Refinement, pair: Pair) -> int:
    """At how many places, of all images, its two wires stand out."""
    return fit.counts[pair.one] + fit.counts[pair.other]


def refitted(
    photos: Photos, refined: Refinement, pairs: Sequence[Pair], config: RefineConfig
) -> Refinement:
    """With pairs at their other corners.

    It begins with the widths that are learnt: a bar of the assumed one may leave the wire on which it is put.
    """
    moved = _moved(refined.wires, pairs)
    return refine_wires(photos, moved, config, widths=refined.widths, light=refined.given_light)


def _differ(one: Refinement, other: Refinement, pair: Pair) -> float:
    """How far the two wires of a pair move between two fits; wires that change places do not move."""
    s, both = SHARES * one.wires[0].base.length_m, (pair.one, pair.other)
    here, there = (np.array([fit.wires[k].points(s) for k in both]) for fit in (one, other))
    apart = [np.linalg.norm(here - wires, axis=2) for wires in (there, there[::-1])]
    return float(min(np.median(each, axis=1).max() for each in apart))


def _doubted(refined: Refinement, pairs: Sequence[Pair]) -> Refinement:
    """With intervals that hold the other corner, and a note."""
    wires = list(refined.wires)
    for pair in pairs:
        for k, theta in zip((pair.one, pair.other), pair.thetas, strict=True):
            one, covariance, move = wires[k], np.zeros((6, 6)), theta[:4] - wires[k].theta[:4]
            covariance[:4, :4] = np.outer(move, move) / TWO_SIDED_95**2
            away = float(np.linalg.norm(move)) / np.sqrt(2)  # of both ends, the root of the mean square
            text = (
                "Photos see it and the wire beside it from two directions only: it may as well be "
                f"{away:.2f} m away, where the same lines of sight cross."
            )
            wires[k] = replace(one, covariance=one.covariance + covariance, notes=(*one.notes, text))
    return replace(refined, wires=tuple(wires))


def _moved(wires: Sequence[Wire], pairs: Sequence[Pair]) -> list[Wire]:
    found = list(wires)
    for pair in pairs:
        for k, theta in zip((pair.one, pair.other), pair.thetas, strict=True):
            found[k] = replace(wires[k], theta=theta)
    return found


def _pairs(photos: Photos, wires: Sequence[Wire], config: CrossedConfig) -> list[Pair]:
    """Wires that are each other's nearest, and that photos see from two directions only."""
    if not wires:
        return []
    s = SHARES * wires[0].base.length_m
    places = np.array([wire.points(s) for wire in wires])
    found = []
    for i, j in side_by_side(places, config.near_m):
        thetas = _other_corners(photos, (wires[i], wires[j]), places[[i, j]], config)
        if thetas is not None:
            found.append(Pair(i, j, thetas))
    return found


def _other_corners(
    photos: Photos, wires: tuple[Wire, Wire], places: Float[np.ndarray, "2 k 3"], config: CrossedConfig
) -> Float[np.ndarray, "2 6"] | None:
    """theta of two wires at the other corners; None where photos see them from more than two directions, or
    from one.

    places: on both wires, at SHARES of their length.
    """
    centres = photos.cameras.centre.numpy()[list(photos.train)]
    sees = np.isfinite(photos.distances(places.mean(0)))
    centres, sees = centres[sees.any(1)], sees[sees.any(1)]
    if len(centres) < config.least_photos:
        return None
    base = wires[0].base
    # From each photo to the middle of both: how they sag turns the lines of sight of all photos alike.
    rays = places.mean((0, 1)) - centres
    angles = np.degrees(np.arctan2(rays[:, 2], rays[:, :2] @ base.n))
    second = second_direction(angles, config.distinct, config.least_deg)
    if second is None:
        return None
    eyes = np.stack([(centres[:, :2] - base.a) @ base.n, centres[:, 2]], -1)
    across = np.array([base.local(one)[:, 1:] for one in places])
    thetas = []
    for k in (0, 1):
        targets = np.where(second[:, None, None], across[1 - k], across[k])
        thetas.append(_crossing(wires[k], wires[1 - k], eyes, sees, targets, config))
    at = np.array([curve_at(theta, base.length_m, SHARES * base.length_m) for theta in thetas])
    moved = min(np.linalg.norm(at - other, axis=2).max() for other in (across, across[::-1]))
    if np.linalg.norm(at[0] - at[1], axis=1).max() > 2 * config.near_m or moved <= config.same_m:
        return None  # too far to be meant, the same places, or each other's
    return np.array(thetas)


def _crossing(
    wire: Wire,
    beside: Wire,
    eyes: Float[np.ndarray, "t 2"],
    sees: Bool[np.ndarray, "t k"],
    targets: Float[np.ndarray, "t k 2"],
    config: CrossedConfig,
) -> Float[np.ndarray, "6"]:
    """theta of the curve through the lines from eyes to targets, across the base, by least squares of angles.

    Its sag and its swing, of which each piece tells little, are near to the mean of both wires'.
    """
    hang = (_hang(wire) + _hang(beside)) / 2
    (y_a, y_b, y), (z_a, z_b, z) = through_sights(eyes, sees, targets, SHARES, hang, config.parallel_m)
    return np.array([y_a, y_b, z_a, z_b, np.hypot(y, z), np.arctan2(y, -z)])


def _hang(wire: Wire) -> Float[np.ndarray, "2"]:
    """y and z of its middle, from the chord's."""
    *_, bend, swing = wire.theta
    return bend * np.array([np.sin(swing), -np.cos(swing)])
