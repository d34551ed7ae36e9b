"""Pieces of one wire that were detected as several.

After the refit two curves of a span that run at the same place are one wire: a piece beside a structure
and the rest of it, or the two edges of a wire that is ten pixels wide.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from plnerf.line.wire import Wire
from plnerf.survey.chains import Chain

PLACES = 21


def single_wires(
    detected: Sequence[Chain], refined: Sequence[Chain], shown: Sequence[bool], same_m: float
) -> list[Wire]:
    """The detected wires that the images show, in their order, each once: the longest piece of a wire over
    the extent of all of them.

    refined: the same wires after the refit.  shown: of each wire, in the order of `wires_of`.  Pieces of one
    wire are nowhere farther than `same_m` from the longest one's curve.
    """
    kept, seen = list[Wire](), iter(shown)
    for before, after in zip(detected, refined, strict=True):
        for span, fitted in zip(before, after, strict=True):
            pieces = [pair for pair in zip(span.wires, fitted.wires, strict=True) if next(seen)]
            kept += _joined(pieces, same_m)
    return kept


def _joined(pieces: Sequence[tuple[Wire, Wire]], same_m: float) -> list[Wire]:
    """Of each wire of a span its longest piece, extended over all of them.  pieces: each with its refit."""
    owner = dict[int, int]()
    for k in sorted(range(len(pieces)), key=lambda k: -pieces[k][0].base.length_m):
        wire, fitted = pieces[k]
        low, high = _extent(wire, fitted)
        points = fitted.points(np.linspace(low, high, PLACES))
        same = [j for j in owner if owner[j] == j and _off(points, pieces[j][1]) <= same_m]
        owner[k] = min(same, key=lambda j: _off(points, pieces[j][1]), default=k)
    joined = []
    for k in sorted(owner):
        if owner[k] == k:
            wire = pieces[k][0]
            ends = [s for j, one in owner.items() if one == k for s in _extent(pieces[j][0], wire)]
            joined.append(wire.between(min(ends), max(ends)))
    return joined


def _extent(wire: Wire, along: Wire) -> tuple[float, float]:
    """Start and end of a wire, counted along the base of another one."""
    first, last = sorted(float((end - along.base.a) @ along.base.u) for end in (wire.base.a, wire.base.b))
    return first, last


def _off(points: Float[np.ndarray, "n 3"], wire: Wire) -> float:
    """The greatest distance of points from a wire's curve, which goes on beyond its ends."""
    there = wire.base.local(points)
    return float(np.linalg.norm(there[:, 1:] - wire.at(there[:, 0]), axis=1).max())
