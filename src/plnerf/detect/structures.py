"""Where the wires of two spans meet, there is the structure, and there both of them end.

Images seldom show a wire up to where it is held: towers, insulators and the next span's wires lie before and
behind it there.  Its curve goes on as it is known, and where it meets the next span's, within what both are
uncertain by, neither can hang beyond; so far both are known.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Float

from plnerf.detect.config import MeetConfig
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
        way = self.points[-1] - self.points[0]
        u: Float[np.ndarray, 3] = way / np.linalg.norm(way)
        return u if self.last else -u


@dataclass(frozen=True)
class Meeting:
    """Two wires' ends, and the places along their bases where they are nearest to each other."""

    ends: tuple[tuple[int, bool], tuple[int, bool]]
    s: tuple[float, float]
    apart: float


def ended_where_they_meet(wires: Sequence[Wire], config: MeetConfig) -> list[Wire]:
    """The wires, each certain one that meets another of the next span cut or continued to there."""
    about = [
        _about(wire, k, last, config)
        for k, wire in enumerate(wires)
        if wire.evidence.certain
        for last in (False, True)
    ]
    found = [_meeting(a, b, config) for a, b in combinations(about, 2) if a.wire != b.wire]
    taken: set[tuple[int, bool]] = set()
    ended = [[0.0, wire.base.length_m] for wire in wires]
    for meeting in sorted((one for one in found if one is not None), key=lambda one: one.apart):
        if taken.isdisjoint(meeting.ends):
            taken.update(meeting.ends)
            for (k, last), s in zip(meeting.ends, meeting.s, strict=True):
                ended[k][last] = s
    return [_between(wire, low, high) for wire, (low, high) in zip(wires, ended, strict=True)]


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
    return Meeting(((a.wire, a.last), (b.wire, b.last)), (float(a.s[i]), float(b.s[j])), float(apart[i, j]))


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
