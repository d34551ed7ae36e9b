"""Where wires are no longer seen: what stands there may be a structure that was not found.

A structure holds all wires of a span.  Where half of them are seen to go on past a thing, as the same curves,
the thing is none: a single one's curve may be continued by chance, by what is behind it or by the next span's
wire.  LineFrame, metres.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from plnerf.line.cloud import HIGH_VEGETATION, LOW_VEGETATION, NO_WIRE, TOWER, VEGETATION, Cloud
from plnerf.line.ends import Attached
from plnerf.line.line import Span
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.survey.config_obstacles import ObstacleConfig
from plnerf.survey.green import is_green


@dataclass(frozen=True, eq=False)
class OpenEnd:
    """A place in plan at which a wire is seen last, or its curve ends, and no structure is known."""

    place: Float[np.ndarray, "2"]
    outwards: Float[np.ndarray, "2"]
    """Unit vector along the span."""
    last_m: float
    """How far along it half of the span's wires are seen, from the frame's origin."""


def open_ends(survey: Survey) -> list[OpenEnd]:
    """Those of all wires."""
    spans = [span for line in survey.lines for span in line.spans]
    return [end for span in spans for wire in span.wires for end in _of_wire(wire, span)]


def at_open_end(
    survey: Survey, index: Int[np.ndarray, " m"], config: ObstacleConfig
) -> Bool[np.ndarray, " m"]:
    """Which of the indexed points of a cloud from images are so near to where a wire is no longer seen that
    they may be a structure that was not found, or what it holds beyond; a bush, above which nothing stands,
    is none."""
    near = np.zeros(len(index), np.bool_)
    if survey.cloud.sigma_m is None or not len(index):
        return near
    places, green = survey.cloud.xyz[index, :2], is_green(survey.cloud, index, config.green)
    reach_m = np.where(green, config.plant_support_m, config.support_m)
    for end in open_ends(survey):
        close = np.linalg.norm(places - end.place, axis=1) < reach_m
        near |= close & (places @ end.outwards > end.last_m - config.passes_m)
    near[near] = ~_bushes(survey.cloud, index[near], config.bush_m)
    return near


def _bushes(cloud: Cloud, index: Int[np.ndarray, " m"], aside_m: float) -> Bool[np.ndarray, " m"]:
    """Which of the indexed points are low, and have nothing high so near to them in plan."""
    bush: Bool[np.ndarray, " m"] = np.isin(cloud.label[index], (LOW_VEGETATION, VEGETATION))
    high = np.isin(cloud.label, (HIGH_VEGETATION, TOWER)) & (cloud.wire == NO_WIRE)
    if high.any():
        bush &= cKDTree(cloud.xyz[high, :2]).query(cloud.xyz[index, :2], workers=-1)[0] > aside_m
    return bush


def _of_wire(wire: Wire, span: Span) -> Iterator[OpenEnd]:
    length, seen = wire.base.length_m, wire.evidence.seen_m
    last = ((0.0, seen[0][0]), (length, seen[-1][1])) if seen else ((0.0,), (length,))
    for end, at, sign in zip(wire.ends, last, (-1.0, 1.0), strict=True):
        if isinstance(end, Attached):
            continue
        outwards = sign * wire.base.u
        places = wire.points(np.array(at))[:, :2]
        reached = sorted(float((_seen(one) @ outwards).max()) for one in span.wires if one.evidence.seen_m)
        last_m = reached[len(reached) // 2] if reached else float(places[-1] @ outwards)
        for place in places:
            yield OpenEnd(place, outwards, last_m)


def _seen(wire: Wire) -> Float[np.ndarray, "k 2"]:
    """Where images see it first and last, in plan."""
    assert wire.evidence.seen_m
    (first, _), (_, last) = wire.evidence.seen_m[0], wire.evidence.seen_m[-1]
    return wire.points(np.array([first, last]))[:, :2]
