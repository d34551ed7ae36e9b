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
"""Nor are ends of wires, on average and with sags apart."""
PLACES = 25
"""Along a wire, where the two are compared."""


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
    a: Sequence[Wire], b: Sequence[Wire], curves_a: Sequence[Float[np.ndarray, "p 3"]]
) -> list[tuple[int, int]]:
    """Pairs of positions in the two.  curves_a: points along A's, from end to end, in B's frame."""
    if not a or not b:
        return []
    apart = np.array([[_apart(curve, wire) for wire in b] for curve in curves_a])
    return _pairs(apart, WIRE_M)


def _apart(curve: Float[np.ndarray, "p 3"], wire: Wire) -> float:
    """How far a curve's chord lies from a wire's, over the stretch that both have; infinite where they share
    less than half of the shorter."""
    local = wire.base.local(curve[[0, -1]])
    low, high = sorted(local[:, 0].tolist())
    length = wire.base.length_m
    shared = min(high, length) - max(low, 0.0)
    if shared < 0.5 * min(high - low, length):
        return float("inf")
    s = np.array([max(low, 0.0), min(high, length)])
    share = (s - local[0, 0]) / (local[1, 0] - local[0, 0])
    chord = local[:1, 1:] + share[:, None] * (local[1:, 1:] - local[:1, 1:])
    ends = wire.at(np.array([0.0, length]))
    own = ends[:1] + (s / length)[:, None] * (ends[1:] - ends[:1])
    return float(np.linalg.norm(chord - own, axis=1).mean())


def _pairs(apart: Float[np.ndarray, "n m"], most: float) -> list[tuple[int, int]]:
    rows, columns = linear_sum_assignment(np.minimum(apart, 1e3 * most))
    pairs = zip(rows.tolist(), columns.tolist(), strict=True)
    return [(i, j) for i, j in pairs if apart[i, j] <= most]
