"""How far a survey's clearances are from the true ones: to the ground, and to the nearest plant.

One frame, metres.  As in surveys all is counted from a wire's axis.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CloughTocher2DInterpolator

from plnerf.line.clearances import Place, WireClearance
from plnerf.line.ends import TWO_SIDED_95
from plnerf.line.wire import Wire
from plnerf.score.config import WireScoreConfig
from plnerf.score.truth import TruePlant, Truth
from plnerf.score.wire_matches import Match, common_stretch

BESIDE_M = 1.0
"""So far beside a plant's crown, in plan, points are taken for it."""
RULES = {
    "ground": "the least height of the wire above the ground straight below it; of the true wire over the "
    "stretch that it shares with the conductor, above a smooth surface through the truth's points of the "
    "ground (piecewise cubic: Clough and Tocher)",
    "vegetation": "the least distance in space from any wire's axis to a plant; the truth's is that to the "
    "leaves of the plants whose clearance truth.json states and that stand between the ends of a conductor, "
    "with half the wire's diameter added; compared where the survey has the wire that is nearest to one; "
    "plants that too few images show, as truth.json states, count only where the survey "
    "finds them; not compared where what the survey states as nearest stands beyond a wire's end",
    "off_along": "how far apart along the line the two places are, horizontally",
    "within_95": f"the true distance lies within {TWO_SIDED_95} stated standard deviations, or below what is "
    "stated as an upper limit",
}


@dataclass(frozen=True)
class Compared:
    """One clearance, and the true one."""

    wire: str
    conductor: int
    """Id of the survey's."""
    true_m: float
    found_m: float | None
    """None: the survey states none."""
    sigma_m: float | None
    off_along_m: float | None
    """None where either place is not known."""
    at_most: bool = False
    """Whether the survey states an upper limit."""

    @property
    def error_m(self) -> float | None:
        """Found less true."""
        return None if self.found_m is None else self.found_m - self.true_m

    @property
    def within_95(self) -> bool | None:
        """None where no deviation is stated."""
        if self.error_m is None or self.sigma_m is None:
            return None
        if self.at_most and self.error_m > 0:
            return True
        return abs(self.error_m) <= TWO_SIDED_95 * self.sigma_m


@dataclass(frozen=True)
class ClearanceScore:
    """Of all matched wires."""

    ground: tuple[Compared, ...]
    vegetation: Compared | None
    """The least of all wires.  Its wire is the truth's, its conductor the survey's."""
    notes: tuple[str, ...]
    """What was not compared, and why."""


def score_clearances(
    matches: Sequence[Match],
    wires: Sequence[Wire],
    clearances: Sequence[WireClearance],
    truth: Truth,
    config: WireScoreConfig,
) -> ClearanceScore:
    """Compares what is stated of a survey's wires; `RULES` states how."""
    notes: list[str] = []
    return ClearanceScore(
        _ground(matches, wires, clearances, truth, config, notes),
        _vegetation(matches, wires, clearances, truth, notes),
        tuple(notes),
    )


def _ground(
    matches: Sequence[Match],
    wires: Sequence[Wire],
    clearances: Sequence[WireClearance],
    truth: Truth,
    config: WireScoreConfig,
    notes: list[str],
) -> tuple[Compared, ...]:
    if truth.ground is None:
        notes.append("The truth has no ground: clearances to it are not compared.")
        return ()
    surface = CloughTocher2DInterpolator(truth.ground[:, :2], truth.ground[:, 2])
    true = {wire.name: wire for wire in truth.wires}
    by_id = {one.id: one for one in wires}
    stated = {one.wire: one.vertical for one in clearances}
    rows = []
    for match in matches:
        found = by_id[match.conductor]
        row = _above_ground(true[match.wire], found, stated.get(match.conductor), surface, config)
        if row is None:
            notes.append(f"The truth has no ground below {match.wire}: its clearance is not compared.")
        else:
            rows.append(row)
    return tuple(rows)


def _above_ground(
    true: Wire,
    found: Wire,
    stated: Place | None,
    surface: CloughTocher2DInterpolator,
    config: WireScoreConfig,
) -> Compared | None:
    """None where no ground is known below."""
    base, shared = found.base, common_stretch(true, found, config)
    assert shared is not None  # it is a match
    on_wire = base.place(shared.s, shared.true)
    height = on_wire[:, 2] - surface(on_wire[:, :2])
    if np.isnan(height).all():
        return None
    least = int(np.nanargmin(height))
    off = None if stated is None else abs(float((stated.on_wire - on_wire[least])[:2] @ base.u))
    return Compared(
        true.name or "",
        found.id,
        float(height[least]),
        None if stated is None else stated.distance_m,
        None if stated is None else stated.sigma_m,
        off,
    )


def _vegetation(
    matches: Sequence[Match],
    wires: Sequence[Wire],
    clearances: Sequence[WireClearance],
    truth: Truth,
    notes: list[str],
) -> Compared | None:
    """Only the least of all wires: of a plant the truth knows the clearance of the nearest wire alone, which
    the survey must have."""
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
    along = [(one.base, float(one.base.local(plant.foot[None])[0, 0])) for one in wires]
    return any(0 <= s <= base.length_m for base, s in along)
