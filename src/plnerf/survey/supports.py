"""The supports of a run's wires: where they stand along the line, and which points are theirs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from plnerf.detect.curves import Curve
from plnerf.scene.transforms import Frames
from plnerf.survey.attachments import held_at
from plnerf.survey.bodies import Column, column_at, find_columns
from plnerf.survey.curve_wires import metre_of
from plnerf.survey.field_surface import Surface
from plnerf.survey.model import Tower
from plnerf.survey.refine.curves import Held

BY_STEREO_M, BY_FIELD_M, BY_BODY_M = 0.05, 0.15, 0.3
"""Standard deviation along the line of a support's place, by what is about the wires there in stereo, by the
same in the field, and by the support's body in the field; as measured on rendered supports."""
AROUND_M = 2.5
"""What holds the wires is looked for so far from a support's body."""
ABOUT_END_M = 6.0
"""And without a body so far from where the images stop showing the wires: they may show the next span's, or
the support but not the wires before it."""


@dataclass(frozen=True, eq=False)
class Supports:
    """At either end of the wires."""

    towers: tuple[Tower, ...]
    points: Bool[np.ndarray, " n"]
    """Those of the surface that are theirs."""
    held: tuple[Held | None, Held | None]
    """Where the first and the last hold the wires; None: it is not seen."""


def between_supports(
    surface: Surface, field: Surface, curves: Sequence[Curve], frames: Frames
) -> tuple[list[Curve], Supports]:
    """The curves as far as they lie between the supports, and these.

    Bodies are looked for in the field, which shows a lattice from all sides: stereo sees its near side alone.
    """
    if not curves:
        return [], Supports((), np.zeros(len(surface.xyz), np.bool_), (None, None))
    metre = frames.scale * metre_of(frames)
    of_field, of_stereo = (frames.to_scene(one.xyz) / metre for one in (field, surface))
    lines = [curve.points(np.linspace(*curve.ends, 60)) / metre for curve in curves]
    bodies = find_columns(of_field, lines)
    first, last = min(float(line[0, 0]) for line in lines), max(float(line[-1, 0]) for line in lines)
    x = np.linspace(first - ABOUT_END_M, last + ABOUT_END_M, 120) * metre
    wires = [curve.points(x) / metre for curve in curves]
    towers, of_tower = [], np.zeros(len(surface.xyz), np.bool_)
    held: list[Held | None] = []
    for body, end in zip(bodies, (first, last), strict=True):
        column, sigma = _support(body, end, of_stereo, of_field, wires)
        held.append(None if column is None else Held(column.x_m * metre, sigma))
        if column is not None:
            of_tower |= column.holds(of_stereo, wires)
            foot = frames.to_world(metre * np.array([[column.x_m, column.y_m, column.foot_m]]))[0]
            towers.append(Tower(foot, (column.top_m - column.foot_m) * metre_of(frames)))
    low, high = (
        beyond if at is None else at.x for beyond, at in zip((-np.inf, np.inf), held, strict=True)
    )
    between = [
        replace(curve, ends=(max(curve.ends[0], low), min(curve.ends[1], high))) for curve in curves
    ]
    return between, Supports(tuple(towers), of_tower, (held[0], held[1]))


def _support(
    body: Column | None,
    end: float,
    of_stereo: Float[np.ndarray, "n 3"],
    of_field: Float[np.ndarray, "m 3"],
    wires: Sequence[Float[np.ndarray, "_ 3"]],
) -> tuple[Column | None, float]:
    """Where the wires are held about a body, or their end, by the best that shows it, and how exactly."""
    middle, reach = (end, ABOUT_END_M) if body is None else (body.x_m, AROUND_M)
    for points, sigma in ((of_stereo, BY_STEREO_M), (of_field, BY_FIELD_M)):
        at = held_at(points, wires, middle - reach, middle + reach)
        if at is not None:
            found = body or column_at(at, of_field, wires)
            # A support is as high as its highest wire.
            highest = max(float(np.interp(at, wire[:, 0], wire[:, 2])) for wire in wires)
            return replace(found, x_m=at, top_m=max(highest, found.top_m)), sigma
    return body, BY_BODY_M
