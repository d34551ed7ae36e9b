"""Spans of a corridor out of the lines that its blocks' clouds show, each of them in one block's care.

A span near a seam is in two blocks.  Two spans are the same where both ends agree; it belongs to the block in
whose core its middle lies.  World coordinates, metres.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from plnerf.corridor.plan import NEAR_M
from plnerf.line.frame import LineFrame
from plnerf.line.line import Line
from plnerf.line.stations import chains
from plnerf.survey.part import Cells, Part, SpanNumber, distance_to

SAME_M = 5.0
"""Structures, and ends of spans, that two blocks see so near to each other are one."""


@dataclass(frozen=True, eq=False)
class SeenSpan:
    """A span as a block shows it."""

    block: int
    axis: Float[np.ndarray, "2 3"]
    held: tuple[bool, bool]
    """Whether a structure holds its ends."""
    wires: int


@dataclass(frozen=True, eq=False)
class CloudSpan:
    """A span of the corridor, in the care of one block."""

    block: int
    axis: Float[np.ndarray, "2 3"]
    number: SpanNumber


def seen_spans(block: int, lines: Sequence[Line], frame: LineFrame) -> list[SeenSpan]:
    """All spans of a block's lines."""
    return [
        SeenSpan(
            block,
            frame.to_world(np.array([[*stretch.base.a, 0.0], [*stretch.base.b, 0.0]])),
            (stretch.held[0] is not None, stretch.held[1] is not None),
            len(stretch.span.wires),
        )
        for line in lines
        for chain in chains(line)
        for stretch in chain
    ]


def spans_of_corridor(seen: Sequence[SeenSpan], cores: Sequence[Cells]) -> tuple[CloudSpan, ...]:
    """Each span once, numbered line by line from an end; structures that spans share have one number."""
    kept = _once(seen, cores)
    if not kept:
        return ()
    nodes = _nodes(kept)
    spans: list[CloudSpan] = []
    left, numbers, line = set(range(len(kept))), dict[int, int](), 0
    while left:
        line += 1
        station, k, forwards = 0.0, *_first(kept, nodes, left)
        members = _connected(k, nodes, left)
        while True:
            left.discard(k)
            members.discard(k)
            axis = kept[k].axis if forwards else kept[k].axis[::-1]
            ends = nodes[k] if forwards else nodes[k][::-1]
            a, b = (numbers.setdefault(node, len(numbers) + 1) for node in ends)
            number = SpanNumber(line, len(spans) + 1, (a, b), station)
            spans.append(CloudSpan(kept[k].block, np.ascontiguousarray(axis), number))
            station += float(np.linalg.norm(axis[1] - axis[0]))
            following = _next(kept, nodes, members, ends[1], axis)
            if following is None:
                if not members:
                    break
                following, station = _first(kept, nodes, members), 0.0
            k, forwards = following
    return tuple(spans)


def cloud_part(spans: Sequence[CloudSpan], block: int, core: Cells) -> Part:
    """The part of the corridor that a block is about: its own spans, and the points of its core."""
    middles = (core.keys + 0.5) * core.side
    near = [
        span
        for span in spans
        if span.block == block or distance_to(middles, span.axis[:, :2]).min() <= NEAR_M
    ]
    mine = tuple(k for k, span in enumerate(near) if span.block == block)
    axes = np.stack([span.axis for span in near]) if near else np.zeros((0, 2, 3))
    return Part(axes, tuple(span.number for span in near), mine, core)


def _once(seen: Sequence[SeenSpan], cores: Sequence[Cells]) -> list[SeenSpan]:
    """One of the spans that several blocks show; none that is cut off by the end of what a block reads."""
    kept: list[SeenSpan] = []
    own = [bool(cores[one.block].hold(one.axis[:, :2].mean(0)[None])[0]) for one in seen]
    # Those of their own block first, of these the ones with structures at both ends and most wires.
    order = sorted(range(len(seen)), key=lambda k: (not own[k], -sum(seen[k].held), -seen[k].wires, k))
    for k in order:
        one = seen[k]
        same = any(other.block != one.block and _same(one, other) for other in kept)
        if not same and (own[k] or all(one.held)):
            kept.append(one)
    return kept


def _same(one: SeenSpan, other: SeenSpan) -> bool:
    """Whether both ends agree, or one runs along most of the other: its end is hidden from one block."""
    for axis in (other.axis, other.axis[::-1]):
        if np.linalg.norm(one.axis - axis, axis=1).max() <= SAME_M:
            return True
    short, long = sorted((one, other), key=lambda it: float(np.linalg.norm(it.axis[1] - it.axis[0])))
    places = short.axis[0] + np.linspace(0.05, 0.95, 9)[:, None] * (short.axis[1] - short.axis[0])
    return bool(distance_to(places[:, :2], long.axis[:, :2]).max() <= SAME_M)


def _nodes(spans: Sequence[SeenSpan]) -> list[tuple[int, int]]:
    """The structures at both ends of each span, one number for those that are the same; an open end has one
    of its own."""
    ends = np.concatenate([one.axis[:, :2] for one in spans])
    held = np.array([is_held for one in spans for is_held in one.held])
    node = np.arange(len(ends))
    for i, j in sorted(cKDTree(ends).query_pairs(SAME_M)):
        if held[i] and held[j]:
            node[node == node[j]] = node[i]
    return [(int(node[2 * k]), int(node[2 * k + 1])) for k in range(len(spans))]


def _connected(first: int, nodes: Sequence[tuple[int, int]], left: set[int]) -> set[int]:
    """The spans that a line of shared structures leads to."""
    found, fresh = {first}, [first]
    while fresh:
        mine = set(nodes[fresh.pop()])
        more = [k for k in left if k not in found and mine & set(nodes[k])]
        found.update(more)
        fresh += more
    return found


def _first(spans: Sequence[SeenSpan], nodes: Sequence[tuple[int, int]], left: set[int]) -> tuple[int, bool]:
    """A span with an end that no other shares, the westernmost such end; whether that end is its first."""
    counts: dict[int, int] = {}
    for k in left:
        for node in nodes[k]:
            counts[node] = counts.get(node, 0) + 1
    ends = [(k, side) for k in sorted(left) for side in (0, 1) if counts[nodes[k][side]] == 1]
    ends = ends or [(k, 0) for k in sorted(left)]  # a ring
    k, side = min(ends, key=lambda end: tuple(spans[end[0]].axis[end[1], :2]))
    return k, side == 0


def _next(
    spans: Sequence[SeenSpan], nodes: Sequence[tuple[int, int]], left: set[int], node: int,
    axis: Float[np.ndarray, "2 3"],
) -> tuple[int, bool] | None:  # fmt: skip
    """The span that goes on from a structure with the least bend; None where none does."""
    u = (axis[1] - axis[0]) / max(float(np.linalg.norm(axis[1] - axis[0])), 1e-9)
    found = []
    for k in left:
        for side in (0, 1):
            if nodes[k][side] == node:
                along = spans[k].axis[1 - side] - spans[k].axis[side]
                found.append((-float(u @ along) / max(float(np.linalg.norm(along)), 1e-9), k, side == 0))
    if not found:
        return None
    _, k, forwards = min(found)
    return k, forwards
