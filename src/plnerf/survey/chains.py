"""Lines out of single wires: which hang side by side in one span, and which spans go on in one another.

A wire is a conductor over one span, of any direction.  Spans follow one another where their conductors'
curves meet, whatever the bend; what crosses a line elsewhere meets none of its ends.

Letters: s along a span's base, t along a junction's axis; w wires before and v after it.  LineFrame.
"""

from collections.abc import Sequence
from itertools import combinations, pairwise

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

from plnerf.line.base import Base
from plnerf.line.wire import Wire
from plnerf.survey.config_spans import ChainConfig
from plnerf.survey.span_wires import Junction, SpanWires, crossing, rewired, span_of

Chain = tuple[SpanWires, ...]
"""The spans of a line in their order, all in its direction."""
End = tuple[int, bool]
"""A span, and whether its last end is meant."""


def find_chains(wires: Sequence[Wire], config: ChainConfig) -> tuple[Chain, ...]:
    """All lines, the longest first."""
    spans = [span_of(group) for group in _side_by_side(wires, config)]
    made = [_directed(chain) for chain in _linked(spans, config)]
    return tuple(sorted(made, key=lambda chain: -sum(span.base.length_m for span in chain)))


def junctions(chain: Chain, config: ChainConfig) -> tuple[Junction, ...]:
    """Where the chain begins, where its spans meet, and where it ends."""
    first, last = chain[0], chain[-1]
    inner = [meeting(*pair, config) for pair in pairwise(chain)]
    return (
        Junction(_axis(first.base.a, first.base.u), None, first),
        *inner,
        Junction(_axis(last.base.b, last.base.u), last, None),
    )


def meeting(before: SpanWires, after: SpanWires, config: ChainConfig) -> Junction:
    """The junction of two spans, at the place where the most of their wires, and these best, meet.

    The place is sought for all of them together: in a single pair, a wire that is continued upwards may meet
    the conductor above.
    """
    u = before.base.u + after.base.u
    ends = before.base.b, after.base.a
    axis = _axis((ends[0] + ends[1]) / 2, u / np.linalg.norm(u))
    reach = _reach_m(before, after, config) + abs((ends[1] - ends[0]) @ axis.u) / 2
    t = np.arange(-reach, reach + config.step_m, config.step_m)
    off = _at(before, axis, t)[:, None] - _at(after, axis, t)
    apart = np.minimum(np.linalg.norm(off, axis=-1), config.gap_m)
    totals = np.array([one[linear_sum_assignment(one)].sum() for one in apart.transpose(2, 0, 1)])
    best = int(totals.argmin())
    rows, columns = linear_sum_assignment(apart[..., best])
    pairs = [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if apart[i, j, best] < config.gap_m]
    return Junction(axis, before, after, tuple(pairs), float(t[best]))


def wires_of(chains: Sequence[Chain]) -> list[Wire]:
    """All wires, span by span."""
    return [wire for chain in chains for span in chain for wire in span.wires]


def with_wires(chains: Sequence[Chain], wires: Sequence[Wire]) -> tuple[Chain, ...]:
    """The chains with other curves in the order of `wires_of`."""
    left = iter(wires)
    return tuple(tuple(rewired(span, [next(left) for _ in span.wires]) for span in chain) for chain in chains)


def _axis(place: Float[np.ndarray, "2"], u: Float[np.ndarray, "2"]) -> Base:
    return Base(place, place + u)


def _at(span: SpanWires, axis: Base, t: Float[np.ndarray, " m"]) -> Float[np.ndarray, "w m 2"]:
    """y and z of a span's wires beside an axis."""
    return np.array([axis.local(wire.points(crossing(wire, axis, t)))[:, 1:] for wire in span.wires])


def _side_by_side(wires: Sequence[Wire], config: ChainConfig) -> list[list[Wire]]:
    """The wires of each span, in their order.

    Groups grow from the wires that run beside each other the farthest, and join only where their longest
    wires do so as well: a piece that is seen across a structure joins no two spans.
    """
    groups = [[k] for k in range(len(wires))]
    of = list(range(len(wires)))
    longest = list(wires)
    beside = ((-_beside(wires[i], wires[j], config), i, j) for i, j in combinations(range(len(wires)), 2))
    for _, i, j in sorted(one for one in beside if one[0] < 0):
        a, b = of[i], of[j]
        if a == b or not _overlap(longest[a], longest[b], config):
            continue
        groups[a] += groups[b]
        longest[a] = max(longest[a], longest[b], key=lambda wire: wire.base.length_m)
        for k in groups[b]:
            of[k] = a
        groups[b] = []
    return [[wires[k] for k in sorted(group)] for group in groups if group]


