"""Makes lines out of what was found in a cloud: structures, spans and wires, numbered along them.

A line is a chain of spans that share structures; spans that share none are lines of their own.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from plnerf.line.ends import Attached, End, Open
from plnerf.line.line import Line, Span, Structure
from plnerf.line.wire import Kind
from plnerf.survey.kinds import kinds, same_along
from plnerf.survey.lidar.candidates import Candidate
from plnerf.survey.lidar.config import LidarConfig
from plnerf.survey.lidar.spans import TrackSpan
from plnerf.survey.lidar.structures import NOTHING_SEEN, Holder, Outline


@dataclass(frozen=True, eq=False)
class Assembled:
    """Lines, and where the points of their wires and structures are."""

    lines: tuple[Line, ...]
    points: dict[int, Int[np.ndarray, " _"]]
    """Indices of the points of each wire, by its id."""
    outlines: dict[int, int]
    """Index of the outline of each structure, by its id."""


def assemble(
    spans: Sequence[TrackSpan], outlines: Sequence[Outline], holders: Sequence[tuple[Holder, Holder]],
    found: Sequence[Candidate], bodies: Sequence[int], config: LidarConfig,
) -> Assembled:  # fmt: skip
    """The lines of all spans that have wires; whatever holds no wire is left out.

    bodies: the number of points of each outline.  Structures, spans and wires are numbered from 1 through all
    lines, in their order along them; the wires of a span from the left to the right.
    """
    lines: list[Line] = []
    points: dict[int, np.ndarray] = {}
    ids: dict[int, int] = {}
    count = 0
    for chain in _chains(sorted({one.span for one in found}), holders):
        for k in chain:
            for holder in holders[k]:
                if isinstance(holder, int):
                    ids.setdefault(holder, len(ids) + 1)
        made: list[Span] = []
        for k in chain:
            count += 1
            mine = [one for one in found if one.span == k]
            of_kind = kinds([one.wire for one in mine], [len(one.points) for one in mine], config.kinds)
            held = (_id_of(holders[k][0], ids), _id_of(holders[k][1], ids))
            wires = []
            for one, kind in zip(mine, of_kind, strict=True):
                ends = _ends(one, kind, holders[k], outlines, ids, config)
                wire = replace(one.wire, id=len(points) + 1, ends=ends, kind=kind, notes=_notes(one, config))
                points[wire.id] = one.points
                wires.append(wire)
            made.append(Span(count, held, tuple(wires)))
        same = same_along([span.wires for span in made], config.kinds)
        made = [replace(span, wires=tuple(wires)) for span, wires in zip(made, same, strict=True)]
        structures = tuple(
            _structure(number, k, [(spans[j], holders[j]) for j in chain], outlines[k], bodies[k], config)
            for k, number in ids.items()
            if any(k in holders[j] for j in chain)
        )
        lines.append(Line(len(lines) + 1, structures, tuple(made)))
    return Assembled(tuple(lines), points, {number: k for k, number in ids.items()})


def _chains(used: Sequence[int], holders: Sequence[tuple[Holder, Holder]]) -> list[list[int]]:
    """Spans that share structures, in their order along the line; the lines in the order of their first."""
    pairs = [
        (i, j)
        for i in range(len(used))
        for j in range(i)
        if any(isinstance(one, int) and one in holders[used[j]] for one in holders[used[i]])
    ]
    one, other = np.array(pairs, np.int64).reshape(-1, 2).T
    graph = coo_array((np.ones(len(one)), (one, other)), shape=(len(used), len(used)))
    number, group = connected_components(graph, directed=False)
    return sorted([span for span, its in zip(used, group, strict=True) if its == k] for k in range(number))


def _id_of(holder: Holder, ids: dict[int, int]) -> int | None:
    return ids[holder] if isinstance(holder, int) else None


def _ends(
    one: Candidate, kind: Kind, hold: tuple[Holder, Holder], outlines: Sequence[Outline], ids: dict[int, int],
    config: LidarConfig,
) -> tuple[End, End]:  # fmt: skip
    """What holds a wire's ends; a wire that ends before its span's structure is open there."""
    ends: list[End] = []
    places = one.wire.points(np.array([0.0, one.wire.base.length_m]))
    for point, holder, seen in zip(places, hold, one.seen, strict=True):
        if isinstance(holder, Open):
            ends.append(holder)
        elif not seen:
            ends.append(NOTHING_SEEN)
        else:
            held = config.structure
            known = held.clamped_sigma_m if kind == "shield" else held.sigma_m
            sigma = known if outlines[holder].seen else held.inferred_sigma_m
            ends.append(Attached(ids[holder], point, sigma))
    return ends[0], ends[1]


def _sigma(outline: Outline, config: LidarConfig) -> float:
    return config.structure.sigma_m if outline.seen else config.structure.inferred_sigma_m


def _structure(
    number: int, index: int, chain: Sequence[tuple[TrackSpan, tuple[Holder, Holder]]], outline: Outline,
    body: int, config: LidarConfig,
) -> Structure:  # fmt: skip
    """index: of its outline."""
    outward = [
        span.u * sign
        for span, hold in chain
        for holder, sign in zip(hold, (1.0, -1.0), strict=True)
        if holder == index
    ]
    return Structure(
        number, outline.foot, outline.height_m, _sigma(outline, config),
        f"{body:,} points" if outline.seen else "the wires that meet there",
        line_angle_deg=_bend(outward[0], outward[1]) if len(outward) == 2 else None,
    )  # fmt: skip


def _bend(one: Float[np.ndarray, "2"], other: Float[np.ndarray, "2"]) -> float:
    """Degrees by which a line turns between two directions that lead away from its structure."""
    return float(np.degrees(np.arccos(np.clip(-one @ other, -1.0, 1.0))))


def _notes(one: Candidate, config: LidarConfig) -> tuple[str, ...]:
    said = []
    if one.bow_m >= config.wire.reported_bow_m:
        said.append(f"Its points bow {one.bow_m:.2f} m sideways from its curve.")
    if one.misfit_m >= config.wire.reported_misfit_m:
        said.append(f"It departs {one.misfit_m:.2f} m from one catenary: something may hold it in between.")
    return tuple(said)
