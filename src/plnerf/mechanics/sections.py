"""Tension sections: the spans through which one wire runs on from one strain structure to the next."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from plnerf.line.ends import Attached
from plnerf.line.line import Line
from plnerf.line.stations import Stretch, chains
from plnerf.line.wire import Wire

SAME_M = 1.5
"""Two spans' wires are one where their attachments at a structure are nearer to each other than this."""
ENDS_IT = ("strain", "terminal")
"""Kinds of structures that hold a wire's tension."""


@dataclass(frozen=True, eq=False)
class Section:
    """A wire span by span, in the order of its line."""

    wires: tuple[Wire, ...]
    forward: tuple[bool, ...]
    """Whether each runs as its line does."""
    open_at: tuple[str, ...]
    """Where it may go on beyond what was surveyed, in words; empty: it is known whole."""
    assumed: tuple[int, ...]
    """Structures of unknown kind in between, over which it is taken to run on."""

    @property
    def ruling_span_m(self) -> float:
        """sqrt(sum of L^3 / sum of L), of what was surveyed."""
        spans = np.array([wire.base.length_m for wire in self.wires])
        return float(np.sqrt((spans**3).sum() / spans.sum()))


def sections(line: Line, strain: Collection[int] = ()) -> list[Section]:
    """Of all wires of a line that structures hold at both ends.

    strain: structures that are known to end a section, beside those whose kind says so.  At structures of
    unknown kind a wire is taken to go on, as over a suspension.
    """
    ending = {one.id for one in line.structures if one.kind in ENDS_IT} | set(strain)
    kinds = {one.id: one.kind for one in line.structures}
    found: list[list[tuple[Wire, Stretch]]] = []
    for chain in chains(line):
        growing: list[list[tuple[Wire, Stretch]]] = []
        for stretch in chain:
            wires = [wire for wire in stretch.span.wires if wire.open is None]
            free = list(growing) if stretch.held[0] not in ending else []
            growing = []
            for wire in wires:
                before = _before(wire, stretch, free)
                section = [] if before is None else before
                if before is None:
                    found.append(section)
                else:
                    free.remove(before)
                section.append((wire, stretch))
                growing.append(section)
    return [
        Section(
            tuple(wire for wire, _ in one),
            tuple(_forward(wire, stretch) for wire, stretch in one),
            tuple(
                f"structure {id_} ({'of unknown kind' if kinds.get(id_) == 'unknown' else kinds.get(id_)})"
                for id_ in (one[0][1].held[0], one[-1][1].held[1])
                if id_ is not None and id_ not in ending
            ),
            tuple(
                id_ for _, stretch in one[1:] if (id_ := stretch.held[0]) and kinds.get(id_) == "unknown"
            ),
        )
        for one in found
    ]


def _before(
    wire: Wire, stretch: Stretch, free: list[list[tuple[Wire, Stretch]]]
) -> list[tuple[Wire, Stretch]] | None:
    """The section that a wire goes on with: whose attachment at the structure between them is nearest."""
    at = _attachment(wire, stretch.held[0])
    near = [
        (float(np.linalg.norm(at - there)), k)
        for k, section in enumerate(free)
        if at is not None
        and section[-1][0].kind == wire.kind
        and (there := _attachment(section[-1][0], stretch.held[0])) is not None
    ]
    if not near or min(near)[0] > SAME_M:
        return None
    return free[min(near)[1]]


def _attachment(wire: Wire, structure: int | None) -> np.ndarray | None:
    return next(
        (end.point for end in wire.ends if isinstance(end, Attached) and end.structure == structure), None
    )


def _forward(wire: Wire, stretch: Stretch) -> bool:
    return bool(wire.base.u @ stretch.base.u >= 0)