def _overlap(one: Wire, other: Wire, config: ChainConfig) -> tuple[float, float] | None:
    """Between which s of one wire another runs parallel to it, if that is most of the shorter of them."""
    chords = [
        np.diff(wire.points(np.array([0.0, wire.base.length_m]))[:, :2], axis=0)[0] for wire in (one, other)
    ]
    cosine = abs(chords[0] @ chords[1]) / (np.linalg.norm(chords[0]) * np.linalg.norm(chords[1]))
    if cosine < np.cos(np.radians(config.max_angle_deg)):
        return None
    low, high = _ends(one, other)
    both = max(low, 0.0), min(high, one.base.length_m)
    enough = config.min_overlap * min(one.base.length_m, high - low)
    return both if both[1] - both[0] >= enough else None


def _beside(one: Wire, other: Wire, config: ChainConfig) -> float:
    """How far two wires run side by side in one span; 0 where they are of two."""
    both = _overlap(one, other, config)
    if both is None:
        return 0.0
    low, high = _ends(one, other)
    length = one.base.length_m
    level = max(abs(low), abs(high - length)) <= max(config.level_m, config.level_share * length)
    y = one.base.local(other.points(crossing(other, one.base, np.array(both))))[:, 1]
    apart = float(np.abs(y - one.at(np.array(both))[:, 0]).mean())
    near = apart <= config.close_m or (level and apart <= config.wide_m)
    return both[1] - both[0] if near else 0.0


def _ends(one: Wire, other: Wire) -> tuple[float, float]:
    """s on one wire's base beside which another wire begins and ends."""
    s = one.base.local(other.points(np.array([0.0, other.base.length_m])))[:, 0]
    return float(s.min()), float(s.max())


def _linked(spans: Sequence[SpanWires], config: ChainConfig) -> list[Chain]:
    """Spans that go on in one another, those of most wires first; each end in one other at most."""
    towards = {(k, last): _in_line(span, last) for k, span in enumerate(spans) for last in (False, True)}
    met = []
    for (i, mine), (j, its) in combinations(towards, 2):
        before, after = towards[i, mine], towards[j, not its]
        apart = float(np.linalg.norm(after.base.a - before.base.b))
        if i != j and _may_meet(before, after, apart, config):
            pairs = meeting(before, after, config).pairs
            met += [(-len(pairs), apart, (i, mine), (j, its))] if pairs else []
    nexts: dict[End, End] = {}
    for _, _, one, other in sorted(met):
        if one not in nexts and other not in nexts and not _closes(one, other, nexts):
            nexts[one], nexts[other] = other, one
    return _followed(spans, nexts)


def _in_line(span: SpanWires, forwards: bool) -> SpanWires:
    return span if forwards else span.turned


def _may_meet(before: SpanWires, after: SpanWires, apart_m: float, config: ChainConfig) -> bool:
    bend = np.cos(np.radians(config.max_bend_deg))
    return bool(before.base.u @ after.base.u >= bend and apart_m <= 2 * _reach_m(before, after, config))


def _reach_m(before: SpanWires, after: SpanWires, config: ChainConfig) -> float:
    """How far beyond their filmed ends the curves of two spans may meet."""
    share = config.reach_share * min(before.base.length_m, after.base.length_m)
    return min(config.reach_m, max(share, config.least_reach_m))


def _closes(one: End, other: End, nexts: dict[End, End]) -> bool:
    """Whether a link would close a ring, which has no first span."""
    k, last = one
    while k != other[0]:
        follower = nexts.get((k, not last))
        if follower is None:
            return False
        k, last = follower
    return True


def _followed(spans: Sequence[SpanWires], nexts: dict[End, End]) -> list[Chain]:
    made, used = [], set[int]()
    for k in range(len(spans)):
        for last in (False, True):
            if k in used or (k, last) in nexts:
                continue
            chain, here = [], (k, last)  # `here`: the end at which a span is entered
            while True:
                used.add(here[0])
                chain.append(_in_line(spans[here[0]], not here[1]))
                follower = nexts.get((here[0], not here[1]))
                if follower is None:
                    break
                here = follower
            made.append(tuple(chain))
    return made


def _directed(chain: Chain) -> Chain:
    """From its western end, or if it runs due north from its southern one, in the LineFrame's axes."""
    run = chain[-1].base.b - chain[0].base.a
    forwards = run[0] > 0 if abs(run[0]) > 1e-9 * np.linalg.norm(run) else run[1] > 0
    return chain if forwards else tuple(span.turned for span in reversed(chain))
