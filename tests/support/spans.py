"""True wires for tests: catenaries along x between two towers, and points on them."""

from dataclasses import replace

import numpy as np

from plnerf.line.catenary import hang
from plnerf.line.polylines import resample
from plnerf.score.truth import TrueTower, TrueWire, WireTruth

SPAN_M = 40.0


def wire(
    y: float, z: float = 10.0, *, name: str = "", sag_m: float = 1.2, span_m: float = SPAN_M
) -> TrueWire:
    curve = hang((-span_m / 2, y, z), (span_m / 2, y, z + 0.4), sag_m)
    line = curve.polyline(0.25)
    return TrueWire(name or f"y {y:g}", "phase", line, np.array(curve.a), np.array(curve.direction))


def span(*wires: TrueWire) -> WireTruth:
    feet = [np.array([x, 0.0, 0.0]) for x in (-SPAN_M / 2, SPAN_M / 2)]
    return WireTruth(wires, tuple(TrueTower(foot, 13.0) for foot in feet))


def on(truth: WireTruth, step_m: float = 0.02) -> np.ndarray:
    """Points on all of the wires."""
    return np.concatenate([resample(line.polyline, step_m) for line in truth.wires])


def moved(truth: WireTruth, turn_rad: float, shift: np.ndarray) -> tuple[WireTruth, np.ndarray]:
    """The truth turned about z and shifted, and the rotation."""
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    wires = tuple(
        replace(
            line,
            polyline=line.polyline @ turn.T + shift,
            a=turn @ line.a + shift,
            direction=turn[:2, :2] @ line.direction,
        )
        for line in truth.wires
    )
    towers = tuple(replace(tower, foot=turn @ tower.foot + shift) for tower in truth.towers)
    return WireTruth(wires, towers), turn
