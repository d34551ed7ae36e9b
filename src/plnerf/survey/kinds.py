"""Which wires of a span are shields, by where they hang and what they look like.

The wires within `level_m` of the highest are shields if they are one or two, hang alone (no bundles), have
three wires or more at least `below_m` beneath them, and differ from those as shields do: the others are
bundles, or they sag less, or they are so thin that they have fewer points.

Along a line a wire stays what it is: those that go on in the next span, held by the same structure at the
same place across the line, have one kind.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from plnerf.line.ends import Attached
from plnerf.line.line import Line
from plnerf.line.wire import Kind, Wire
from plnerf.survey.config_wires import KindsConfig


def with_kinds(
    lines: Sequence[Line], counts: Mapping[int, int], config: KindsConfig = KindsConfig()
) -> tuple[Line, ...]:
    """The lines with the kinds of their wires, the same in all spans of a line through which a wire goes.

    counts: the points of each wire, by its id, or whatever tells how well each is seen.
    """
    return tuple(_with_kinds(line, counts, config) for line in lines)


def kinds(wires: Sequence[Wire], counts: Sequence[int], config: KindsConfig = KindsConfig()) -> list[Kind]:
    """The kind of each wire of one span, by its curve and its number of points.

    The sag between what is seen of the ends serves to compare wires of one span, attached or not.
    Letters: h height of a wire where all of them are compared.
    """
    L = [wire.base.length_m for wire in wires]
    at = _section(wires)
    h = at[:, 2]
    top = h >= h.max(initial=-np.inf) - config.level_m
    below = h < h[top].min(initial=np.inf) - config.below_m
    phases: list[Kind] = ["phase"] * len(wires)
    if (
        not 1 <= top.sum() <= config.max_shields
        or below.sum() < config.min_below
        or (~top & ~below).any()
    ):  # fmt: skip
        return phases
    members = (np.linalg.norm(at[:, None] - at, axis=2) <= config.bundle_m).sum(1)
    hang = np.array([
        8 * wire.drop_between(0.0, length) / length**2 for wire, length in zip(wires, L, strict=True)
    ])  # fmt: skip
    dense = np.array(counts) / L
    bundled = members[top].max() == 1 and np.median(members[below]) > 1
    flatter = np.median(hang[top]) < config.flatter * np.median(hang[below])
    thinner = np.median(dense[top]) < config.thinner * np.median(dense[below])
    if members[top].max() > 1 or not (bundled or flatter or thinner):
        return phases
    return ["shield" if high else "phase" for high in top]


def _section(wires: Sequence[Wire]) -> Float[np.ndarray, "w 3"]:
    """The wires' points half way along what is seen of all of them: of some the images may show less."""
    if not wires:
        return np.zeros((0, 3))
    o, u = wires[0].base.a, wires[0].base.u
    s = np.sort(np.array([[(end - o) @ u for end in (wire.base.a, wire.base.b)] for wire in wires]), axis=1)
    middle = o + (s[:, 0].max() + s[:, 1].min()) / 2 * u
    return np.concatenate([wire.points(np.array([(middle - wire.base.a) @ wire.base.u])) for wire in wires])


def _with_kinds(line: Line, counts: Mapping[int, int], config: KindsConfig) -> Line:
    wires = list(line.wires)
    number = {wire.id: k for k, wire in enumerate(wires)}
    shield = np.zeros(len(wires))
    for span in line.spans:
        of_span = kinds(span.wires, [counts[wire.id] for wire in span.wires], config)
        for wire, kind in zip(span.wires, of_span, strict=True):
            shield[number[wire.id]] = kind == "shield"
    pairs = [(number[a], number[b]) for a, b in _going_on(line, config)]
    one, other = np.array(pairs, np.int64).reshape(-1, 2).T
    graph = coo_array((np.ones(len(one)), (one, other)), shape=(len(wires), len(wires)))
    _, through = connected_components(graph, directed=False)
    length = np.array([wire.base.length_m for wire in wires])
    share = np.bincount(through, length * shield) / np.bincount(through, length) if wires else np.zeros(0)

    def named(wire: Wire) -> Wire:
        return replace(
            wire, kind="shield" if share[through[number[wire.id]]] >= config.min_share else "phase"
        )

    spans = tuple(replace(span, wires=tuple(map(named, span.wires))) for span in line.spans)
    return replace(line, spans=spans)


def _going_on(line: Line, config: KindsConfig) -> list[tuple[int, int]]:
    """Ids of wires of two spans that are one wire: of all that a structure holds, either is the nearest to
    the other across the line there.  Insulators of strain structures hold them apart along it."""
    found = []
    for structure in line.structures:
        ends = [
            (k, wire.id, end.point, wire.base.u)
            for k, span in enumerate(line.spans)
            for wire in span.wires
            for end in wire.ends
            if isinstance(end, Attached) and end.structure == structure.id
        ]
        for k in sorted({end[0] for end in ends}):
            for j in sorted({end[0] for end in ends if end[0] > k}):
                mine, theirs = ([end for end in ends if end[0] == span] for span in (k, j))
                u, v = mine[0][3], theirs[0][3]
                along = u + v if u @ v >= 0 else u - v
                across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
                a, b = (
                    np.array([[end[2][:2] @ across, end[2][2]] for end in some]) for some in (mine, theirs)
                )
                apart = np.linalg.norm(a[:, None] - b, axis=2)
                to, back = apart.argmin(1), apart.argmin(0)
                found += [
                    (mine[i][1], theirs[to[i]][1])
                    for i in range(len(mine))
                    if back[to[i]] == i and apart[i, to[i]] <= config.same_m
                ]
    return found
