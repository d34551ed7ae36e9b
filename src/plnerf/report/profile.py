"""A span from the side, as SVG: its wires with what is below them, its structures and its worst clearances.

Letters as in `side.py`; heights on the axis are the shown ones (`shown.py`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from plnerf.line.cloud import GROUND, HIGH_VEGETATION, TOWER
from plnerf.line.ends import TWO_SIDED_95, Attached
from plnerf.line.line import Line, Span, Structure
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.report.colours import CLASSES, DASHED, KINDS, MARK
from plnerf.report.figures import CERTAIN, MINUS, Units, counted, runs_of
from plnerf.report.nearest import Nearest, worst
from plnerf.report.shown import height_shift
from plnerf.report.side import (
    BOTTOM,
    LEFT,
    RIGHT,
    TOP,
    Scale,
    Side,
    below,
    fitting,
    runs,
    side_of,
    ticks,
)
from plnerf.report.words import title_of

LINE_PX = 13
"""Height of a line of small text."""
LETTER_PX = 7.5
"""Width of a digit of an id."""
LEAST_WIDTH = 640
"""A drawing scrolls sideways on screens narrower than this, in pixels."""
UNSEEN = 0.35
"""Opacity of a wire where it was not seen."""


@dataclass(frozen=True)
class Drawing:
    """A span's drawing and what belongs below it."""

    title: str
    svg: str
    about: str
    marks: tuple[tuple[str, str], ...]
    """Letters in the drawing, and what they stand for."""


