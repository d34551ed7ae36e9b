"""Where wires are held: nothing is right above a wire but what it hangs from, an insulator and its arm.

A support's body is metres deep and shows one side first; its arms are narrow, and stand before far ground.
Wires that stand on pins, with nothing above them, are not told so.

Letters: n points (x along the line, y to its left, z up); k of them above one wire.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from plnerf.survey.config_wires import AttachmentConfig


@dataclass(frozen=True)
class Hangers:
    """What holds wires at one place of a line."""

    x_m: float
    held: tuple[bool, ...]
    """Of each wire, whether something that holds it is seen there."""

    @property
    def wires(self) -> int:
        return sum(self.held)


def held_at(
    points: Float[np.ndarray, "n 3"],
    wires: Sequence[Float[np.ndarray, "_ 3"]],
    low: float,
    high: float,
    config: AttachmentConfig,
) -> Hangers | None:
    """Where between two places of the line the wires (polylines along x) are held; None: nothing shows it."""
    points = points[(points[:, 0] >= low - config.around_m) & (points[:, 0] <= high + config.around_m)]
    above = [_above(points, wire, wires, config) for wire in wires]
    held = [_at_one_place(x, low, high, config) for x in above]
    every = np.concatenate(held) if held else np.zeros(0)
    if not len(every):
        return None
    at = float(np.median(every[_window(every, low, high, config)]))
    hangers = Hangers(at, tuple(bool((np.abs(x - at) <= config.depth_m / 2).any()) for x in held))
    # A single wire's may be a member of the body's, which is above the other wires too, elsewhere.
    return hangers if hangers.wires > 1 or _all_there(np.concatenate(above), at, config) else None


def _above(
    points: Float[np.ndarray, "n 3"],
    wire: Float[np.ndarray, "_ 3"],
    wires: Sequence[Float[np.ndarray, "_ 3"]],
    config: AttachmentConfig,
) -> Float[np.ndarray, " k"]:
    """Places of the points above a wire that are on none."""

    def off(line: Float[np.ndarray, "_ 3"]) -> Float[np.ndarray, "2 n"]:
        at = np.stack([np.interp(points[:, 0], line[:, 0], line[:, axis]) for axis in (1, 2)])
        return points[:, 1:].T - at

    aside, above = off(wire)
    hung = (np.abs(aside) <= config.aside_m) & (above >= config.above_m[0]) & (above <= config.above_m[1])
    for line in wires:
        hung &= np.hypot(*off(line)) >= config.above_m[0]
    return points[hung, 0]


def _at_one_place(
    x: Float[np.ndarray, " k"], low: float, high: float, config: AttachmentConfig
) -> Float[np.ndarray, " _"]:
    """Those at the place where most are; none where they are few or not at one place."""
    here = _window(x, low, high, config)
    around = np.abs(x - np.median(x[here])) <= config.around_m if here.any() else here
    return x[here] if here.sum() >= max(config.least_points, config.least_share * around.sum()) else x[:0]


def _all_there(x: Float[np.ndarray, " k"], at: float, config: AttachmentConfig) -> bool:
    """Whether nearly all that are around a place are at it."""
    off = np.abs(x - at)
    return bool((off <= config.depth_m / 2).sum() >= config.least_share * (off <= config.around_m).sum())


def _window(x: Float[np.ndarray, " k"], low: float, high: float, config: AttachmentConfig) -> np.ndarray:
    """Which lie within the stretch of `depth_m`, its middle between two places, that holds most."""
    places = np.arange(low, high + config.step_m, config.step_m)
    counts = np.array([(np.abs(x - place) <= config.depth_m / 2).sum() for place in places])
    return np.abs(x - places[np.argmax(counts)]) <= config.depth_m / 2
