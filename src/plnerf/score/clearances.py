"""How far a survey's clearances are from the true ones: to the ground, and to the nearest plant.

World frame, metres.  As in `survey/clearance.py` all is counted from a wire's axis.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CloughTocher2DInterpolator

from plnerf.report.data import TWO_SIDED_95, Clearance
from plnerf.score.truth import TruePlant, TrueWire, WireTruth
from plnerf.score.wires import Match, common_stretch
from plnerf.survey.model import Conductor

DOWN, PLANTS = "ground, straight down", "vegetation"
"""What survey.json calls them."""

RULES = {
    "ground": "the least height of the wire above the ground straight below it; of the true wire over the "
    "stretch that it shares with the conductor, above a smooth surface through the truth's points of the "
    "ground (piecewise cubic: Clough and Tocher)",
    "vegetation": "the least distance in space from any wire's axis to a plant; the truth's is that to the "
    "leaves of the plants whose clearance truth.json states and that stand between the ends of a conductor, "
    "with half the wire's diameter added",
    "off_along": "how far apart along the line the two places are, horizontally",
    "within_95": f"the true distance lies within {TWO_SIDED_95} stated standard deviations",
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

    @property
    def error_m(self) -> float | None:
        return None if self.found_m is None else self.found_m - self.true_m

    @property
    def within_95(self) -> bool | None:
        """None where no deviation is stated."""
        if self.error_m is None or self.sigma_m is None:
            return None
        return abs(self.error_m) <= TWO_SIDED_95 * self.sigma_m


@dataclass(frozen=True)
class ClearanceScore:
    """Of all matched conductors."""

    ground: tuple[Compared, ...]
    vegetation: Compared | None
    """The least of all wires.  Its wire is the truth's, its conductor the survey's."""
    notes: tuple[str, ...]
    """What was not compared, and why."""


def score_clearances(
    matches: Sequence[Match],
    conductors: Sequence[Conductor],
    clearances: Sequence[Clearance],
    truth: WireTruth,
) -> ClearanceScore:
    """Compares; `RULES` says how in words."""
    notes: list[str] = []
    return ClearanceScore(
        _ground(matches, conductors, clearances, truth, notes),
        _vegetation(conductors, clearances, truth, notes),
        tuple(notes),
    )


def _ground(
    matches: Sequence[Match],
    conductors: Sequence[Conductor],
    clearances: Sequence[Clearance],
    truth: WireTruth,
    notes: list[str],
) -> tuple[Compared, ...]:
    if truth.ground is None:
        notes.append("The truth says nothing of the ground: clearances to it are not compared.")
        return ()
    surface = CloughTocher2DInterpolator(truth.ground[:, :2], truth.ground[:, 2])
    wires = {wire.name: wire for wire in truth.wires}
    by_id = {one.id: one for one in conductors}
    stated = {one.conductor: one for one in clearances if one.to == DOWN}
    rows = []
    for match in matches:
        row = _above_ground(
            wires[match.wire], by_id[match.conductor], stated.get(match.conductor), surface
        )
        if row is None:
            notes.append(f"The truth has no ground below {match.wire}: its clearance is not compared.")
        else:
            rows.append(row)
    return tuple(rows)


def _above_ground(
    wire: TrueWire, conductor: Conductor, stated: Clearance | None, surface: CloughTocher2DInterpolator
) -> Compared | None:
    """None where no ground is known below."""
    base, shared = conductor.fit.base, common_stretch(wire, conductor)
    assert shared is not None  # it is a match
    flat = base.o + shared.s[:, None] * base.u + shared.true[:, :1] * base.n
    height = shared.true[:, 1] - surface(flat)
    if np.isnan(height).all():
        return None
    least = int(np.nanargmin(height))
    off = None if stated is None else abs(float((stated.on_wire[:2] - flat[least]) @ base.u))
    return Compared(
        wire.name,
        conductor.id,
        float(height[least]),
        None if stated is None else stated.distance_m,
        None if stated is None else stated.sigma_m,
        off,
    )


def _vegetation(
    conductors: Sequence[Conductor], clearances: Sequence[Clearance], truth: WireTruth, notes: list[str]
) -> Compared | None:
    """Only the least of all wires: of a plant the truth knows the clearance of the nearest wire alone."""
    found = min(
        (one for one in clearances if one.to == PLANTS), key=lambda one: one.distance_m, default=None
    )
    plants = [plant for plant in truth.plants if _beside(plant, conductors)]
    if not plants or truth.houses or found is None:
        why = (
            f"the truth has {truth.houses} houses, which surveys do not tell from plants"
            if truth.houses
            else "the truth says nothing of them"
            if not truth.plants
            else "the truth has none between the conductors' ends"
            if not plants
            else "the survey states no distance to any"
        )
        notes.append(f"Distances to plants are not compared: {why}.")
        return None
    radius = {wire.name: wire.diameter_m / 2 for wire in truth.wires}
    axis_m = {plant: plant.clearance_m + radius.get(plant.wire, 0.0) for plant in plants}
    nearest = min(axis_m, key=axis_m.__getitem__)
    return Compared(nearest.wire, found.conductor, axis_m[nearest], found.distance_m, found.sigma_m, None)


def _beside(plant: TruePlant, conductors: Sequence[Conductor]) -> bool:
    """Whether it stands between the ends of a conductor."""
    along = [(one.fit.base, float(one.fit.base.local(plant.foot[None])[0, 0])) for one in conductors]
    return any(0 <= s <= base.length_m for base, s in along)
