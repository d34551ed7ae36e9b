"""True wires for tests: catenaries along x between two towers, and points on them."""

import numpy as np

from plnerf.capture.similarity import Similarity
from plnerf.line.hang import hang
from plnerf.line.line import Structure
from plnerf.line.polylines import resample
from plnerf.line.wire import Wire
from plnerf.score.truth import Truth

SPAN_M = 40.0


def wire(y: float, z: float = 10.0, *, name: str = "", sag_m: float = 1.2, span_m: float = SPAN_M) -> Wire:
    return hang((-span_m / 2, y, z), (span_m / 2, y, z + 0.4), sag_m, name=name or f"y {y:g}")


def span(*wires: Wire) -> Truth:
    feet = [np.array([x, 0.0, 0.0]) for x in (-SPAN_M / 2, SPAN_M / 2)]
    return Truth(wires, tuple(Structure(i, foot, 13.0, 0.0, "the truth") for i, foot in enumerate(feet, 1)))


def on(truth: Truth, step_m: float = 0.02) -> np.ndarray:
    """Points on all of the wires."""
    return np.concatenate([resample(line.polyline(), step_m) for line in truth.wires])


def turned(turn_rad: float, shift: np.ndarray) -> Similarity:
    """About z, and shifted."""
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    return Similarity(1.0, np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), shift)
