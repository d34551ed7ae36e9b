"""Which structures and wires of two surveys are the same: by place, one to one."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

from plnerf.line.line import Structure
from plnerf.line.wire import Wire

STRUCTURE_M = 5.0
"""Feet that are farther apart than this are not of one structure."""
WIRE_M = 2.5
"""Nor are the ends of wires' chords, on average."""


def same_structures(
    a: Sequence[Structure], b: Sequence[Structure], feet_a: Float[np.ndarray, "n 3"]
) -> list[tuple[int, int]]:
    """Pairs of positions in the two.  feet_a: of A's in B's frame."""
    if not a or not b:
        return []
    feet_b = np.array([one.foot for one in b])
    apart = np.linalg.norm(feet_a[:, None, :2] - feet_b[None, :, :2], axis=2)
    return _pairs(apart, STRUCTURE_M)


def same_wires(
    chords_a: Sequence[Float[np.ndarray, "2 3"]], b: Sequence[Wire]
) -> list[tuple[int, int]]:
    """Pairs of positions in the two.  chords_a: both ends of A's wires, in B's frame."""
    if not chords_a or not b:
        return []
    apart = np.array([[_apart(chord, wire) for wire in b] for chord in chords_a])
    return _pairs(apart, WIRE_M)


def _apart(ends: Float[np.ndarray, "2 3"], wire: Wire) -> float:
    """How far a chord lies from a wire's, over the stretch that both have; infinite where they share half
    of the shorter or less."""
    local = wire.base.local(ends)
    low, high = sorted(local[:, 0].tolist())
    length = wire.base.length_m
    shared = min(high, length) - max(low, 0.0)
    if shared <= 0.5 * min(high - low, length):
        return float("inf")
    s = np.array([max(low, 0.0), min(high, length)])
    share = (s - local[0, 0]) / (local[1, 0] - local[0, 0])
    chord = local[:1, 1:] + share[:, None] * (local[1:, 1:] - local[:1, 1:])
    first, last = wire.at(np.array([0.0, length]))
    own = first + (s / length)[:, None] * (last - first)
    return float(np.linalg.norm(chord - own, axis=1).mean())


def _pairs(apart: Float[np.ndarray, "n m"], most: float) -> list[tuple[int, int]]:
    rows, columns = linear_sum_assignment(np.minimum(apart, 1e3 * most))
    pairs = zip(rows.tolist(), columns.tolist(), strict=True)
    return [(i, j) for i, j in pairs if apart[i, j] <= most]
