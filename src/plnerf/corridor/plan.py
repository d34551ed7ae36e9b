"""Spans of a corridor out of the wires of its blocks, and which photos and wires each span's block needs.

Letters: m spans, n cameras, p places; the corridor's LineFrame, metres.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from plnerf.corridor.config import CutConfig
from plnerf.detect.config import DetectConfig
from plnerf.detect.join import joined
from plnerf.detect.structures import ended_where_they_meet
from plnerf.line.frame import LineFrame
from plnerf.line.wire import Wire
from plnerf.scene.cameras import Cameras, project
from plnerf.survey.chains import find_chains, junctions
from plnerf.survey.config_spans import ChainConfig
from plnerf.survey.part import Part, SpanNumber, distance_to
from plnerf.survey.span_wires import Junction

STEP_M = 2.0
"""Between the places of a wire that are looked for in photos."""
NEAR_M = 500.0
"""Spans that are farther from a block are no business of it."""


@dataclass(frozen=True, eq=False)
class PlannedSpan:
    """A span as the wires of all blocks show it."""

    number: SpanNumber
    axis: Float[np.ndarray, "2 3"]
    """From where it begins to where it ends; height 0."""
    wires: tuple[Wire, ...]


def joined_wires(blocks: Sequence[Sequence[Wire]], config: DetectConfig) -> tuple[Wire, ...]:
    """One wire of the pieces that several blocks show of it, numbered from 1."""
    wires = ended_where_they_meet(joined(blocks, config.join), config.meet)
    return tuple(replace(wire, id=k) for k, wire in enumerate(wires, 1))


def planned_spans(wires: Sequence[Wire], config: ChainConfig) -> tuple[PlannedSpan, ...]:
    """All spans, line by line, numbered through; a structure has a number whether it is seen or not."""
    spans: list[PlannedSpan] = []
    structures = 1
    for line, chain in enumerate(find_chains([one for one in wires if one.evidence.certain], config), 1):
        places = [_place(junction) for junction in junctions(chain, config)]
        station = 0.0
        for span, (a, b) in zip(chain, pairwise(places), strict=True):
            number = SpanNumber(line, len(spans) + 1, (structures, structures + 1), station)
            spans.append(PlannedSpan(number, np.stack([a, b]), span.wires))
            structures, station = structures + 1, station + float(np.linalg.norm(b - a))
        structures += 1
    return tuple(spans)


def part_of(spans: Sequence[PlannedSpan], mine: Sequence[int], frame: LineFrame) -> Part:
    """The part of a corridor that some of its spans are."""
    own = np.concatenate([spans[k].axis[:, :2] for k in mine])
    near = [
        k for k, span in enumerate(spans) if k in mine or distance_to(own, span.axis[:, :2]).min() <= NEAR_M
    ]
    axes = frame.to_world(np.stack([spans[k].axis for k in near]))
    return Part(axes, tuple(spans[k].number for k in near), tuple(near.index(k) for k in mine))


def overlap_of(span: PlannedSpan, config: CutConfig) -> float:
    """How far a span's block reaches beyond its ends: of short spans half of their length, or most of what it
    holds would be its neighbours'."""
    return min(config.overlap_m, float(np.linalg.norm(span.axis[1] - span.axis[0])) / 2)


def given_wires(
    spans: Sequence[PlannedSpan], k: int, uncertain: Sequence[Wire], config: CutConfig
) -> tuple[Wire, ...]:
    """The wires of a span, and what lies within an overlap of it of all others."""
    axis, overlap_m = spans[k].axis[:, :2], overlap_of(spans[k], config)
    found = list(spans[k].wires)
    others = [wire for j, span in enumerate(spans) if j != k for wire in span.wires]
    for wire in (*others, *uncertain):
        near = _near(wire, axis, overlap_m)
        if near is not None:
            found.append(near)
    return tuple(replace(wire, id=number) for number, wire in enumerate(found, 1))


def images_of(
    span: PlannedSpan, given: Sequence[Wire], cameras: Cameras, config: CutConfig
) -> Int[np.ndarray, " k"]:
    """The cameras that stand beside a span or within an overlap of its ends, and see a wire of its block.

    cameras: of the whole corridor, in its LineFrame.
    """
    centre, overlap_m = cameras.centre.numpy(), overlap_of(span, config)
    a, along = span.axis[0, :2], span.axis[1, :2] - span.axis[0, :2]
    length = float(np.linalg.norm(along))
    s = (centre[:, :2] - a) @ along / max(length, 1e-9)
    beside = (s >= -overlap_m) & (s <= length + overlap_m)
    beside &= distance_to(centre[:, :2], span.axis[:, :2]) <= config.see_m + overlap_m
    near = np.flatnonzero(beside)
    places = np.concatenate([
        wire.points(np.arange(0.0, wire.base.length_m + STEP_M, STEP_M)) for wire in given
    ])  # fmt: skip
    return near[_sees(cameras[near.tolist()], places, config.see_m)] if len(near) else near


def _sees(cameras: Cameras, places: Float[np.ndarray, "p 3"], see_m: float) -> Bool[np.ndarray, " n"]:
    pixels, depth = project(cameras, torch.from_numpy(places))
    inside = ((pixels >= 0) & (pixels < cameras.size_px[:, None])).all(-1) & (depth > 0) & (depth <= see_m)
    seen: Bool[np.ndarray, " n"] = inside.any(1).numpy()
    return seen


def _place(junction: Junction) -> Float[np.ndarray, "3"]:
    """Where spans meet or a line ends, at height 0."""
    flat = junction.axis.a + junction.meet_m * junction.axis.u
    return np.array([*flat, 0.0])


def _near(wire: Wire, axis: Float[np.ndarray, "2 2"], reach_m: float) -> Wire | None:
    """What of a wire lies within a distance of an axis; None: nothing that has a length."""
    count = max(2, int(np.ceil(wire.base.length_m / STEP_M)) + 1)
    s = np.linspace(0.0, wire.base.length_m, count)
    inside = np.flatnonzero(distance_to(wire.points(s)[:, :2], axis) <= reach_m)
    if len(inside) < 2:
        return None
    low, high = float(s[inside[0]]), float(s[inside[-1]])
    whole = len(inside) == count
    return wire if whole else wire.between(low, high)
