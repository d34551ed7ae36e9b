"""Stations: how far along its line a place lies, as surveyors count it.

A line's spans make chains, in each of which every span begins at the structure where the one before ends.  A
chain's axis leads from structure to structure, and where none is seen to where the wires end; stations are
counted along it from its first structure, or on from what a part of a longer line begins with.  LineFrame.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from plnerf.line.base import Base
from plnerf.line.frame import LineFrame
from plnerf.line.line import Line, Span, Structure

Held = tuple[int | None, int | None]
"""Ids of the structures at two ends."""


@dataclass(frozen=True, eq=False)
class Stretch:
    """A span's part of the axis of its chain."""

    span: Span
    held: Held
    """By its structures, in the order of the chain."""
    base: Base
    """From its first structure to its last, or as far as its wires reach."""
    from_m: float
    """Station of where it begins."""

    @property
    def length_m(self) -> float | None:
        """Horizontal distance between its structures; None where one of them is not known."""
        return None if None in self.held else self.base.length_m

    @property
    def to_m(self) -> float:
        """Station of where it ends."""
        return self.from_m + self.base.length_m

    def station(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Stations of points beside it."""
        along: Float[np.ndarray, " n"] = self.from_m + (points[:, :2] - self.base.a) @ self.base.u
        return along


Chain = tuple[Stretch, ...]
"""Spans one after the other."""


def chains(line: Line) -> tuple[Chain, ...]:
    """The chains of a line, in the order of its spans; those without wires are left out.

    Wires may run against their chain.
    """
    found: list[list[tuple[Span, Held]]] = []
    for span in line.spans:
        if span.wires and not (found and _joined(found[-1], span)):
            found.append([(span, span.structures)])
    feet = {one.id: one for one in line.structures}
    return tuple(_chain(one, feet, line.from_m) for one in found)


def _joined(chain: list[tuple[Span, Held]], span: Span) -> bool:
    """Appends a span that is held where the chain ends; a chain of one span may be turned for it."""
    held = set(span.structures) - {None}
    first, (head, tail) = chain[0][0], chain[0][1]
    if len(chain) == 1 and tail not in held and head in held:
        chain[0] = (first, (tail, head))
    (a, b), end = span.structures, chain[-1][1][1]
    if end not in held:
        return False
    chain.append((span, (a, b) if a == end else (b, a)))
    return True


def structure_stations(line: Line) -> dict[int, float]:
    """Stations of a line's structures by their ids, of those that hold a span."""
    found: dict[int, float] = {}
    for chain in chains(line):
        for one in chain:
            for id_, station in zip(one.held, (one.from_m, one.to_m), strict=True):
                if id_ is not None:
                    found.setdefault(id_, station)
    return found


def azimuth_deg(frame: LineFrame, base: Base) -> float:
    """Direction of a base, clockwise from the world's y axis, which is north where the world is on a map."""
    a, b = frame.to_world(np.array([[*base.a, 0.0], [*base.b, 0.0]]))
    return math.degrees(math.atan2(b[0] - a[0], b[1] - a[1])) % 360


def _chain(spans: Sequence[tuple[Span, Held]], feet: dict[int, Structure], from_m: float) -> Chain:
    made: list[Stretch] = []
    for span, held in spans:
        base = _base(span, held, feet)
        made.append(Stretch(span, held, base, made[-1].to_m if made else from_m))
    return tuple(made)


def _base(span: Span, held: Held, feet: dict[int, Structure]) -> Base:
    """From structure to structure; where none is seen, along the wires up to the last of their ends."""
    at = np.array([wire.points(np.array([0.0, wire.base.length_m]))[:, :2] for wire in span.wires])
    a, b = at[:, 0], at[:, 1]
    turned = ((b - a) @ (b[0] - a[0])) < 0  # wires may run in either direction: all as the first
    a[turned], b[turned] = b[turned], a[turned].copy()
    ends = np.array([a.mean(0), b.mean(0)])
    known = [None if one is None else feet.get(one) for one in held]
    for k, one in enumerate(known):
        if one is not None:  # the other end is the farther one, whichever way the wires run
            near = int(np.linalg.norm(ends - one.foot[:2], axis=1).argmin())
            ends = np.array([ends[near], ends[1 - near]])[:: 1 if k == 0 else -1]
            break
    begin, end = (mean if one is None else one.foot[:2] for one, mean in zip(known, ends, strict=True))
    base = Base(begin, end)
    s = (np.concatenate([a, b]) - begin) @ base.u
    low = 0.0 if known[0] is not None else min(0.0, float(s.min()))
    high = base.length_m if known[1] is not None else max(base.length_m, float(s.max()))
    return base.cut(low, high)
