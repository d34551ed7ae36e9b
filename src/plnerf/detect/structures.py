"""Where the wires of two spans meet, there is the structure, and there both of them end.

Images seldom show a wire up to where it is held: towers, insulators and the next span's wires lie before and
behind it there.  Its curve goes on as it is known, and where it meets the next span's, within what both are
uncertain by, neither can hang beyond; so far both are known.

Wires hang down to both sides of a structure, or turn there.  Two that meet and run on as one curve are pieces
of one wire, and no structure is there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Float

from plnerf.detect.config import JoinConfig, MeetConfig
from plnerf.detect.join import agree, merged
from plnerf.line.wire import Wire


@dataclass(frozen=True, eq=False)
class About:
    """A wire about one of its ends."""

    wire: int
    """Its place in the list of wires."""
    last: bool
    """Which end."""
    s: Float[np.ndarray, " m"]
    """Places along its base, those beyond its end included."""
    points: Float[np.ndarray, "m 3"]
    sigma: Float[np.ndarray, " m"]
    """Standard deviation there in the less certain of y and z."""
    length: float
    """Length of the wire's base."""

    @property
    def onward(self) -> Float[np.ndarray, "3"]:
        """Unit vector out of the wire."""
        return self._out(0, -1)

    def way_out(self, i: np.intp) -> Float[np.ndarray, "3"]:
        """The same at one of the places between the first and the last."""
        return self._out(int(i) - 1, int(i) + 1)

    def _out(self, low: int, high: int) -> Float[np.ndarray, "3"]:
        way = self.points[high] - self.points[low]
        u: Float[np.ndarray, 3] = way / np.linalg.norm(way)
        return u if self.last else -u


@dataclass(frozen=True)
class Meeting:
    """Two wires' ends, and the places along their bases where they are nearest to each other."""

    ends: tuple[tuple[int, bool], tuple[int, bool]]
    s: tuple[float, float]
    apart: float
    turn_rad: float
    """Angle between the wires' ways there."""


def in_one_piece(wires: Sequence[Wire], config: MeetConfig, join: JoinConfig) -> list[Wire]:
    """The wires, certain ones merged that run on as one curve where they meet, as far as anyone can tell."""
    whole = list(wires)
    while True:
        smooth = (one.ends for one in _meetings(whole, config) if one.turn_rad < config.least_turn_rad)
        pairs = (sorted((k, n)) for (k, _), (n, _) in smooth if agree(whole[k], whole[n], join))
        first, second = next(pairs, (None, None))
        if first is None or second is None:
            return whole
        whole[first] = merged(whole[first], whole.pop(second))


def ended_where_they_meet(wires: Sequence[Wire], config: MeetConfig) -> list[Wire]:
    """The wires, each certain one that meets another of the next span cut or continued to there."""
    taken: set[tuple[int, bool]] = set()
    ended = [[0.0, wire.base.length_m] for wire in wires]
    for meeting in _meetings(wires, config):
        if meeting.turn_rad >= config.least_turn_rad and taken.isdisjoint(meeting.ends):
            taken.update(meeting.ends)
            for (k, last), s in zip(meeting.ends, meeting.s, strict=True):
                ended[k][last] = s
    return [_between(wire, low, high) for wire, (low, high) in zip(wires, ended, strict=True)]


def _meetings(wires: Sequence[Wire], config: MeetConfig) -> list[Meeting]:
    """Those of the certain wires, the nearest first."""
    about = [
        _about(wire, k, last, config)
        for k, wire in enumerate(wires)
        if wire.evidence.certain
        for last in (False, True)
    ]
    found = (_meeting(a, b, config) for a, b in combinations(about, 2) if a.wire != b.wire)
    return sorted((one for one in found if one is not None), key=lambda one: one.apart)


def _about(wire: Wire, k: int, last: bool, config: MeetConfig) -> About:
    length = wire.base.length_m
    s = last * length + length * np.arange(-config.about, config.about, config.step)
    return About(k, last, s, wire.points(s), wire.sigma_at(s).max(1), length)


def _meeting(a: About, b: About, config: MeetConfig) -> Meeting | None:
    """The place where two wires meet; None where they pass each other, or the line turns by too much."""
    if -(a.onward @ b.onward) < np.cos(config.most_turn_rad):
        return None
    apart = np.linalg.norm(a.points[:, None] - b.points[None], axis=2)
    i, j = np.unravel_index(int(apart.argmin()), apart.shape)
    if not (0 < i < len(a.s) - 1 and 0 < j < len(b.s) - 1):
        return None
    off = config.step * max(a.length, b.length) + config.sigmas * np.hypot(a.sigma[i], b.sigma[j])
    known = all(one.sigma[at] <= config.most_sigma * one.length for one, at in ((a, i), (b, j)))
    if not known or apart[i, j] > off:
        return None
    turn = float(np.arccos(np.clip(-a.way_out(i) @ b.way_out(j), -1.0, 1.0)))
    ends = ((a.wire, a.last), (b.wire, b.last))
    return Meeting(ends, (float(a.s[i]), float(b.s[j])), float(apart[i, j]), turn)


def _between(wire: Wire, low: float, high: float) -> Wire:
    """The wire between two places, and which share of it was seen."""
    if (low, high) == (0.0, wire.base.length_m):
        return wire
    seen = replace(wire.evidence, seen_m=wire.evidence.seen_m or ((0.0, wire.base.length_m),))
    cut = replace(wire, evidence=seen).between(low, high)
    shown = np.array(cut.evidence.seen_m)
    first, last = (float(end) for end in (shown[:, 0].min(), shown[:, 1].max()))
    gap = max(first, high - low - last)
    return replace(
        cut, evidence=replace(cut.evidence, coverage=(last - first) / (high - low), longest_gap_m=gap)
    )
