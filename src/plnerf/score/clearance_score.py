"""How far a survey's clearances are from the true ones: to the ground, and to the nearest plant.

One frame, metres.  As in surveys all is counted from a wire's axis.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CloughTocher2DInterpolator

from plnerf.line.clearances import Place, WireClearance
from plnerf.line.ends import TWO_SIDED_95
from plnerf.line.wire import Wire
from plnerf.score.compared import Compared
from plnerf.score.config import WireScoreConfig
from plnerf.score.plant_score import nearest_of_all, nearest_of_each
from plnerf.score.truth import Truth
from plnerf.score.wire_matches import Match, common_stretch

RULES = {
    "ground": "the least height of the wire above the ground straight below it; of the true wire over the "
    "stretch that it shares with the conductor, above a smooth surface through the truth's points of the "
    "ground (piecewise cubic: Clough and Tocher)",
    "vegetation": "the least distance in space from any wire's axis to a plant; the truth's is that to the "
    "leaves of the plants whose clearance truth.json states and that stand between the ends of a conductor, "
    "with half the wire's diameter added; compared where the survey has the wire that is nearest to one; "
    "plants that too few images show, as truth.json states, count only where the survey "
    "finds them; not compared where what the survey states as nearest stands beyond a wire's end",
    "vegetation_of_wires": "the same of each wire that the survey has, to the leaves that are nearest to it; "
    "those beyond the ends of the survey's wire do not count",
    "off_along": "how far apart along the line the two places are, horizontally",
    "within_95": f"the true distance lies within {TWO_SIDED_95} stated standard deviations, or below what is "
    "stated as an upper limit",
}


@dataclass(frozen=True)
class ClearanceScore:
    """Of all matched wires."""

    ground: tuple[Compared, ...]
    vegetation: Compared | None
    """The least of all wires.  Its wire is the truth's, its conductor the survey's."""
    vegetation_of_wires: tuple[Compared, ...]
    """Of every wire to the plant that is nearest to it."""
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
        nearest_of_all(matches, wires, clearances, truth, notes),
        nearest_of_each(matches, wires, clearances, truth),
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
