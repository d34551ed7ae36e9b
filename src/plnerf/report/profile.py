"""Spans from the side, as SVG: wires with what is below them, structures and the worst clearances, along the
line as surveyors draw it.

Letters as in `side.py`; heights on the axis are the shown ones (`shown.py`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from plnerf.line.cloud import GROUND, HIGH_VEGETATION, TOWER
from plnerf.line.ends import TWO_SIDED_95, Attached
from plnerf.line.line import Line, Structure
from plnerf.line.stations import Chain, Stretch, chains
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.report.band import BAND, band
from plnerf.report.colours import CLASSES, DASHED, KINDS, MARK
from plnerf.report.coverage_view import air_on_profile, ground_on_profile
from plnerf.report.figures import CERTAIN, MINUS, Units, counted, runs_of
from plnerf.report.nearest import Nearest, worst
from plnerf.report.shown import height_shift
from plnerf.report.side import (
    BOTTOM,
    LEFT,
    RIGHT,
    TOP,
    Below,
    Scale,
    below,
    fitting,
    runs,
    sheets,
    ticks,
)
from plnerf.report.state_table import state_curves, state_heights, state_legend
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
    """A drawing and what belongs below it."""

    title: str
    svg: str
    about: str
    marks: tuple[tuple[str, str], ...]
    """Letters in the drawing, and what they stand for."""


def profiles(survey: Survey, rows: list[Nearest]) -> list[Drawing]:
    """Of all lines, chain by chain.  rows: the survey's least clearances, by need."""
    return [
        profile(survey, line, sheet, rows)
        for line in survey.lines
        for chain in chains(line)
        for sheet in sheets(chain)
    ]


