"""The supports of a run's wires: where they stand along the line, and which points are theirs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from plnerf.scene.transforms import Frames
from plnerf.survey.attachments import held_at
from plnerf.survey.columns import Column, column_at, find_columns
from plnerf.survey.curve_wires import metre_of
from plnerf.survey.model import Tower
from plnerf.survey.surface import Surface
from plnerf.wires.curves import Curve

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
    sigma_m: tuple[float | None, float | None]
    """Standard deviation along the line of the first and the last support's place; None: it is not seen."""


def between_supports(
    surface: Surface, field: Surface, curves: Sequence[Curve], frames: Frames
) -> tuple[list[Curve], Supports]:
    """The curves from support to support, and these; where none is seen, a curve ends as it did.

    Bodies are looked for in the field, which shows a lattice from all sides: stereo sees its near side alone.
    """
    if not curves:
        return [], Supports((), np.zeros(len(surface.xyz), np.bool_), (None, None))
    metre = frames.scale * metre_of(frames)
    of_field, of_stereo = (frames.to_scene(one.xyz) / metre for one in (field, surface))
    lines = [curve.points(np.linspace(*curve.ends, 60)) / metre for curve in curves]
    bodies = find_columns(of_field, lines)
    first, last = (float(f([line[end, 0] for line in lines])) for f, end in ((np.min, 0), (np.max, -1)))
    x = np.linspace(first - ABOUT_END_M, last + ABOUT_END_M, 120) * metre
    wires = [curve.points(x) / metre for curve in curves]
    towers, of_tower = [], np.zeros(len(surface.xyz), np.bool_)
    sigma: list[float | None] = [None, None]
    ends: list[float | None] = [None, None]
    for k, body in enumerate(bodies):
        column, sigma[k] = _support(body, (first, last)[k], of_stereo, of_field, wires)
        if column is not None:
            ends[k] = column.x_m * metre
            of_tower |= column.holds(of_stereo, wires)
            foot = frames.to_world(metre * np.array([[column.x_m, column.y_m, column.foot_m]]))[0]
            towers.append(Tower(foot, (column.top_m - column.foot_m) * metre_of(frames)))
    held = [replace(curve, ends=_ends(curve, *ends)) for curve in curves]
    return held, Supports(tuple(towers), of_tower, (sigma[0], sigma[1]))


def _support(
    body: Column | None,
    end: float,
    of_stereo: Float[np.ndarray, "n 3"],
    of_field: Float[np.ndarray, "m 3"],
    wires: Sequence[Float[np.ndarray, "_ 3"]],
) -> tuple[Column | None, float | None]:
    """Where the wires are held about a body, or their end, by the best that shows it, and how exactly."""
    middle, reach = (end, ABOUT_END_M) if body is None else (body.x_m, AROUND_M)
    for points, sigma in ((of_stereo, BY_STEREO_M), (of_field, BY_FIELD_M)):
        at = held_at(points, wires, middle - reach, middle + reach)
        if at is not None:
            # A support is as high as its highest wire.
            found = column_at(at, of_field, wires)
            highest = max(float(np.interp(at, wire[:, 0], wire[:, 2])) for wire in wires)
            return replace(body or found, x_m=at, top_m=max(highest, (body or found).top_m)), sigma
    return body, None if body is None else BY_BODY_M


def _ends(curve: Curve, first: float | None, last: float | None) -> tuple[float, float]:
    """A curve's own where there is no support."""
    return curve.ends[0] if first is None else first, curve.ends[1] if last is None else last
