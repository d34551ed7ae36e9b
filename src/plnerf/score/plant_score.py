"""How far a survey's distances to plants are from the true ones: the least of all, and each wire's.

One frame, metres.  As in surveys all is counted from a wire's axis.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from plnerf.line.clearances import Place, WireClearance
from plnerf.line.wire import Wire
from plnerf.score.compared import Compared
from plnerf.score.true_plants import TruePlant
from plnerf.score.truth import Truth
from plnerf.score.wire_matches import Match

BESIDE_M = 1.0
"""So far beside a plant's crown, in plan, points are taken for it."""


def nearest_of_all(
    matches: Sequence[Match],
    wires: Sequence[Wire],
    clearances: Sequence[WireClearance],
    truth: Truth,
    notes: list[str],
) -> Compared | None:
    """The least of all wires, of which the survey must have the one that is nearest to the true plant."""
    stated = [place for one in clearances if (place := one.least("vegetation")) is not None]
    found = min(stated, key=lambda place: place.distance_m, default=None)
    every = [plant for plant in truth.plants if _beside(plant, wires)]
    plants = [
        one for one in every if one.observable or (found is not None and _is_at(one, found.on_obstacle))
    ]
    at_end = found is not None and _is_beyond(found.on_obstacle, truth.plants, every)
    if not plants or truth.houses or found is None or at_end:
        why = (
            f"the truth has {truth.houses} houses, which surveys do not distinguish from plants"
            if truth.houses
            else "the truth has none"
            if not truth.plants
            else "the truth has none between the conductors' ends"
            if not every
            else "too few images show one of the truth's"
            if not plants
            else "the nearest that the survey states stands beyond a wire's end and reaches beside the wire; "
            "how near that part is the truth does not say"
            if at_end
            else "the survey states no distance to any"
        )
        notes.append(f"Distances to plants are not compared: {why}.")
        return None
    radius = {wire.name: (wire.diameter_m or 0.0) / 2 for wire in truth.wires}
    axis_m = {plant: plant.clearance_m + radius.get(plant.wire, 0.0) for plant in every}
    nearest = min(plants, key=axis_m.__getitem__)
    nearer = sorted(axis_m[plant] for plant in every if axis_m[plant] < axis_m[nearest])
    if nearer:
        notes.append(
            f"Of the truth's plants {len(nearer)}, the nearest {nearer[0]:.2f} m from a wire, are "
            "shown by too few images: the nearest of the others is compared."
        )
    by_wire = {match.wire: match.conductor for match in matches}
    if nearest.wire not in by_wire:
        notes.append(
            f"Distances to plants are not compared: the nearest is {axis_m[nearest]:.2f} m from "
            f"{nearest.wire}, which the survey does not have."
        )
        return None
    mine = (found.wire, by_wire[nearest.wire])
    limits = any(place.at_most for place in stated if place.wire in mine)
    stated_m = (found.distance_m, found.sigma_m)
    return Compared(nearest.wire, found.wire, axis_m[nearest], *stated_m, None, limits)


def nearest_of_each(
    matches: Sequence[Match],
    wires: Sequence[Wire],
    clearances: Sequence[WireClearance],
    truth: Truth,
) -> tuple[Compared, ...]:
    """Of every matched wire with true leaves beside it.  None where the truth has houses, which surveys may
    take for plants."""
    if truth.houses:
        return ()
    by_id, stated = {one.id: one for one in wires}, {one.wire: one.least("vegetation") for one in clearances}
    radius = {wire.name: (wire.diameter_m or 0.0) / 2 for wire in truth.wires}
    rows = []
    for match in matches:
        place, wire = stated.get(match.conductor), by_id[match.conductor]
        row = _nearest_of(wire, match.wire, radius[match.wire], place, truth.plants)
        rows += [] if row is None else [row]
    return tuple(rows)


def _nearest_of(
    wire: Wire, name: str, radius_m: float, place: Place | None, plants: Sequence[TruePlant]
) -> Compared | None:
    """name, radius_m: of the true wire; place: what is stated as nearest."""
    if place is not None and not _is_between(place.on_obstacle, wire):
        return None  # things beyond a structure at which the line bends are a wire's, too
    shown = [
        leaf
        for plant in plants
        for leaf in plant.leaves
        if leaf.wire == name
        and _is_between(leaf.place, wire)
        and (leaf.observable or (place is not None and _is_at(plant, place.on_obstacle)))
    ]
    if not shown:
        return None
    nearest = min(shown, key=lambda leaf: leaf.clearance_m)
    true_m = nearest.clearance_m + radius_m
    if place is None:
        return Compared(name, wire.id, true_m, None, None, None)
    off_m = abs(float((place.on_obstacle - nearest.place)[:2] @ wire.base.u))
    return Compared(name, wire.id, true_m, place.distance_m, place.sigma_m, off_m, place.at_most)


def _is_beyond(
    place: Float[np.ndarray, "3"], plants: Sequence[TruePlant], beside: Sequence[TruePlant]
) -> bool:
    """Whether a point lies in a plant, and in none that stands beside a wire."""
    return any(_is_at(one, place) for one in plants) and not any(_is_at(one, place) for one in beside)


def _is_at(plant: TruePlant, place: Float[np.ndarray, "3"]) -> bool:
    """Whether a point lies within a plant's crown or a metre beside it, in plan."""
    return bool(np.linalg.norm(place[:2] - plant.foot[:2]) <= plant.radius_m + BESIDE_M)


def _beside(plant: TruePlant, wires: Sequence[Wire]) -> bool:
    """Whether it stands between the ends of a wire."""
    return any(_is_between(plant.foot, one) for one in wires)


def _is_between(place: Float[np.ndarray, "3"], wire: Wire) -> bool:
    """Whether a place lies between the ends of a wire, in plan."""
    return bool(0 <= wire.base.local(place[None])[0, 0] <= wire.base.length_m)