def profile(survey: Survey, line: Line, sheet: Chain, rows: list[Nearest]) -> Drawing:
    """Some spans, one after the other, from the side."""
    units, up = Units(survey.frame.unit), height_shift(survey.frame)
    of_wire = {wire.id: stretch for stretch in sheet for wire in stretch.span.wires}
    wires = [wire for stretch in sheet for wire in stretch.span.wires]
    measured = survey.clearances.wires if survey.clearances is not None else ()
    known = [one.profile for one in measured if one.wire in of_wire]
    under = [below(one, [each for each in known if of_wire[each.wire] is one]) for one in sheet]
    masts = _masts(line, sheet)
    marked = worst(rows, of_wire)
    scale = _scale(sheet, [one for one, _ in masts], [
        *(heights for one in under for heights in (one.lowest, one.highest, one.vegetation)),
        *(np.array([one.place.on_wire[2], one.place.on_obstacle[2]]) for one in marked),
        _heights_of_crossings(survey, of_wire),
        *state_heights(survey, of_wire),
    ])  # fmt: skip
    several = len(survey.spans) > 1
    parts = _axes(scale, units, up, "station along the line" if several else "along the span")
    no_air, no_ground = (mark(scale, survey, line.id, sheet) for mark in (air_on_profile, ground_on_profile))
    parts += [*no_air, *(part for each in under for part in _ground(scale, each)), *no_ground]
    if not any(np.isfinite(one.lowest).any() for one in under):
        x, y = LEFT + scale.width / 2, TOP + scale.height - 12
        text = "no ground known" if known else "the ground was not measured"
        parts.append(f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="middle">{text}</text>')
    parts += [_structure(scale, t, one) for one, t in masts]
    parts += state_curves(scale, survey, of_wire)
    parts += [part for wire in wires for part in _wire(scale, of_wire[wire.id], wire)]
    parts += [part for one in sheet[:-1] for part in _names(scale, one, inside=True)[0]]
    names, right = _names(scale, sheet[-1])
    parts += names
    crosses = _crossings(scale, survey, of_wire)
    parts += crosses
    letters = [chr(ord("A") + k) for k in range(len(marked))]
    for k, one in enumerate(marked):
        parts += _mark(scale, of_wire[one.place.wire], one, letters[k], (k + 1) / (len(marked) + 1))
    if several:
        parts += band(scale, survey.frame, sheet, masts, units)
    title = title_of(survey, line, [one.span.id for one in sheet])
    label = f"{title} from the side, with {counted(len(wires), 'wire')}"
    height = TOP + scale.height + BOTTOM + several * BAND
    legend, legend_height = state_legend(survey, scale.width, height)
    parts += legend
    width, height = LEFT + scale.width + right, height + legend_height
    svg = (
        f'<svg viewBox="0 0 {width:.0f} {height:.0f}" role="img" aria-label="{label}" font-size="12" '
        f'style="max-width:{width:.0f}px;min-width:{min(width, LEAST_WIDTH):.0f}px">{"".join(parts)}</svg>'
    )
    marks = tuple((letter, _about_mark(one, units)) for letter, one in zip(letters, marked, strict=True))
    text = about(scale, wires, crossed=bool(crosses), silent=bool(no_air or no_ground))
    if legend:
        text += " Thin dashed curves: the same wires in other states, which are named at the bottom."
    return Drawing(title, svg, text, marks)


def _heights_of_crossings(survey: Survey, of_wire: dict[int, Stretch]) -> Float[np.ndarray, " k"]:
    found = survey.clearances.crossings if survey.clearances is not None else ()
    return np.array([
        z for one in found if of_wire.keys() & {one.upper, one.lower}
        for z in (one.on_upper[2], one.on_lower[2])
    ], np.float64)  # fmt: skip


def _masts(line: Line, sheet: Chain) -> list[tuple[Structure, float]]:
    """The structures of a sheet with their stations."""
    found: dict[int, float] = {}
    for one in sheet:
        for id_, station in zip(one.held, (one.from_m, one.to_m), strict=True):
            if id_ is not None:
                found.setdefault(id_, station)
    return [(one, found[one.id]) for one in line.structures if one.id in found]


def _scale(sheet: Chain, structures: Sequence[Structure], heights: list[np.ndarray]) -> Scale:
    """The drawing that holds all wires, structures and further heights."""
    curves = [
        (one, wire.points(np.linspace(0.0, wire.base.length_m, 121)))
        for one in sheet
        for wire in one.span.wires
    ]
    tall = [np.array([one.foot[2], one.top[2]]) for one in structures]
    z = np.concatenate([*(curve[:, 2] for _, curve in curves), *tall, *heights])
    t = np.concatenate([[sheet[0].from_m, sheet[-1].to_m], *(one.station(curve) for one, curve in curves)])
    return fitting(t.min(), t.max(), float(np.nanmin(z)), float(np.nanmax(z)))


def _ground(scale: Scale, under: Below) -> list[str]:
    """The ground below the wires of a span, and the plants on it."""
    brown, floor = CLASSES[GROUND][1], np.full_like(under.t, scale.bottom)
    return [
        *_filled(scale, under.t, under.lowest, under.vegetation, CLASSES[HIGH_VEGETATION][1], 0.45),
        *_filled(scale, under.t, floor, under.highest, brown, 0.35),
        *_filled(scale, under.t, floor, under.lowest, brown, 0.6),
    ]


def about(
    scale: Scale, wires: Sequence[Wire], *, crossed: bool = False, silent: bool = False
) -> str:
    """What a drawing shows, and by how much it is stretched."""
    stretched = (
        "Heights and lengths at the same scale"
        if scale.exaggeration == 1
        else f"Heights exaggerated {scale.exaggeration:g} times"
    )
    unseen = any(wire.evidence.seen_m is not None for wire in wires)
    is_open = any(wire.open for wire in wires)
    return (
        f"{stretched}. Wires with their {CERTAIN} band, numbered beside their right ends; shield wires are "
        "dashed"
        + ", and stretches that were not seen are pale" * unseen
        + ". A dot is an end that a structure holds"
        + ", a ring an open end" * is_open
        + ", a cross a wire of a line that crosses" * crossed
        + ". Brown: ground below the wires, paler between its lowest and highest; green: the top of the "
        "vegetation near them. Letters: worst clearances, seen from the side, and so shorter than they are "
        "where the obstacle lies beside the wire."
        + " Grey behind the wires: stretches of which too little air was seen; a dark strip at the bottom: "
        "of which too little ground was." * silent
    )


def _axes(scale: Scale, units: Units, up: float, along: str) -> list[str]:
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
    for (x, y), turn, name in ((below, 0, along), (beside, -90, "height z")):
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


def _structure(scale: Scale, t: float, one: Structure) -> str:
    """A mast that narrows upwards."""
    x, foot, top = scale.x(t), scale.y(one.foot[2]), scale.y(one.top[2])
    colour = CLASSES[TOWER][1]
    return (
        f'<path d="M{x - 7:.1f},{foot:.1f} L{x - 2:.1f},{top:.1f} H{x + 2:.1f} L{x + 7:.1f},{foot:.1f}" '
        f'fill="{colour}" fill-opacity=".18" stroke="{colour}" stroke-width="1.5">'
        f"<title>structure {one.id}</title></path>"
        f'<text x="{x:.1f}" y="{foot - 4:.1f}" text-anchor="middle" class="mast">{one.id}</text>'
    )


def _wire(scale: Scale, stretch: Stretch, wire: Wire) -> list[str]:
    """The catenary, pale where it was not seen, its 95 % band, and marks at its ends."""
    colour, length = KINDS[wire.kind][1], wire.base.length_m
    s = np.linspace(0.0, length, 61)
    points, sigma = wire.points(s), wire.sigma_at(s)[:, 1]
    t, half = stretch.station(points), np.nan_to_num(TWO_SIDED_95 * sigma)  # none where it is not known
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
        path = scale.path(stretch.station(part), part[:, 2])
        parts.append(
            f'<polyline points="{path}" fill="none" stroke="{colour}" '
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


def _names(scale: Scale, stretch: Stretch, *, inside: bool = False) -> tuple[list[str], float]:
    """Ids beside the wires' ends on the right, and the margin that they need; wires at one height share one
    line.

    inside: before those ends, where another span goes on.
    """
    ends = []
    for wire in stretch.span.wires:
        points = wire.points(np.array([0.0, wire.base.length_m]))
        last = points[stretch.station(points).argmax()]
        ends.append((scale.y(last[2]), wire.id))
    groups: list[tuple[float, list[int]]] = []
    for y, id_ in sorted(ends):
        if groups and y - groups[-1][0] < 0.6 * LINE_PX:
            groups[-1][1].append(id_)
        else:
            groups.append((y, [id_]))
    parts, free, right = [], -np.inf, float(RIGHT)
    place = (
        f'x="{scale.x(stretch.to_m) - 12:.1f}" text-anchor="end" class="halo"'
        if inside
        else f'x="{LEFT + scale.width + 8:.1f}"'
    )
    for y, ids in groups:
        at = max(y, free)
        free = at + LINE_PX
        text = runs_of(ids)
        right = max(right, 16 + LETTER_PX * len(text))
        parts.append(f'<text {place} y="{at:.1f}" dy="4" font-weight="600">{text}</text>')
    return parts, right


def _mark(scale: Scale, stretch: Stretch, one: Nearest, letter: str, share: float) -> list[str]:
    """The line between wire and obstacle, as it shows from the side, and its letter.

    share: of the way to the obstacle where the letter is, unlike the others' that may begin beside it.
    """
    wire, obstacle = one.place.on_wire, one.place.on_obstacle
    x0, x1 = (scale.x(t) for t in stretch.station(np.array([wire, obstacle])))
    y0, y1 = scale.y(wire[2]), scale.y(obstacle[2])
    x, y = x0 + 13, y0 + share * (y1 - y0)
    return [
        f'<line x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}" stroke="{MARK}" stroke-width="2"/>',
        f'<circle cx="{x1:.1f}" cy="{y1:.1f}" r="3" fill="{MARK}"/>',
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="8.5" fill="white" stroke="{MARK}" stroke-width="1.5"/>'
        f'<text x="{x:.1f}" y="{y:.1f}" dy="4" text-anchor="middle" font-weight="700">{letter}</text>',
    ]


def _crossings(scale: Scale, survey: Survey, of_wire: dict[int, Stretch]) -> list[str]:
    """Crosses where wires of other lines pass over or under those of the drawing."""
    parts = []
    for one in survey.clearances.crossings if survey.clearances is not None else ():
        for wire, other, at in (
            (one.upper, one.lower, one.on_lower), (one.lower, one.upper, one.on_upper)
        ):  # fmt: skip
            if wire in of_wire:
                x, y = scale.x(float(of_wire[wire].station(at[None])[0])), scale.y(float(at[2]))
                parts.append(
                    f'<path d="M{x - 3.5:.1f},{y - 3.5:.1f} l7,7 m0,-7 l-7,7" stroke="{MARK}" '
                    f'stroke-width="1.6" fill="none"><title>wire {other}</title></path>'
                )
    return parts


def _about_mark(one: Nearest, units: Units) -> str:
    return (
        f"least distance to {one.to}: {one.sign}{units.interval_with_unit(one.distance)} ({CERTAIN}), "
        f"wire {one.place.wire}, at {units.with_unit(one.place.s_m, 1)}"
        + (f": {one.verdict}" if one.verdict else "")
    )
