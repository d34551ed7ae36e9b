"""How far a survey's structures are from the true ones, and whether it has their kind and their line angle.

Horizontal lengths, metres; both in one frame.  Where a structure stands along its line is measured along the
mean direction of the true wires that it holds.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

from plnerf.line.ends import Attached
from plnerf.line.line import Structure
from plnerf.line.wire import Wire
from plnerf.score.config import WireScoreConfig

NEAR_M = 1.0
"""Clamps and insulators hide the last piece of a wire."""


@dataclass(frozen=True)
class SupportMatch:
    """One true structure and the survey's that is it."""

    name: str
    """Of the true one."""
    structure: int
    """Id of the survey's."""
    kind: str
    kind_found: str
    along_m: float
    """Found less true, along the line."""
    across_m: float
    """Found less true, to the line's left."""
    line_angle_deg: float | None
    """None where the line does not go on."""
    line_angle_found_deg: float | None


@dataclass(frozen=True)
class SupportMatches:
    """Which true structures a survey has."""

    matches: tuple[SupportMatch, ...]
    missing: tuple[str, ...]
    """Names of true structures that a wire hangs on whose end there is seen, but that the survey has not."""
    invented: tuple[int, ...]
    """Ids of structures that stand at no true one."""


def match_supports(
    found: Sequence[Structure], true: Sequence[Structure], wires: Sequence[Wire], config: WireScoreConfig
) -> SupportMatches:
    """One to one, with the least sum of distances; `wires` are the true ones."""
    none = (len(true) + len(found) + 1) * config.support_m
    distance = np.full((len(true), len(found)), none)
    for i, one in enumerate(true):
        for j, other in enumerate(found):
            away = float(np.linalg.norm((other.foot - one.foot)[:2]))
            if away <= config.support_m:
                distance[i, j] = away
    pairs = [(int(i), int(j)) for i, j in zip(*linear_sum_assignment(distance), strict=True)]
    pairs = sorted((i, j) for i, j in pairs if distance[i, j] < none)
    matched, used = {i for i, _ in pairs}, {j for _, j in pairs}
    return SupportMatches(
        tuple(_match(true[i], found[j], wires) for i, j in pairs),
        tuple(_name(one) for i, one in enumerate(true) if i not in matched and _seen(one, wires)),
        tuple(other.id for j, other in enumerate(found) if j not in used),
    )


def _match(true: Structure, found: Structure, wires: Sequence[Wire]) -> SupportMatch:
    u = _direction(true, wires)
    off = (found.foot - true.foot)[:2]
    return SupportMatch(
        name=_name(true),
        structure=found.id,
        kind=true.kind,
        kind_found=found.kind,
        along_m=float(off @ u),
        across_m=float(off @ np.array([-u[1], u[0]])),
        line_angle_deg=true.line_angle_deg,
        line_angle_found_deg=found.line_angle_deg,
    )


def _direction(structure: Structure, wires: Sequence[Wire]) -> Float[np.ndarray, "2"]:
    """Mean of the bases' directions of the wires that it holds; x where it holds none."""
    held = [wire.base.u for wire in wires if any(_holds(structure, wire, end) for end in (0, 1))]
    total = np.sum(held, axis=0) if held else np.array([1.0, 0.0])
    u: Float[np.ndarray, 2] = total / np.linalg.norm(total)
    return u


def _holds(structure: Structure, wire: Wire, end: int) -> bool:
    one = wire.ends[end]
    return isinstance(one, Attached) and one.structure == structure.id


def _seen(structure: Structure, wires: Sequence[Wire]) -> bool:
    """Whether images show a wire up to NEAR_M from where this structure holds it, on either side."""
    for wire in wires:
        for end, at in ((0, 0.0), (1, wire.base.length_m)):
            if _holds(structure, wire, end):
                stretches = wire.evidence.seen_m
                gaps = [abs(edge - at) for stretch in stretches or () for edge in stretch]
                if stretches is None or min(gaps, default=np.inf) <= NEAR_M:
                    return True
    return False


def _name(structure: Structure) -> str:
    return structure.name or f"structure {structure.id}"
