"""One wire of the pieces that overlapping windows show of it.

Two pieces are the same wire where they run at the same place over a good part of the shorter one.  Pieces of
two spans of one wire meet in a kink; they overlap by little, and stay two wires.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from plnerf.detect.config import JoinConfig
from plnerf.line.wire import Wire

PLACES = 21


def joined(windows: Sequence[Sequence[Wire]], config: JoinConfig) -> list[Wire]:
    """The wires that the pieces of windows along one direction make, in the order of their first pieces.

    Pieces of one window are different wires: each has ridges of its own.
    """
    wires: list[Wire] = []
    for pieces in windows:
        open_ones = set(range(len(wires)))
        for piece in pieces:
            apart = {k: apart_m(wires[k], piece, config) for k in sorted(open_ones)}
            mine = min(apart, key=lambda k: apart[k], default=None)
            if mine is None or apart[mine] > reach_m(wires[mine], piece):
                wires.append(piece)
            else:
                wires[mine] = merged(wires[mine], piece)
                open_ones.remove(mine)
    return wires


def apart_m(a: Wire, b: Wire, config: JoinConfig) -> float:
    """Mean distance of two pieces with parallel bases; infinite where they overlap by too little."""
    low, high = overlap(a, b)
    if high - low < config.min_overlap * min(a.base.length_m, b.base.length_m):
        return math.inf
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
    ends = np.array([[*b.base.a, 0.0], [*b.base.b, 0.0]])
    first, last = sorted(a.base.local(ends)[:, 0])
    base = a.base.cut(min(0.0, float(first)), max(a.base.length_m, float(last)))
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
