"""Wires between the structures that hold them: one line of one span."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from plnerf.line.ends import Attached, End, Open
from plnerf.line.line import Line, Span, Structure
from plnerf.line.wire import Wire
from plnerf.survey.supports import Supports

NOT_SEEN = Open("no structure is seen there, and the images end or do not show it")


def hung_between(wire: Wire, extent: Wire, supports: Supports) -> Wire:
    """A wire from structure to structure, or to where its extent ends where none is seen.

    extent: the wire as it was detected, which ends where the images stop showing it.  At a structure the wire
    ends even where its extent ends before: its curve is known there.
    """
    u, a, ends = wire.base.u, wire.base.a, []
    for end, x_m in zip((extent.base.a, extent.base.b), supports.x_m, strict=True):
        place = end if x_m is None else np.array([x_m, a[1]])
        ends.append(float((place - a) @ u))
    hung = wire.between(ends[0], ends[1])
    first, last = (
        _end(structure, point)
        for structure, point in zip(
            supports.structures, hung.points(np.array([0.0, hung.base.length_m])), strict=True
        )
    )
    return replace(hung, ends=(first, last))


def _end(structure: Structure | None, point: np.ndarray) -> End:
    return NOT_SEEN if structure is None else Attached(structure.id, point, structure.sigma_m)


def line_of(wires: Sequence[Wire], structures: Sequence[Structure | None]) -> Line:
    """One line of one span.  structures: at its first and its last end."""
    first, last = (None if one is None else one.id for one in structures)
    seen = tuple(one for one in structures if one is not None)
    return Line(1, seen, (Span(1, (first, last), tuple(wires)),))
