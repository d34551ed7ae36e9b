"""Wires between the structures that hold them, and lines of them."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain, pairwise

import numpy as np
from jaxtyping import Float

from plnerf.line.base import Base
from plnerf.line.ends import Attached, End, Open
from plnerf.line.line import Line, Span, Structure
from plnerf.line.wire import Wire
from plnerf.survey.chains import Chain, with_wires
from plnerf.survey.span_wires import crossing, rewired
from plnerf.survey.support import Support, Supports

Hold = Float[np.ndarray, "2"] | None
"""Where a structure holds one end of a wire, as s on its base, and the standard deviation of that."""
LEAST_M = 0.5
"""No wire between two structures is shorter."""
OUTSIDE = Open("what the images show of it lies outside of the span between the structures")


def trimmed(chains: Sequence[Chain], supports: Supports) -> tuple[Chain, ...]:
    """The chains without what was detected of their wires beyond the structures that hold them."""

    def cut(wire: Wire, first: Hold, last: Hold) -> Wire:
        low = 0.0 if first is None else max(0.0, float(first[0]))
        high = wire.base.length_m if last is None else min(wire.base.length_m, float(last[0]))
        return wire.between(low, high) if high - low >= LEAST_M else wire

    return tuple(
        tuple(
            rewired(span, [cut(wire, *_holds(wire, k, *ends)) for k, wire in enumerate(span.wires)])
            for span, ends in zip(spans, pairwise(held), strict=True)
        )
        for spans, held in zip(chains, supports.chains, strict=True)
    )


def hung_between(chains: Sequence[Chain], extents: Sequence[Chain], supports: Supports) -> tuple[Chain, ...]:
    """Wires from structure to structure, or to where their extents end where none is seen.

    extents: the wires as they were detected, which end where the images stop showing them.  At a structure a
    wire ends even where its extent ends before: its curve is known there.  A wire that is seen outside of the
    structures only, or a piece about a single one, is held by none.
    """

    def hang(wire: Wire, extent: Wire, k: int, ends: tuple[Support, Support]) -> Wire:
        u, a = wire.base.u, wire.base.a
        own = [float((end - a) @ u) for end in (extent.base.a, extent.base.b)]
        holds = _holds(wire, k, *ends)
        s = [mine if hold is None else float(hold[0]) for mine, hold in zip(own, holds, strict=True)]
        if s[1] - s[0] < LEAST_M:
            return replace(wire.between(*own), ends=(OUTSIDE, OUTSIDE))
        hung = wire.between(*s)
        points = hung.points(np.array([0.0, hung.base.length_m]))
        first, last = (_end(*one) for one in zip(ends, holds, points, strict=True))
        return replace(hung, ends=(first, last))

    return tuple(
        tuple(
            rewired(span, [
                hang(wire, other, k, ends)
                for k, (wire, other) in enumerate(zip(span.wires, extent.wires, strict=True))
            ])
            for span, extent, ends in zip(spans, known, pairwise(held), strict=True)
        )
        for spans, known, held in zip(chains, extents, supports.chains, strict=True)
    )  # fmt: skip


def numbered(chains: Sequence[Chain], before: Sequence[Chain]) -> tuple[tuple[Chain, ...], tuple[Chain, ...]]:
    """The wires with ids from 1 span by span, the highest of each span first; and the same ones as they were
    before the refit with the same ids."""
    both: tuple[list[Wire], list[Wire]] = ([], [])
    for span, other in zip(chain.from_iterable(chains), chain.from_iterable(before), strict=True):
        middles = [wire.points(np.array([wire.base.length_m / 2]))[0, 2] for wire in span.wires]
        for k in np.argsort(middles)[::-1].tolist():
            for wires, one in zip(both, (span, other), strict=True):
                wires.append(replace(one.wires[k], id=len(wires) + 1))
    return with_wires(chains, both[0]), with_wires(before, both[1])


def lines_of(
    chains: Sequence[Chain], supports: Supports, structures: Sequence[Structure]
) -> tuple[Line, ...]:
    """The chains as lines.  structures: those of the supports, by their ids, as they stand on the ground."""
    by_id = {one.id: one for one in structures}
    lines: list[Line] = []
    count = 0
    for one_chain, held in zip(chains, supports.chains, strict=True):
        ids = [None if one.structure is None else one.structure.id for one in held]
        spans = []
        for span, ends in zip(one_chain, pairwise(ids), strict=True):
            count += 1
            spans.append(Span(count, ends, span.wires))
        own = tuple(by_id[one.structure.id] for one in held if one.mine and one.structure is not None)
        lines.append(Line(len(lines) + 1, own, tuple(spans)))
    return tuple(lines)


def _holds(wire: Wire, k: int, first: Support, last: Support) -> tuple[Hold, Hold]:
    """Where the k-th wire of a span is held at both of its ends."""
    return _hold(wire, first.junction.axis, first, first.at[1], k), _hold(
        wire, last.junction.axis, last, last.at[0], k
    )


def _hold(wire: Wire, axis: Base, support: Support, at: Float[np.ndarray, "w 2"], k: int) -> Hold:
    if support.structure is None:
        return None
    t, sigma = at[k]
    s = crossing(wire, axis, np.array([t]))[0]
    return np.array([s, sigma / abs(wire.base.u @ axis.u)])


def _end(support: Support, hold: Hold, point: Float[np.ndarray, "3"]) -> End:
    if hold is None or support.structure is None:
        return support.reason
    return Attached(support.structure.id, point, float(hold[1]))
