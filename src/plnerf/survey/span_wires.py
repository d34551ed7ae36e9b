"""Spans before their structures are known: wires that hang side by side, and the places where spans meet.

Letters: s along a span's base, y to its left, z up; t along a junction's axis; w wires.  LineFrame.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from plnerf.line.base import Base
from plnerf.line.wire import Wire

SLOPE_STEP_M = 0.01
"""Half the stretch over which slopes are taken; a catenary's is exact to 1e-9 over it."""
EXACT_M = 1e-10
"""To which places on wires are computed."""
MOST_STEPS = 12
"""Steps towards them at most."""


@dataclass(frozen=True, eq=False)
class SpanWires:
    """Wires that hang between the same two structures."""

    base: Base
    """Along the span's direction, over the extents of all its wires."""
    wires: tuple[Wire, ...]
    """In the base's direction, each on the part of the base's line over which it is known."""

    @property
    def turned(self) -> "SpanWires":
        """The same span, seen in the other direction."""
        return SpanWires(Base(self.base.b, self.base.a), tuple(turned(wire) for wire in self.wires))

    def end(self, last: bool) -> Float[np.ndarray, "3"]:
        """The middle of its wires at one end of the base."""
        s = self.base.length_m * last
        middle: Float[np.ndarray, 3] = self.base.place(
            np.full(len(self.wires), s), np.array([at(wire, self.base, s) for wire in self.wires])
        ).mean(0)
        return middle

    def half_width(self, last: bool) -> float:
        """Half the distance between its outer wires at one end of the base."""
        y = [at(wire, self.base, self.base.length_m * last)[0] for wire in self.wires]
        return float(max(y) - min(y)) / 2

    def polylines(self, count: int) -> list[Float[np.ndarray, "c 3"]]:
        """Its wires in its own coordinates s, y and z, as far as they are known."""
        return [
            self.base.local(wire.points(np.linspace(0.0, wire.base.length_m, count))) for wire in self.wires
        ]


@dataclass(frozen=True, eq=False)
class Junction:
    """Where a span ends and the next one, if there is one, begins."""

    axis: Base
    """One metre along the line, from about where the wires end; between the directions of both spans."""
    before: SpanWires | None
    after: SpanWires | None
    pairs: tuple[tuple[int, int], ...] = ()
    """Wires of one conductor: its index before and after."""
    meet_m: float = 0.0
    """t at which the curves of these come nearest to each other."""

    @property
    def sides(self) -> tuple[tuple[Wire, ...], tuple[Wire, ...]]:
        """The wires before and after it; none where there is no span."""
        before, after = (() if span is None else span.wires for span in (self.before, self.after))
        return before, after

    @property
    def conductors(self) -> tuple[tuple[int | None, int | None], ...]:
        """Each one's wires before and after it: the pairs, then those that only one side has."""
        before, after = (
            [k for k in range(len(wires)) if all(pair[side] != k for pair in self.pairs)]
            for side, wires in enumerate(self.sides)
        )
        return (*self.pairs, *((k, None) for k in before), *((None, k) for k in after))

    @property
    def ends(self) -> list[tuple[SpanWires, bool]]:
        """The spans that meet or end here, and whether with their last end."""
        both = ((self.before, True), (self.after, False))
        return [(span, last) for span, last in both if span is not None]

    @property
    def bend_deg(self) -> float | None:
        """By how much the line turns; None at its ends."""
        if self.before is None or self.after is None:
            return None
        return float(np.degrees(np.arccos(np.clip(self.before.base.u @ self.after.base.u, -1.0, 1.0))))


def turned(wire: Wire) -> Wire:
    """The same wire counted from its other end."""
    length, seen = wire.base.length_m, wire.evidence.seen_m
    swap = np.zeros((6, 6))
    swap[[0, 1, 2, 3, 4, 5], [1, 0, 3, 2, 4, 5]] = [-1, -1, 1, 1, 1, -1]  # left becomes right
    flipped = None if seen is None else tuple((length - high, length - low) for low, high in seen[::-1])
    return replace(
        wire,
        base=Base(wire.base.b, wire.base.a),
        theta=swap @ wire.theta,
        covariance=swap @ wire.covariance @ swap.T,
        ends=(wire.ends[1], wire.ends[0]),
        evidence=replace(wire.evidence, seen_m=flipped),
    )


def at(wire: Wire, base: Base, s: float) -> Float[np.ndarray, "2"]:
    """y and z of a wire's curve in a base's coordinates at its s."""
    own = crossing(wire, base, np.array([s]))
    yz: Float[np.ndarray, 2] = base.local(wire.points(own))[0, 1:]
    return yz


def crossing(wire: Wire, axis: Base, t: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    """s on a wire's own base at which its curve passes the upright planes across an axis at t."""
    along, aside = wire.base.u @ axis.u, wire.base.n @ axis.u
    straight = t - (wire.base.a - axis.a) @ axis.u
    s: Float[np.ndarray, " m"] = straight / along
    for _ in range(MOST_STEPS):  # y hardly depends on s: each step gains a digit or more
        before, s = s, (straight - aside * wire.at(s)[:, 0]) / along
        if np.abs(s - before).max(initial=0.0) < EXACT_M:
            break
    return s


def slope_at(wire: Wire, s: float) -> Float[np.ndarray, "2"]:
    """dy/ds and dz/ds of a wire's curve."""
    around = s + np.array([-SLOPE_STEP_M, SLOPE_STEP_M])
    slope: Float[np.ndarray, 2] = np.diff(wire.at(around), axis=0)[0] / (2 * SLOPE_STEP_M)
    return slope


def slope_covariance(wire: Wire, s: float) -> Float[np.ndarray, "2 2"]:
    """Covariance of `slope_at`."""
    around = s + np.array([-SLOPE_STEP_M, SLOPE_STEP_M])
    J = np.diff(wire.by_theta(around), axis=0)[0] / (2 * SLOPE_STEP_M)
    covariance: Float[np.ndarray, "2 2"] = J @ wire.covariance @ J.T
    return covariance


def span_of(wires: Sequence[Wire]) -> SpanWires:
    """Wires as one span, in the direction of the longest."""
    longest = max(wires, key=lambda wire: wire.base.length_m)
    same = [wire if wire.base.u @ longest.base.u > 0 else turned(wire) for wire in wires]
    ends = np.array([wire.points(np.array([0.0, wire.base.length_m]))[:, :2] for wire in same])
    u = (ends[:, 1] - ends[:, 0]).sum(0)  # the bases' own directions are those that were searched
    u = u / np.linalg.norm(u)
    middle = ends.mean((0, 1))
    s = (ends - middle) @ u
    lines = [Base.along(middle, u, low, high) for low, high in s]
    whole = Base.along(middle, u, float(s.min()), float(s.max()))
    return SpanWires(whole, tuple(wire.on(line) for wire, line in zip(same, lines, strict=True)))


def rewired(span: SpanWires, wires: Sequence[Wire]) -> SpanWires:
    """The span with other curves, on parts of the same straight line."""
    s = np.array([[wire.base.a, wire.base.b] for wire in wires]) - span.base.a
    along = s @ span.base.u
    return SpanWires(span.base.cut(float(along.min()), float(along.max())), tuple(wires))