def profile(survey: Survey, line: Line, span: Span, rows: list[Nearest]) -> Drawing:
    """One span from the side.  rows: the survey's least clearances, by need."""
    wires, units, up = span.wires, Units(survey.frame.unit), height_shift(survey.frame)
    side, ids = side_of(wires), {wire.id for wire in wires}
    measured = survey.clearances.wires if survey.clearances is not None else ()
    profiles = [one.profile for one in measured if one.wire in ids]
    under = below(side, profiles)
    structures = [one for one in line.structures if one.id in span.structures]
    marked = worst(rows, ids)
    scale = _scale(side, wires, structures, [
        under.lowest, under.highest, under.vegetation,
        *(np.array([one.place.on_wire[2], one.place.on_obstacle[2]]) for one in marked),
    ])  # fmt: skip
    brown, floor = CLASSES[GROUND][1], np.full_like(under.t, scale.bottom)
    parts = [
        *_axes(scale, units, up),
        *_filled(scale, under.t, under.lowest, under.vegetation, CLASSES[HIGH_VEGETATION][1], 0.45),
        *_filled(scale, under.t, floor, under.highest, brown, 0.35),
        *_filled(scale, under.t, floor, under.lowest, brown, 0.6),
    ]
    if not np.isfinite(under.lowest).any():
        x, y = LEFT + scale.width / 2, TOP + scale.height - 12
        text = "no ground known" if profiles else "the ground was not measured"
        parts.append(f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="middle">{text}</text>')
    parts += [_structure(scale, side, one) for one in structures]
    parts += [part for wire in wires for part in _wire(scale, side, wire)]
    names, right = _names(scale, side, wires)
    parts += names
    letters = [chr(ord("A") + k) for k in range(len(marked))]
    for k, one in enumerate(marked):
        parts += _mark(scale, side, one, letters[k], (k + 1) / (len(marked) + 1))
    title = title_of(survey, line, span)
    label = f"{title} from the side, with {counted(len(wires), 'wire')}"
    width, height = LEFT + scale.width + right, TOP + scale.height + BOTTOM
    svg = (
        f'<svg viewBox="0 0 {width:.0f} {height:.0f}" role="img" aria-label="{label}" font-size="12" '
        f'style="max-width:{width:.0f}px;min-width:{min(width, LEAST_WIDTH):.0f}px">{"".join(parts)}</svg>'
    )
    marks = tuple((letter, _about_mark(one, units)) for letter, one in zip(letters, marked, strict=True))
    return Drawing(title, svg, about(scale, wires), marks)


def _scale(
    side: Side, wires: Sequence[Wire], structures: Sequence[Structure], heights: list[np.ndarray]
) -> Scale:
    """The drawing that holds all wires, structures and further heights."""
    curves = [wire.points(np.linspace(0.0, wire.base.length_m, 121))[:, 2] for wire in wires]
    tall = [np.array([one.foot[2], one.top[2]]) for one in structures]
    z = np.concatenate([*curves, *tall, *heights])
    feet = side.t(np.array([one.foot for one in structures]).reshape(-1, 3))
    t = np.array([0.0, side.length, *feet])
    return fitting(t.min(), t.max(), float(np.nanmin(z)), float(np.nanmax(z)))


def about(scale: Scale, wires: Sequence[Wire]) -> str:
    """What a drawing shows, and by how much it is stretched."""
    stretched = (
        "Heights and lengths at the same scale"
        if scale.exaggeration == 1
        else f"Heights exaggerated {scale.exaggeration:g} times"
    )
    unseen = any(wire.evidence.seen_m is not None for wire in wires)
    is_open = any(wire.open for wire in wires)
    return (
        f"{stretched}. Wires with their {CERTAIN} band, numbered at the right; shield wires are dashed"
        + ", and stretches that were not seen are pale" * unseen
        + ". A dot is an end that a structure holds"
        + ", a ring an open end" * is_open
        + ". Brown: ground below the wires, paler between its lowest and highest; green: the top of the "
        "vegetation near them. Letters: worst clearances, seen from the side, and so shorter than they are "
        "where the obstacle lies beside the wire."
    )


def _axes(scale: Scale, units: Units, up: float) -> list[str]:
    right, floor, parts = LEFT + scale.width, TOP + scale.height, []
    for z in ticks(scale.bottom + up, scale.top + up, scale.height / 55):
        y = scale.y(z - up)
        parts.append(f'<line x1="{LEFT}" x2="{right:.1f}" y1="{y:.1f}" y2="{y:.1f}" class="grid"/>')
        parts.append(f'<text x="{LEFT - 7}" y="{y:.1f}" dy="4" text-anchor="end">{_tick(z)}</text>')
    for t in ticks(scale.first, scale.first + scale.width / scale.per_unit, scale.width / 90):
        x = scale.x(t)
        parts.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{floor:.1f}" y2="{floor + 4:.1f}" class="axis"/>')
        parts.append(f'<text x="{x:.1f}" y="{floor + 17:.1f}" text-anchor="middle">{_tick(t)}</text>')
    parts.append(f'<line x1="{LEFT}" x2="{right:.1f}" y1="{floor:.1f}" y2="{floor:.1f}" class="axis"/>')
    below, beside = (LEFT + scale.width / 2, floor + 36), (14, TOP + scale.height / 2)
    for (x, y), turn, name in ((below, 0, "along the span"), (beside, -90, "height z")):
        parts.append(
            f'<text transform="translate({x:.1f} {y:.1f}) rotate({turn})" text-anchor="middle">{name}, '
            f"{units.short}</text>"
        )
    return parts


def _tick(value: float) -> str:
    return f"{value + 0.0:.10g}".replace("-", MINUS)


def _filled(
    scale: Scale,
    grid: Float[np.ndarray, " g"],
    low: Float[np.ndarray, " g"],
    high: Float[np.ndarray, " g"],
    colour: str,
    opacity: float,
) -> list[str]:
    """The area below a height in pieces where it is known, down to a lower one or to the edge."""
    parts, low = [], np.where(np.isnan(low), scale.bottom, low)
    for run in runs(np.isfinite(high)):
        t = np.concatenate([grid[run], grid[run][::-1]])
        z = np.concatenate([high[run], low[run][::-1]])
        parts.append(f'<polygon points="{scale.path(t, z)}" fill="{colour}" fill-opacity="{opacity}"/>')
    return parts


def _structure(scale: Scale, side: Side, one: Structure) -> str:
    """A mast that narrows upwards."""
    x, foot, top = scale.x(float(side.t(one.foot[None])[0])), scale.y(one.foot[2]), scale.y(one.top[2])
    colour = CLASSES[TOWER][1]
    return (
        f'<path d="M{x - 7:.1f},{foot:.1f} L{x - 2:.1f},{top:.1f} H{x + 2:.1f} L{x + 7:.1f},{foot:.1f}" '
        f'fill="{colour}" fill-opacity=".18" stroke="{colour}" stroke-width="1.5">'
        f"<title>structure {one.id}</title></path>"
        f'<text x="{x:.1f}" y="{foot - 4:.1f}" text-anchor="middle" class="mast">{one.id}</text>'
    )


def _wire(scale: Scale, side: Side, wire: Wire) -> list[str]:
    """The catenary, pale where it was not seen, its 95 % band, and marks at its ends."""
    colour, length = KINDS[wire.kind][1], wire.base.length_m
    s = np.linspace(0.0, length, 61)
    points, sigma = wire.points(s), wire.sigma_at(s)[:, 1]
    t, half = side.t(points), np.nan_to_num(TWO_SIDED_95 * sigma)  # none where it is not known
    around = np.concatenate([points[:, 2] + half, (points[:, 2] - half)[::-1]])
    band = scale.path(np.concatenate([t, t[::-1]]), around.clip(scale.bottom, scale.top))
    parts = [f'<polygon points="{band}" fill="{colour}" fill-opacity=".25"/>']
    seen = wire.evidence.seen_m
    stretches = [
        (0.0, length, 1.0 if seen is None else UNSEEN),
        *((low, high, 1.0) for low, high in seen or ()),
    ]
    dashes = ' stroke-dasharray="7 3"' if wire.kind in DASHED else ""
    for low, high, opacity in stretches:
        part = wire.points(np.linspace(low, high, 121))
        parts.append(
            f'<polyline points="{scale.path(side.t(part), part[:, 2])}" fill="none" stroke="{colour}" '
            f'stroke-width="1.6" stroke-opacity="{opacity:g}"{dashes}>'
            f"<title>wire {wire.id}, {wire.kind}</title></polyline>"
        )
    for end, x, z in zip(wire.ends, t[[0, -1]], points[[0, -1], 2], strict=True):
        fill, radius = (colour, 2.6) if isinstance(end, Attached) else ("white", 3.6)
        parts.append(
            f'<circle cx="{scale.x(x):.1f}" cy="{scale.y(z):.1f}" r="{radius}" fill="{fill}" '
            f'stroke="{colour}" stroke-width="1.4"/>'
        )
    return parts


def _names(scale: Scale, side: Side, wires: Sequence[Wire]) -> tuple[list[str], float]:
    """Ids beside the ends on the right, and the margin that they need; wires at one height share a line."""
    ends = []
    for wire in wires:
        points = wire.points(np.array([0.0, wire.base.length_m]))
        last = points[side.t(points).argmax()]
        ends.append((scale.y(last[2]), wire.id))
    groups: list[tuple[float, list[int]]] = []
    for y, id_ in sorted(ends):
        if groups and y - groups[-1][0] < 0.6 * LINE_PX:
            groups[-1][1].append(id_)
        else:
            groups.append((y, [id_]))
    parts, x, free, right = [], LEFT + scale.width + 8, -np.inf, float(RIGHT)
    for y, ids in groups:
        at = max(y, free)
        free = at + LINE_PX
        text = runs_of(ids)
        right = max(right, 16 + LETTER_PX * len(text))
        parts.append(f'<text x="{x:.1f}" y="{at:.1f}" dy="4" font-weight="600">{text}</text>')
    return parts, right


def _mark(scale: Scale, side: Side, one: Nearest, letter: str, share: float) -> list[str]:
    """The line between wire and obstacle, as it shows from the side, and its letter.

    share: of the way to the obstacle where the letter is, unlike the others' that may begin beside it.
    """
    wire, obstacle = one.place.on_wire, one.place.on_obstacle
    x0, x1 = (scale.x(t) for t in side.t(np.array([wire, obstacle])))
    y0, y1 = scale.y(wire[2]), scale.y(obstacle[2])
    x, y = x0 + 13, y0 + share * (y1 - y0)
    return [
        f'<line x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}" stroke="{MARK}" stroke-width="2"/>',
        f'<circle cx="{x1:.1f}" cy="{y1:.1f}" r="3" fill="{MARK}"/>',
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="8.5" fill="white" stroke="{MARK}" stroke-width="1.5"/>'
        f'<text x="{x:.1f}" y="{y:.1f}" dy="4" text-anchor="middle" font-weight="700">{letter}</text>',
    ]


def _about_mark(one: Nearest, units: Units) -> str:
    return (
        f"least distance to {one.to}: {units.interval_with_unit(one.distance)} ({CERTAIN}), "
        f"wire {one.place.wire}, at {units.with_unit(one.place.s_m, 1)}"
        + (f": {one.verdict}" if one.verdict else "")
    )
