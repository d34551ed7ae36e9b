"""Flights along the line: a place for every share of the way, for a slider to move along."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from plnerf.errors import ConfigError
from plnerf.line.stations import chains
from plnerf.line.survey import Survey
from plnerf.render.paths import fly_along, in_time_order
from plnerf.view.eye import Eye, eye_of, looking
from plnerf.view.opened import Opened
from plnerf.view.posed_views import PosedViews

FRAMES = 401
"""Of a flight along the cameras, between which nothing is interpolated."""
FOV_RAD = 0.9
ASIDE, ABOVE, AHEAD = 0.9, 0.35, 0.9
"""Beside the wires, above them and how far ahead of the eye it looks, as shares of `_size`."""
LEAST_M = 8.0


@dataclass(frozen=True)
class Flight:
    """A way to fly."""

    name: str
    length_m: float
    at: Callable[[float, float], Eye]
    """The eye at a share of the way, from 0 to 1, in a window of some aspect."""


def flights_of(opened: Opened) -> tuple[Flight, ...]:
    """Along the cameras as they were flown, and beside every stretch of the surveyed line."""
    found: list[Flight] = []
    if opened.views is not None and (flown := _as_filmed(opened.views)) is not None:
        found.append(flown)
    if opened.survey is not None:
        found += _along_line(opened.survey)
    # A field is known best from where it was filmed; of wires and points the line itself is to be seen.
    return tuple(found if opened.run is not None else found[::-1])


def _as_filmed(views: PosedViews) -> Flight | None:
    order = in_time_order(views.names, range(len(views.names)))
    try:
        path = fly_along(views.cameras[order], FRAMES)
    except ConfigError:
        return None  # the cameras make no pass
    length = float(np.linalg.norm(np.diff(path.centre.numpy(), axis=0), axis=1).sum())

    def at(share: float, aspect: float) -> Eye:
        return eye_of(path, round(share * (FRAMES - 1)), aspect)

    return Flight("as filmed", length, at)


def _along_line(survey: Survey) -> list[Flight]:
    """A flight for each chain of spans of each line."""
    found = []
    for line in survey.lines:
        for chain in chains(line):
            wires = [wire for stretch in chain for wire in stretch.span.wires]
            ends = np.concatenate([wire.points(np.array([0.0, wire.base.length_m])) for wire in wires])
            size = max(LEAST_M, *(float(np.ptp(stretch.base.local(ends)[:, 1])) for stretch in chain))
            stops = np.array([chain[0].base.a, *(stretch.base.b for stretch in chain)])
            stations = np.array([chain[0].from_m, *(stretch.to_m for stretch in chain)])
            places = np.concatenate([
                wire.points(np.linspace(0, wire.base.length_m, 33)) for wire in wires
            ])  # fmt: skip
            first = chain[0]
            name = f"beside line {line.id}" if len(survey.lines) > 1 else "beside the line"
            if len(chains(line)) > 1:
                name += f", from span {first.span.id}"
            found.append(_beside(name, stops, stations, places, size))
    return found


def _beside(
    name: str, stops: np.ndarray, stations: np.ndarray, places: np.ndarray, size: float
) -> Flight:
    """To the right of the line and above its wires, looking ahead at them."""
    length = float(stations[-1] - stations[0])

    def ground(station: float) -> np.ndarray:
        return np.array([np.interp(station, stations, stops[:, k]) for k in range(2)])

    def at(share: float, aspect: float) -> Eye:
        station = stations[0] + share * length
        step = max(size, 1.0)
        here = ground(station)
        u = ground(min(station + step, stations[-1])) - ground(max(station - step, stations[0]))
        u /= max(float(np.linalg.norm(u)), 1e-9)
        near = np.linalg.norm(places[:, :2] - here, axis=1)
        z = float(np.median(places[np.argsort(near)[: max(8, len(places) // 16)], 2]))
        target = np.array([*(here + AHEAD * size * u), z])
        aside = ASIDE * size * np.array([u[1], -u[0]])
        place = np.array([*(here - AHEAD * size * u + aside), z + ABOVE * size])
        return looking(place, target, FOV_RAD, aspect)

    return Flight(name, length, at)
