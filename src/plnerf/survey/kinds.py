"""Which wires of a span are shields, neutrals or communication cables, by where they hang and how they look.

The wires within `level_m` of the highest are shields if they are one or two, hang alone (no bundles), have
three wires or more at least `below_m` beneath them, and differ from those as shields do: the others are
bundles, or they sag less, or they are so thin that a laser has fewer points on them.  How many images show a
wire does not count: images cut off the highest ones.

A wire is no phase either if it hangs alone below three phases on one crossarm: the neutral if it is the next
one below, a communication cable if it is further down.  A vertical or a triangular circuit, and one of fewer
phases, has no such crossarm: there all wires stay phases, since one taken for a neutral loses its verdict.

Along a line a wire stays what it is: those that go on in the next span, held by the same structure at the
same place across the line, have one kind.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from plnerf.line.ends import Attached
from plnerf.line.line import Line
from plnerf.line.wire import Kind, Wire
from plnerf.survey.config_wires import KindsConfig

PHASES = 3
"""Of a circuit."""


def with_kinds(lines: Sequence[Line], config: KindsConfig = KindsConfig()) -> tuple[Line, ...]:
    """The lines of images with the kinds of their wires, the same in all spans through which a wire goes."""
    made = []
    for line in lines:
        alone = []
        for span in line.spans:
            names = kinds(span.wires, None, config)
            alone.append([replace(wire, kind=kind) for wire, kind in zip(span.wires, names, strict=True)])
        same = same_along(alone, config)
        spans = tuple(replace(span, wires=tuple(wires)) for span, wires in zip(line.spans, same, strict=True))
        made.append(replace(line, spans=spans))
    return tuple(made)


def kinds(
    wires: Sequence[Wire], counts: Sequence[int] | None, config: KindsConfig = KindsConfig()
) -> list[Kind]:
    """The kind of each wire of one span, by its curve and its number of a laser's points, if there are any.

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
        return _below_crossarm(h, config)
    members = (np.linalg.norm(at[:, None] - at, axis=2) <= config.bundle_m).sum(1)
    hang = np.array([
        8 * wire.drop_between(0.0, length) / length**2 for wire, length in zip(wires, L, strict=True)
    ])  # fmt: skip
    dense = np.ones(len(wires)) if counts is None else np.array(counts) / L
    bundled = members[top].max() == 1 and np.median(members[below]) > 1
    flatter = np.median(hang[top]) < config.flatter * np.median(hang[below])
    thinner = np.median(dense[top]) < config.thinner * np.median(dense[below])
    if members[top].max() > 1 or not (bundled or flatter or thinner):
        return phases
    return ["shield" if high else "phase" for high in top]


def _below_crossarm(h: Float[np.ndarray, " w"], config: KindsConfig) -> list[Kind]:
    """Kinds of wires by their heights where none is a shield."""
    named: list[Kind] = ["phase"] * len(h)
    order = np.argsort(-h, kind="stable")
    arm, rest = order[:PHASES], order[PHASES:]
    if len(rest) == 0 or np.ptp(h[arm]) > config.crossarm_m:
        return named
    down = h[arm].min() - h[rest]
    alone = np.diff(down, prepend=0.0) > config.crossarm_m  # side by side they may be another circuit
    low, high = config.neutral_m
    if alone.all() and low <= down[0] <= high and down[-1] <= config.communication_m:
        for k, wire in enumerate(rest.tolist()):
            named[wire] = "communication" if k else "neutral"
    return named


def _section(wires: Sequence[Wire]) -> Float[np.ndarray, "w 3"]:
    """The wires' points half way along what is seen of all of them: of some the images may show less."""
    if not wires:
        return np.zeros((0, 3))
    o, u = wires[0].base.a, wires[0].base.u
    s = np.sort(np.array([[(end - o) @ u for end in (wire.base.a, wire.base.b)] for wire in wires]), axis=1)
    middle = o + (s[:, 0].max() + s[:, 1].min()) / 2 * u
    return np.concatenate([wire.points(np.array([(middle - wire.base.a) @ wire.base.u])) for wire in wires])


def same_along(spans: Sequence[Sequence[Wire]], config: KindsConfig = KindsConfig()) -> list[list[Wire]]:
    """The wires of a line, each with one kind in all spans that it goes through.

    spans: the wires of every span, with the kinds that they have alone and the structures that hold them.
    """
    wires = [wire for span in spans for wire in span]
    first = np.cumsum([0, *map(len, spans)])
    through = through_spans(spans, config)
    length = np.array([wire.base.length_m for wire in wires])

    def share(kind: Kind) -> Float[np.ndarray, " w"]:
        """Of each wire's length in all spans, that in which it looks like one of the kind."""
        like = np.array([wire.kind == kind for wire in wires], np.float64)
        parts: Float[np.ndarray, " w"] = np.bincount(through, length * like) / np.bincount(through, length)
        return parts[through]

    is_shield = share("shield") >= config.min_share
    # More than that: a phase that is taken for one of these would lose its verdict.
    is_neutral, is_cable = (share(kind) > config.min_share for kind in ("neutral", "communication"))
    named = np.select([is_shield, is_neutral, is_cable], ["shield", "neutral", "communication"], "phase")
    same = [replace(wire, kind=kind) for wire, kind in zip(wires, named.tolist(), strict=True)]
    return [same[a:b] for a, b in pairwise(first)]


def through_spans(
    spans: Sequence[Sequence[Wire]], config: KindsConfig = KindsConfig()
) -> Int[np.ndarray, " w"]:
    """A number for every wire, span by span; those of several spans that are one wire have the same."""
    count = sum(map(len, spans))
    one, other = np.array(_going_on(spans, config), np.int64).reshape(-1, 2).T
    graph = coo_array((np.ones(len(one)), (one, other)), shape=(count, count))
    found: Int[np.ndarray, " w"] = connected_components(graph, directed=False)[1]
    return found


def _going_on(spans: Sequence[Sequence[Wire]], config: KindsConfig) -> list[tuple[int, int]]:
    """Pairs of wires of two spans that are one wire, by their numbers from 0: of all that a structure holds,
    either is the nearest to the other across the line there.  Insulators of strain structures hold them apart
    along it."""
    held: dict[int, dict[int, list[tuple[int, Wire, Attached]]]] = {}
    number = 0
    for k, span in enumerate(spans):
        for wire in span:
            for end in wire.ends:
                if isinstance(end, Attached):
                    held.setdefault(end.structure, {}).setdefault(k, []).append((number, wire, end))
            number += 1
    found = []
    for of_spans in held.values():
        for mine, theirs in combinations(of_spans.values(), 2):
            u, v = mine[0][1].base.u, theirs[0][1].base.u
            along = u + v if u @ v >= 0 else u - v
            across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
            a, b = (
                np.array([[end.point[:2] @ across, end.point[2]] for _, _, end in some])
                for some in (mine, theirs)
            )
            apart = np.linalg.norm(a[:, None] - b, axis=2)
            to, back = apart.argmin(1), apart.argmin(0)
            found += [
                (mine[i][0], theirs[j][0])
                for i, j in enumerate(to.tolist())
                if back[j] == i and apart[i, j] <= config.same_m
            ]
    return found
