"""Phases of a span, each of one conductor or of a bundle, and the strings of insulators that hold wires.

LineFrame, metres.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from plnerf.line.ends import Quantity
from plnerf.line.line import Span
from plnerf.line.wire import Kind, Wire

StringKind = Literal["suspension", "strain"]


@dataclass(frozen=True)
class Phase:
    """What hangs as one conductor in a span."""

    number: int
    """From 1, in the order of the span's wires."""
    kind: Kind
    name: str | None
    circuit: str | None
    wires: tuple[int, ...]
    """Ids of its subconductors."""
    spacing: Quantity | None
    """Between neighbouring subconductors, the mean, at mid-span; None: it is one conductor."""


@dataclass(frozen=True, eq=False)
class InsulatorString:
    """A string of insulators, as a segment."""

    structure: int
    wires: tuple[int, ...]
    """Ids of the wires that it holds."""
    kind: StringKind
    ends: Float[np.ndarray, "2 3"]
    """At the structure and at the wire."""
    sigma_m: float
    """Standard deviation of its end at the structure, along it."""
    points: int
    """Of the cloud that lie on it."""

    @property
    def length_m(self) -> float:
        """From end to end."""
        return float(np.linalg.norm(self.ends[1] - self.ends[0]))


def phases_of(span: Span) -> tuple[Phase, ...]:
    """The phases of a span, and its other wires likewise; wires of one bundle are one."""
    groups: dict[tuple[str, int], list[Wire]] = {}
    for wire in span.wires:
        key = ("wire", wire.id) if wire.bundle is None else ("bundle", wire.bundle)
        groups.setdefault(key, []).append(wire)
    return tuple(
        Phase(
            k, wires[0].kind, wires[0].name, wires[0].circuit, tuple(wire.id for wire in wires),
            _spacing(wires) if len(wires) > 1 else None,
        )
        for k, wires in enumerate(groups.values(), 1)
    )  # fmt: skip


def _spacing(wires: Sequence[Wire]) -> Quantity:
    """Mean over the subconductors of the distance to the nearest other; those of a bundle are independent."""
    middles = [wire.points(np.array([wire.base.length_m / 2]))[0] for wire in wires]
    at = np.array(middles)
    apart = np.linalg.norm(at[:, None] - at, axis=2) + np.where(np.eye(len(at), dtype=bool), np.inf, 0.0)
    sigma = [np.hypot(*wire.sigma_at(np.array([wire.base.length_m / 2]))[0]) for wire in wires]
    spread = float(np.sqrt(2 * np.mean(np.square(sigma)) / len(wires)))
    return Quantity(float(apart.min(1).mean()), spread)
