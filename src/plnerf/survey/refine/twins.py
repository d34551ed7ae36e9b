"""Wires that run side by side."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from plnerf.line.base import Base
from plnerf.line.wire import Wire


@dataclass(frozen=True)
class Twins:
    """Two wires of a bundle, by their indices, and where along their common base there are both."""

    one: int
    other: int
    from_m: float
    to_m: float


def twins_of(
    wires: Sequence[Wire], base: Base, places: Float[np.ndarray, "w k 2"], near_m: float
) -> tuple[Twins, ...]:
    """places: of every wire, y and z on the base at the same places along it."""
    ends = np.sort([[(end - base.a) @ base.u for end in (wire.base.a, wire.base.b)] for wire in wires])
    pairs = side_by_side(places, near_m)
    both = [(i, j, max(ends[i, 0], ends[j, 0]), min(ends[i, 1], ends[j, 1])) for i, j in pairs]
    return tuple(Twins(i, j, float(low), float(high)) for i, j, low, high in both if low < high)


def side_by_side(places: Float[np.ndarray, "w k d"], near_m: float) -> tuple[tuple[int, int], ...]:
    """Pairs of wires that are each other's nearest and, at half of their places or more, no farther apart.

    places: of every wire on the same planes across a span, metres.
    """
    if len(places) < 2:
        return ()
    apart = np.median(np.linalg.norm(places[:, None] - places, axis=3), axis=2)
    np.fill_diagonal(apart, np.inf)
    nearest = apart.argmin(1).tolist()
    return tuple(
        (i, j) for i, j in enumerate(nearest) if i < j and nearest[j] == i and apart[i, j] <= near_m
    )
