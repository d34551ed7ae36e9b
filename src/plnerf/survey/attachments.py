"""Where wires are held: nothing is right above a wire but what it hangs from, an insulator and its arm.

A support's body is metres deep and shows one side first; its arms are narrow, and stand before far ground.
Wires that stand on pins, with nothing above them, are not told so.

Letters: n points in the scene frame in metres (x along the line, z up); k of them above one wire.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

ABOVE_M = (0.25, 1.6)
"""Nearer points may be the wire's own, higher ones the next wire's."""
ASIDE_M = 0.5
DEPTH_M = 0.5
"""Along the line, of an arm and what hangs from it."""
LEAST_POINTS = 12
AROUND_M, LEAST_SHARE = 1.0, 0.8
"""Of the points above a wire within so far to either side, how many must be at one place: a crown's are
everywhere."""
STEP_M = 0.05


def held_at(
    points: Float[np.ndarray, "n 3"], wires: Sequence[Float[np.ndarray, "_ 3"]], low: float, high: float
) -> float | None:
    """Where between two places of the line the wires (polylines along x) are held; None: nothing shows it."""
    points = points[(points[:, 0] >= low - AROUND_M) & (points[:, 0] <= high + AROUND_M)]
    held = [_at_one_place(_above(points, wire, wires), low, high) for wire in wires]
    every = np.concatenate(held) if held else np.zeros(0)
    return float(np.median(every[_window(every, low, high)])) if len(every) else None


def _above(
    points: Float[np.ndarray, "n 3"],
    wire: Float[np.ndarray, "_ 3"],
    wires: Sequence[Float[np.ndarray, "_ 3"]],
) -> Float[np.ndarray, " k"]:
    """Places of the points above a wire that are on none."""

    def off(line: Float[np.ndarray, "_ 3"]) -> Float[np.ndarray, "2 n"]:
        at = np.stack([np.interp(points[:, 0], line[:, 0], line[:, axis]) for axis in (1, 2)])
        return points[:, 1:].T - at

    aside, above = off(wire)
    hung = (np.abs(aside) <= ASIDE_M) & (above >= ABOVE_M[0]) & (above <= ABOVE_M[1])
    for line in wires:
        hung &= np.hypot(*off(line)) >= ABOVE_M[0]
    return points[hung, 0]


def _at_one_place(x: Float[np.ndarray, " k"], low: float, high: float) -> Float[np.ndarray, " _"]:
    """Those at the place where most are; none where they are few or not at one place."""
    here = _window(x, low, high)
    around = np.abs(x - np.median(x[here])) <= AROUND_M if here.any() else here
    return x[here] if here.sum() >= max(LEAST_POINTS, LEAST_SHARE * around.sum()) else x[:0]


def _window(x: Float[np.ndarray, " k"], low: float, high: float) -> np.ndarray:
    """Which lie within the stretch of `DEPTH_M`, its middle between two places, that holds most."""
    places = np.arange(low, high + STEP_M, STEP_M)
    counts = np.array([(np.abs(x - place) <= DEPTH_M / 2).sum() for place in places])
    return np.abs(x - places[np.argmax(counts)]) <= DEPTH_M / 2
