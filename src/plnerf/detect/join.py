"""One wire of the pieces that overlapping windows show of it.

Two pieces are the same wire where they run at the same place over a good part of the shorter one.  Pieces of
two spans of one wire meet in a kink; they overlap by little, and stay two wires.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from plnerf.detect.config import JoinConfig
from plnerf.line.base import Base
from plnerf.line.wire import Wire

PLACES = 21
MOST_TURN_RAD = math.radians(10.0)
"""Bases of two pieces of one wire differ by less: each is along the window in which it was found."""
SIGMAS = 2.0
"""So many standard deviations a curve may be off by."""


def joined(windows: Sequence[Sequence[Wire]], config: JoinConfig) -> list[Wire]:
    """The wires that the pieces of windows along one direction make, in the order of their first pieces.

    Pieces of one window are different wires, for each has ridges of its own, but where they are one curve.
    """
    wires: list[Wire] = []
    for pieces in windows:
        open_ones = set(range(len(wires)))
        for piece in each_curve_once(pieces, config):
            apart = {k: apart_m(wires[k], piece, config) for k in sorted(open_ones)}
            mine = min(apart, key=lambda k: apart[k], default=None)
            if mine is None or apart[mine] > reach_m(wires[mine], piece):
                wires.append(piece)
            else:
                wires[mine] = merged(wires[mine], piece)
                open_ones.remove(mine)
    return wires


def each_curve_once(pieces: Sequence[Wire], config: JoinConfig) -> list[Wire]:
    """Pieces of one window, those of one curve merged.

    One wire gives two pieces where some views show it thin and others ten pixels wide, or where far views and
    near ones show different stretches of it.
    """
    wires = list[Wire]()
    for piece in pieces:
        mine = next((k for k, wire in enumerate(wires) if one_curve(wire, piece, config)), None)
        if mine is None:
            wires.append(piece)
        else:
            wires[mine] = merged(wires[mine], piece)
    return wires


def one_curve(a: Wire, b: Wire, config: JoinConfig) -> bool:
    """Whether two pieces are one curve as far as anyone can tell.

    Where they overlap they are nearer to each other than the better known one's deviation, or than a part of
    a pixel, as twins are not; and their parameters agree, as those of two spans do not.
    """
    low, high = overlap(a, b)
    near = config.same_reach * min(wire.evidence.reach_m or 0.0 for wire in (a, b))
    return high > low and agree(a, b, config) and _mean_apart(a, b, low, high) <= near


def agree(a: Wire, b: Wire, config: JoinConfig) -> bool:
    """Whether the parameters of two pieces differ by no more than they are uncertain by."""
    if a.base.u @ b.base.u < math.cos(MOST_TURN_RAD):
        return False
    base = _base_of_both(a, b)
    one, other = a.on(base), b.on(base)
    off = one.theta - other.theta
    chi_square = float(off @ np.linalg.solve(one.covariance + other.covariance, off))
    return chi_square <= config.max_misfit * len(off)


def with_onward(wires: Sequence[Wire], pieces: Sequence[Wire]) -> list[Wire]:
    """The wires, each with the pieces beyond its ends that lie on its curve, and the other pieces.

    Where a wire's curve is not known so far from it, or turns off, a piece is a wire of its own: it may be of
    the next span.
    """
    longer = list(wires)
    for piece in pieces:
        off = [off_curve_m(wire, piece) for wire in longer[: len(wires)]]
        mine = int(np.argmin(off)) if off else 0
        if off and off[mine] <= reach_m(longer[mine], piece):
            longer[mine] = merged(longer[mine], piece)
        else:
            longer.append(piece)
    return longer


def off_curve_m(wire: Wire, piece: Wire) -> float:
    """The greatest distance of a piece from a wire's curve, which goes on beyond its ends, or what the curve
    may be off by there, if that is more; infinite where they run another way."""
    if not wire.evidence.certain or wire.base.u @ piece.base.u < math.cos(MOST_TURN_RAD):
        return math.inf
    there = wire.base.local(piece.points(np.linspace(0.0, piece.base.length_m, PLACES)))
    away = np.linalg.norm(there[:, 1:] - wire.at(there[:, 0]), axis=1)
    return float(max(away.max(), SIGMAS * wire.sigma_at(there[:, 0]).max()))


def apart_m(a: Wire, b: Wire, config: JoinConfig) -> float:
    """Mean distance of two pieces with parallel bases; infinite where they overlap by too little."""
    low, high = overlap(a, b)
    if high - low < config.min_overlap * min(a.base.length_m, b.base.length_m):
        return math.inf
    return _mean_apart(a, b, low, high)


def _mean_apart(a: Wire, b: Wire, low: float, high: float) -> float:
    """Mean distance of a wire from another one's curve, over a stretch of its base."""
    points = a.points(np.linspace(low, high, PLACES))
    there = b.base.local(points)
    return float(np.hypot(*(there[:, 1:] - b.at(there[:, 0])).T).mean())


def reach_m(a: Wire, b: Wire) -> float:
    """How far apart two pieces of one wire may be."""
    return max(wire.evidence.reach_m or 0.0 for wire in (a, b))


def overlap(a: Wire, b: Wire) -> tuple[float, float]:
    """The stretch of a's base that lies beside b's."""
    ends = np.array([[*b.base.a, 0.0], [*b.base.b, 0.0]])
    first, last = sorted(a.base.local(ends)[:, 0])
    return max(0.0, float(first)), min(a.base.length_m, float(last))


def merged(a: Wire, b: Wire) -> Wire:
    """One wire over the stretch of both, weighted by what each knows of it.

    What both windows saw counts twice; the survey fits the wire to the images again.
    """
    base = _base_of_both(a, b)
    one, other = a.on(base), b.on(base)
    weights = [np.linalg.inv(wire.covariance) for wire in (one, other)]
    covariance = np.linalg.inv(weights[0] + weights[1])
    theta = covariance @ (weights[0] @ one.theta + weights[1] @ other.theta)
    better = max((one, other), key=lambda wire: wire.evidence.count)
    seen = [stretch for wire in (one, other) for stretch in wire.evidence.seen_m or ((0.0, base.length_m),)]
    low, high = min(stretch[0] for stretch in seen), max(stretch[1] for stretch in seen)
    evidence = replace(
        better.evidence,
        coverage=(high - low) / base.length_m,
        longest_gap_m=max(low, base.length_m - high),
        certain=one.evidence.certain or other.evidence.certain,
        seen_m=((low, high),),
    )
    return replace(better, base=base, theta=theta, covariance=covariance, evidence=evidence)


def _base_of_both(a: Wire, b: Wire) -> Base:
    """a's base, over the stretch of both."""
    ends = np.array([[*b.base.a, 0.0], [*b.base.b, 0.0]])
    first, last = sorted(a.base.local(ends)[:, 0])
    return a.base.cut(min(0.0, float(first)), max(a.base.length_m, float(last)))
