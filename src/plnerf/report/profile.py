"""A span from the side, as SVG: its wires with what is below them, its supports and its worst clearances.

Letters as in `report_side.py`.
"""

import numpy as np
from jaxtyping import Float

from plnerf.report.colours import CLASSES, KINDS, MARK
from plnerf.report.data import TWO_SIDED_95, Clearance, Report
from plnerf.report.markup import Markup, bullets, safe, tag
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
from plnerf.report.words import CERTAIN, MINUS, Units, units_of
from plnerf.survey.model import GROUND, HIGH_VEGETATION, TOWER, Conductor, Tower

NEAR_SPAN = 0.25
"""A tower within this share of the span's length from its end is its support."""
LINE_PX = 13
"""Height of a line of small text."""


def profile(report: Report, span: int) -> Markup:
    """One span's drawing, with what its letters stand for below it."""
    conductors, units = report.spans[span], units_of(report.survey)
    side = side_of(conductors)
    ids = {one.id for one in conductors}
    under = below(side, conductors, [one for one in report.profiles if one.conductor in ids])
    towers = [one for one in report.survey.towers if _supports(side, one)]
    wires = {one.id: one.fit.curve.points(np.linspace(0, one.fit.curve.span_m, 121)) for one in conductors}
    worst = report.worst(ids)
    heights = np.concatenate([
        *(wire[:, 2] for wire in wires.values()), under.lowest, under.highest, under.vegetation,
        *([tower.foot[2], tower.foot[2] + tower.height_m] for tower in towers),
        *([one.on_wire[2], one.on_obstacle[2]] for one in worst),
    ])  # fmt: skip
    feet = side.t(np.array([tower.foot for tower in towers]).reshape(-1, 3))
    edges = np.array([0.0, side.length, *feet])
    scale = fitting(edges.min(), edges.max(), np.nanmin(heights), np.nanmax(heights))
    brown, floor = CLASSES[GROUND][1], np.full_like(under.t, scale.bottom)
    parts = [
        *_axes(scale, units),
        *_filled(scale, under.t, under.lowest, under.vegetation, CLASSES[HIGH_VEGETATION][1], 0.45),
        *_filled(scale, under.t, floor, under.highest, brown, 0.35),
        *_filled(scale, under.t, floor, under.lowest, brown, 0.6),
    ]
    if not np.isfinite(under.lowest).any():
        x, y = LEFT + scale.width / 2, TOP + scale.height - 12
        parts.append(f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="middle">no ground known</text>')
    parts += [_tower(scale, side, tower) for tower in towers]
    parts += [part for one in conductors for part in _wire(scale, side, one, wires[one.id])]
    parts += _names(scale, side, conductors)
    letters = [chr(ord("A") + k) for k in range(len(worst))]
    for k, one in enumerate(worst):
        parts += _mark(scale, side, one, letters[k], (k + 1) / (len(worst) + 1))
    length = units.with_unit(side.length)
    title = f"Span {span + 1} from the side, {length} long, with {len(conductors)} conductors"
    height = TOP + scale.height + BOTTOM
    drawing = Markup(
        f'<svg viewBox="0 0 {LEFT + scale.width + RIGHT:.0f} {height:.0f}" role="img" '
        f'aria-label="{safe(title)}" font-size="12">{"".join(parts)}</svg>'
    )
    notes = [_told(one, letter, units) for letter, one in zip(letters, worst, strict=True)]
    marks = tag("div", bullets(notes), class_="marks")
    caption = tag("figcaption", about(scale, length), marks if notes else "")
    return tag("figure", tag("div", drawing, class_="wide drawing", tabindex="0"), caption)


def about(scale: Scale, length: str) -> str:
    """What a drawing shows, and by how much it is stretched."""
    stretched = (
        "heights and lengths at the same scale"
        if scale.exaggeration == 1
        else f"heights exaggerated {scale.exaggeration:g} times"
    )
    return (
        f"{length} long, {stretched}. Orange: conductors, blue dashed: shield wires, both with their "
        f"{CERTAIN} band; numbers are ids. Brown: ground below the wires, paler between its lowest and "
        "highest; green: the top of vegetation near them. Letters: worst clearances, whose lines are seen "
        "from the side, and look shorter where the obstacle lies beside the wire."
    )


def _axes(scale: Scale, units: Units) -> list[str]:
    right, floor, parts = LEFT + scale.width, TOP + scale.height, []
    for z in ticks(scale.bottom, scale.top, scale.height / 55):
        y = scale.y(z)
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


def _supports(side: Side, tower: Tower) -> bool:
    along = tower.foot[:2] - side.o
    t, across = float(along @ side.u), float(abs(along @ np.array([-side.u[1], side.u[0]])))
    return min(abs(t), abs(t - side.length)) < NEAR_SPAN * side.length and across < NEAR_SPAN * side.length


def _tower(scale: Scale, side: Side, tower: Tower) -> str:
    """A mast that narrows upwards."""
    x, foot = scale.x(float(side.t(tower.foot[None])[0])), scale.y(tower.foot[2])
    top = scale.y(tower.foot[2] + tower.height_m)
    colour = CLASSES[TOWER][1]
    return (
        f'<path d="M{x - 7:.1f},{foot:.1f} L{x - 2:.1f},{top:.1f} H{x + 2:.1f} L{x + 7:.1f},{foot:.1f}" '
        f'fill="{colour}" fill-opacity=".18" stroke="{colour}" stroke-width="1.5"><title>tower</title></path>'
    )


def _wire(scale: Scale, side: Side, one: Conductor, wire: Float[np.ndarray, "k 3"]) -> list[str]:
    """The catenary, its 95 % band, and dots where it is held."""
    fit, colour = one.fit, KINDS[one.kind]
    s = np.linspace(0.0, fit.base.length_m, 61)
    yz, sigma = fit.base.at(fit.q, s), fit.sigma_at(s)[:, 1]
    t = side.t(np.column_stack([fit.base.o + s[:, None] * fit.base.u + yz[:, :1] * fit.base.n, yz[:, 1]]))
    half = np.nan_to_num(TWO_SIDED_95 * sigma)  # none where it is not known
    around = np.concatenate([yz[:, 1] + half, (yz[:, 1] - half)[::-1]]).clip(scale.bottom, scale.top)
    band = scale.path(np.concatenate([t, t[::-1]]), around)
    dashes = ' stroke-dasharray="7 3"' if one.kind == "shield" else ""
    ends = "".join(
        f'<circle cx="{scale.x(x):.1f}" cy="{scale.y(z):.1f}" r="2.6" fill="{colour}"/>'
        for x, z in zip(side.t(wire[[0, -1]]), wire[[0, -1], 2], strict=True)
    )
    return [
        f'<polygon points="{band}" fill="{colour}" fill-opacity=".25"/>',
        f'<polyline points="{scale.path(side.t(wire), wire[:, 2])}" fill="none" stroke="{colour}" '
        f'stroke-width="1.6"{dashes}><title>conductor {one.id}, {one.kind}</title></polyline>{ends}',
    ]


def _names(scale: Scale, side: Side, conductors: list[Conductor]) -> list[str]:
    """Ids beside the ends on the right; wires at one height share a line."""
    ends = []
    for one in conductors:
        points = np.array([one.fit.curve.a, one.fit.curve.b])
        last = points[side.t(points).argmax()]
        ends.append((scale.y(last[2]), one.id))
    groups: list[tuple[float, list[int]]] = []
    for y, id_ in sorted(ends):
        if groups and y - groups[-1][0] < 0.6 * LINE_PX:
            groups[-1][1].append(id_)
        else:
            groups.append((y, [id_]))
    parts, x, free = [], LEFT + scale.width + 8, -np.inf
    for y, ids in groups:
        at = max(y, free)
        free = at + LINE_PX
        text = ", ".join(str(one) for one in sorted(ids))
        parts.append(f'<text x="{x:.1f}" y="{at:.1f}" dy="4" font-weight="600">{text}</text>')
    return parts


def _mark(scale: Scale, side: Side, one: Clearance, letter: str, share: float) -> list[str]:
    """The line between wire and obstacle, as it shows from the side, and its letter.

    share: of the way to the obstacle where the letter is, unlike the others' that may begin beside it.
    """
    x0, x1 = (scale.x(t) for t in side.t(np.array([one.on_wire, one.on_obstacle])))
    y0, y1 = scale.y(one.on_wire[2]), scale.y(one.on_obstacle[2])
    x, y = x0 + 13, y0 + share * (y1 - y0)
    return [
        f'<line x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}" stroke="{MARK}" stroke-width="2"/>',
        f'<circle cx="{x1:.1f}" cy="{y1:.1f}" r="3" fill="{MARK}"/>',
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="8.5" fill="white" stroke="{MARK}" stroke-width="1.5"/>'
        f'<text x="{x:.1f}" y="{y:.1f}" dy="4" text-anchor="middle" font-weight="700">{letter}</text>',
    ]


def _told(one: Clearance, letter: str, units: Units) -> Markup:
    distance = f"{units.known_to(one.distance_m, one.sigma_m)} {units.short} ({CERTAIN})"
    text = (
        f" least distance to {one.to}: {distance}, conductor {one.conductor}, "
        f"at {units.with_unit(one.place_m, 1)}: {one.verdict}"
    )
    return Markup(tag("b", letter, class_="letter") + safe(text))
