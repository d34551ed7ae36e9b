"""How much of what images show well of the true wires a survey has.

A truth may state of each wire the stretches that enough images show, wide enough and from different enough
sides, to measure it there (`observable_m`).  One frame, metres.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from plnerf.line.polylines import require_samples
from plnerf.line.wire import Wire
from plnerf.score.config import WireScoreConfig
from plnerf.score.truth import Truth

STEP_M = 0.05
"""Spacing of the places asked about, and of points on the survey's wires: 3 mm of error at 10 cm."""


@dataclass(frozen=True)
class ObservableWire:
    """Of one true wire."""

    wire: str
    """Its name."""
    observable_m: float
    found_m: float
    """Length of the observable stretches that a wire of the survey is near to."""


@dataclass(frozen=True)
class Observable:
    """Of all true wires."""

    wires: tuple[ObservableWire, ...]
    """Those with observable stretches."""
    within_m: float
    """What counts as near."""

    @property
    def total_m(self) -> float:
        """Length of all observable stretches."""
        return sum(one.observable_m for one in self.wires)

    @property
    def recall(self) -> float | None:
        """Share of it that is found; None without any."""
        return sum(one.found_m for one in self.wires) / self.total_m if self.total_m else None


def score_observable(found: Sequence[Wire], truth: Truth, config: WireScoreConfig) -> Observable | None:
    """None where the truth does not state what is observable."""
    if not truth.observable:
        return None
    lines = [np.zeros((0, 3)), *(wire.polyline(STEP_M) for wire in found)]
    tree = cKDTree(np.concatenate(lines))
    rows = []
    for wire, stretches in zip(truth.wires, truth.observable, strict=True):
        near = 0.0
        for low, high in stretches:
            require_samples(high - low, STEP_M)
            s = np.linspace(low, high, max(2, round((high - low) / STEP_M) + 1))
            away = tree.query(wire.points(s), distance_upper_bound=2 * config.found_m)[0]
            near += float((away <= config.found_m).mean()) * (high - low)
        length = sum(high - low for low, high in stretches)
        if length:
            rows.append(ObservableWire(wire.name or "", length, near))
    return Observable(tuple(rows), config.found_m)
