"""Where along the line a structure holds each wire.

Of a wire that kinks, the kinks say it (`kinks.py`); one that hangs from something hangs at the structure's
own place.  A wire above which nothing is seen may stand on a pin instead, on a crossarm before or behind the
pole: photos may show where (`end_sweep.py`), and what they show of one wire holds of all on the same arm.

Letters: t along a junction's axis, y to its left; b and a wires before and after it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from plnerf.survey.config_wires import SupportConfig
from plnerf.survey.end_sweep import own_places
from plnerf.survey.kinks import Held
from plnerf.survey.posed_photos import Photos
from plnerf.survey.span_wires import Junction, at

_Places = list[float | None]


@dataclass(frozen=True)
class Stands:
    """Where a structure stands."""

    t: float
    sigma: float
    """Of t."""
    y: float
    """Of its body."""
    hung: tuple[bool, ...] = ()
    """Of each of the junction's conductors, whether something that holds it is seen above it; empty: of
    none."""


def held_places(
    junction: Junction, stands: Stands, held: Held | None, photos: Photos | None, config: SupportConfig
) -> tuple[Float[np.ndarray, "b 2"], Float[np.ndarray, "a 2"]]:
    """Of each wire on both sides, t of its attachment and its standard deviation.

    held: by kinks, if by any; photos: at their full size.
    """
    usual = stands.sigma if held is None else float(np.hypot(stands.sigma, config.kink.arms_m))
    before, after = (np.tile([stands.t, usual], (len(wires), 1)) for wires in junction.sides)
    standing = _standing(junction, stands, held)
    pins = _pins(junction, standing, stands, photos, config)
    for places, which, own in zip((before, after), standing, pins, strict=True):
        for k in which:
            t = own[k]
            apart = config.pin_m if t is None else config.by_pin_m
            places[k] = stands.t if t is None else t, np.hypot(usual, apart)
    for (i, j), own_place in ({} if held is None else held.own).items():
        before[i] = after[j] = own_place
    return before, after


def _standing(junction: Junction, stands: Stands, held: Held | None) -> tuple[list[int], list[int]]:
    """The wires on both sides that neither kink nor hang from something that is seen."""
    hung = stands.hung or (False,) * len(junction.conductors)
    kinked = () if held is None else held.own
    every = zip(junction.conductors, hung, strict=True)
    free = [pair for pair, above in every if not above and pair not in kinked]
    before, after = ([pair[side] for pair in free] for side in (0, 1))
    return [k for k in before if k is not None], [k for k in after if k is not None]


def _pins(
    junction: Junction,
    standing: Sequence[Sequence[int]],
    stands: Stands,
    photos: Photos | None,
    config: SupportConfig,
) -> tuple[_Places, _Places]:
    """Of each wire on both sides, where photos show it or its neighbours on the same arm held."""
    places: tuple[_Places, _Places] = ([None] * len(junction.sides[0]), [None] * len(junction.sides[1]))
    if photos is None or not any(standing):
        return places
    found = own_places(junction, photos, stands.t, stands.y, config.sweep)
    for side, (wires, own) in enumerate(zip(junction.sides, found, strict=True)):
        yz = np.array([at(wire, junction.axis, stands.t) for wire in wires]).reshape(-1, 2)
        beside = np.abs(yz[:, 0] - stands.y) >= config.sweep.aside_m  # else it is the body that is seen
        shown = [(i, t) for i in standing[side] if (t := own[i]) is not None and beside[i]]
        for k in standing[side]:
            arm = [t for i, t in shown if abs(yz[i, 1] - yz[k, 1]) <= config.sweep.apart_m]
            if arm and np.ptp(arm) <= config.sweep.agree_m:
                places[side][k] = float(np.median(arm))
    return places
