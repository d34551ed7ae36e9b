"""The part of a corridor that a survey is about: some of its spans, by the numbers that they have there.

A block of a corridor shows more than its own: the stretches of neighbouring spans that its structures and
tension strings need, and lines that cross.  All are surveyed; what is not the block's own is left out then,
so that blocks can be put together without doubles.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from plnerf.line.cloud import NO_WIRE, Attributes, Cloud
from plnerf.line.ends import Open
from plnerf.line.frame import LineFrame
from plnerf.line.line import Line, Span, Structure
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire

WIRES_OF_A_SPAN = 100
"""More than any span has."""
PLACES = 9
"""Places along a span that are compared with the spans of the corridor."""
CROSSING_M = 50.0
"""Spans of other lines that come so near to the block's own stay in it: they may cross."""


@dataclass(frozen=True)
class SpanNumber:
    """What a span of a corridor is called."""

    line: int
    span: int
    structures: tuple[int, int]
    """Ids of the structures where its axis begins and ends, whether they are seen or not."""
    from_m: float
    """Station of where it begins."""

    @property
    def first_wire(self) -> int:
        """Id of its first wire; the others follow: 301, 302, ... of span 3, whoever numbers the others."""
        return WIRES_OF_A_SPAN * self.span + 1


@dataclass(frozen=True, eq=False)
class Cells:
    """Squares of the world's plan."""

    side: float
    """In world units."""
    keys: Int[np.ndarray, "c 2"]
    """Of each square its lower corner, in sides."""

    def hold(self, points: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
        """Which points lie in one of them."""
        return np.isin(_as_one(np.floor(points / self.side).astype(np.int64)), _as_one(self.keys))


@dataclass(frozen=True, eq=False)
class Part:
    """Which spans of a corridor a survey is about."""

    axes: Float[np.ndarray, "m 2 3"]
    """Where each span of the corridor near the block begins and ends, world frame."""
    numbers: tuple[SpanNumber, ...]
    mine: tuple[int, ...]
    """Indices of the block's own."""
    cells: Cells | None = None
    """Where the points of its cloud lie; None: wherever its own spans are the nearest ones."""


def numbered_part(
    part: Part, frame: LineFrame, lines: Sequence[Line], cloud: Cloud, detected: Sequence[Wire] = ()
) -> tuple[tuple[Line, ...], Cloud, tuple[Wire, ...]]:
    """The lines without spans that are another block's, all with the numbers of the corridor.

    Spans of other lines that come near to the block's own stay.  Points on wires that are left out belong to
    no wire.  detected: wires with the ids of those of the lines, which are numbered likewise.
    """
    axes = frame.from_world(part.axes)[..., :2]
    ids: dict[int, int] = {}
    structures: dict[int, dict[int, Structure]] = {}
    spans: dict[int, dict[int, Span]] = {}
    for line in lines:
        names = {one.id: _end_number(one.foot[:2], axes, part) for one in line.structures if len(axes)}
        feet = {one.id: one for one in line.structures}
        for span in sorted(line.spans, key=lambda span: -len(span.wires)):
            index = _axis_of(span, axes)
            if index is None or not _stays(span, index, axes, part):
                continue
            number = part.numbers[index]
            mine = spans.setdefault(number.line, {})
            before = mine[number.span].wires if number.span in mine else ()
            ids |= {wire.id: number.first_wire + len(before) + k for k, wire in enumerate(span.wires)}
            wires = (*before, *(_renamed(wire, ids[wire.id], names) for wire in span.wires))
            held = _along_axis(span, axes[index], names) if not before else mine[number.span].structures
            mine[number.span] = Span(number.span, held, wires)
            for one in span.structures:
                if one is not None:
                    its = structures.setdefault(number.line, {})
                    its.setdefault(names[one], replace(feet[one], id=names[one]))
    station = {one.span: one.from_m for one in part.numbers}
    new = tuple(
        Line(
            number,
            tuple(of for _, of in sorted(structures.get(number, {}).items())),
            tuple(of for _, of in sorted(its.items())),
            from_m=station[min(its)],
        )
        for number, its in sorted(spans.items())
    )
    early = {ids[wire.id]: replace(wire, id=ids[wire.id]) for wire in detected if wire.id in ids}
    in_order = tuple(early[wire.id] for line in new for wire in line.wires if wire.id in early)
    return new, replace(cloud, wire=_mapped(cloud.wire, ids)), in_order


def own_points(survey: Survey, part: Part) -> Survey:
    """The survey with those points of its cloud that are the block's."""
    cloud, frame = survey.cloud, survey.frame
    if part.cells is not None:
        mine = part.cells.hold(frame.to_world(cloud.xyz)[:, :2])
    else:
        nearest = nearest_axis(cloud.xyz[:, :2], frame.from_world(part.axes)[..., :2])
        mine = np.isin(nearest, part.mine)
    return replace(survey, cloud=some_points(cloud, mine))


def some_points(cloud: Cloud, use: Bool[np.ndarray, " n"]) -> Cloud:
    """A cloud of some of the points of another one, with all that is known of them."""
    columns = {
        name: None if value is None else value[use]
        for name in ("xyz", "label", "wire", "rgb", "sigma_m", "seen", "past")
        for value in (getattr(cloud, name),)
    }
    given: Attributes | None = cloud.attributes
    if given is not None:
        given = replace(
            given,
            columns={name: value[use] for name, value in given.columns.items()},
            label=given.label[use],
            values=tuple(value[use] for value in given.values),
        )
    return replace(cloud, **columns, attributes=given)  # type: ignore[arg-type]  # each by its name


def nearest_axis(points: Float[np.ndarray, "n 2"], axes: Float[np.ndarray, "m 2 2"]) -> Int[np.ndarray, " n"]:
    """Index of the segment that is nearest to each point; of several the first."""
    best, which = np.full(len(points), np.inf), np.zeros(len(points), np.int64)
    for k, segment in enumerate(axes):
        apart = distance_to(points, segment)
        nearer = apart < best
        best[nearer], which[nearer] = apart[nearer], k
    return which


def distance_to(
    points: Float[np.ndarray, "n 2"], segment: Float[np.ndarray, "2 2"]
) -> Float[np.ndarray, " n"]:
    """From each point to a segment."""
    a, along = segment[0], segment[1] - segment[0]
    s = np.clip((points - a) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    apart: Float[np.ndarray, " n"] = np.linalg.norm(points - a - s[:, None] * along, axis=1)
    return apart


def _axis_of(span: Span, axes: Float[np.ndarray, "m 2 2"]) -> int | None:
    """The span of the corridor beside which a span's wires run; None: it has none."""
    if not span.wires or not len(axes):
        return None
    points = _along(span)
    return int(np.argmin([distance_to(points, axis).mean() for axis in axes]))


def _along(span: Span) -> Float[np.ndarray, "_ 2"]:
    """Places along all wires of a span."""
    at: Float[np.ndarray, "_ 2"] = np.concatenate([
        wire.points(np.linspace(0.0, wire.base.length_m, PLACES))[:, :2] for wire in span.wires
    ])  # fmt: skip
    return at


def _stays(span: Span, index: int, axes: Float[np.ndarray, "m 2 2"], part: Part) -> bool:
    if index in part.mine:
        return True
    own = {part.numbers[k].line for k in part.mine}
    if part.numbers[index].line in own:
        return False
    points = _along(span)
    return any(distance_to(points, axes[k]).min() <= CROSSING_M for k in part.mine)


def _along_axis(
    span: Span, axis: Float[np.ndarray, "2 2"], names: dict[int, int]
) -> tuple[int | None, int | None]:
    """The structures of a span in the direction of the corridor's axis."""
    a, b = (None if one is None else names[one] for one in span.structures)
    runs = np.sum([wire.base.b - wire.base.a for wire in span.wires], axis=0)
    return (a, b) if runs @ (axis[1] - axis[0]) >= 0 else (b, a)


def _end_number(foot: Float[np.ndarray, "2"], axes: Float[np.ndarray, "m 2 2"], part: Part) -> int:
    """The number of a structure: that of the nearest end of an axis."""
    k = int(np.linalg.norm(axes.reshape(-1, 2) - foot, axis=1).argmin())
    return part.numbers[k // 2].structures[k % 2]


def _renamed(wire: Wire, number: int, structures: dict[int, int]) -> Wire:
    ends = tuple(
        end if isinstance(end, Open) else replace(end, structure=structures[end.structure])
        for end in wire.ends
    )
    return replace(wire, id=number, ends=(ends[0], ends[1]))


def _mapped(wire: Int[np.ndarray, " n"], ids: dict[int, int]) -> Int[np.ndarray, " n"]:
    if not len(wire):
        return wire
    table = np.full(max([int(wire.max()), *ids]) + 1, NO_WIRE, np.int64)
    for old, new in ids.items():
        table[old] = new
    return table[wire]


def _as_one(keys: Int[np.ndarray, "n 2"]) -> Int[np.ndarray, " n"]:
    """Two numbers of 31 bits as one."""
    return (keys[:, 0] << 32) + keys[:, 1]
