"""The lines from above, as SVG: wires, structures with bends, spans with length and direction, crossings.

As on surveyors' sheets, the first line runs from left to right, and an arrow points north.

Letters: x and y pixels, y down; the paper's axes are those of shown coordinates (`shown.py`), turned.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from plnerf.line.cloud import TOWER
from plnerf.line.ends import Attached
from plnerf.line.line import Line, Structure
from plnerf.line.stations import Stretch, azimuth_deg, chains
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.report.colours import CLASSES, DASHED, KINDS, MARK
from plnerf.report.coverage_view import GREY, any_not_seen, corridors
from plnerf.report.figures import Units, degrees
from plnerf.report.plan_encroachments import about_marks, encroachment_marks
from plnerf.report.profile import LEAST_WIDTH, Drawing
from plnerf.report.shown import shown, shows_world
from plnerf.report.side import ticks
from plnerf.report.words import length_of

WIDTH, MOST_HEIGHT, LEAST_HEIGHT = 1100.0, 560.0, 150.0
"""Width of the drawing, and bounds on its height, in pixels."""
MARGIN = 88
"""Pixels around the drawing, in which a structure at a line's end has its number and its angle."""
LETTER_PX = 6.6
"""Mean width of a letter."""


@dataclass(frozen=True, eq=False)
class _Paper:
    """Shown coordinates to pixels."""

    turn: Float[np.ndarray, "2 2"]
    """Shown coordinates to axes to the right and upwards."""
    middle: Float[np.ndarray, "2"]
    """Of the drawing, in these axes."""
    per_unit: float
    width: float
    height: float

    def at(self, points: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n 2"]:
        """Pixels of points."""
        x, y = ((points[:, :2] @ self.turn.T - self.middle) * self.per_unit).T
        return np.stack([self.width / 2 + x, self.height / 2 - y], 1)


def plan(survey: Survey) -> Drawing | None:
    """All lines from above; None without wires."""
    if not survey.wires:
        return None
    frame, units = survey.frame, Units(survey.frame.unit)
    curves = [shown(frame, wire.points(np.linspace(0.0, wire.base.length_m, 41))) for wire in survey.wires]
    feet = [shown(frame, one.foot[None]) for one in survey.structures]
    bases = [
        one.base for line in survey.lines[:1] for one in (each for chain in chains(line) for each in chain)
    ]
    across = shown(frame, np.array([[*bases[0].a, 0.0], [*bases[-1].b, 0.0]]))
    paper = _paper(np.concatenate([*curves, *feet])[:, :2], across[1, :2] - across[0, :2])
    crossings = survey.clearances.crossings if survey.clearances is not None else ()
    crosses = [paper.at(shown(frame, one.on_upper[None]))[0] for one in crossings]
    parts = [*_not_seen(paper, survey), *encroachment_marks(survey, paper.at)]
    parts += [_wire(paper, wire, curve) for wire, curve in zip(survey.wires, curves, strict=True)]
    several, stretches, taken = len(survey.lines) > 1, [], [*crosses]
    for line in survey.lines:
        for one in (one for chain in chains(line) for one in chain):
            stretches.append((line.id, one))
            name = f"{line.id} / {one.span.id}" if several else f"span {one.span.id}"
            parts.append(_span(paper, survey, one, name, taken))
    for wire, curve in zip(survey.wires, curves, strict=True):
        parts += _open_ends(paper, wire, curve)
    for line in survey.lines:
        held = [one for id_, one in stretches if id_ == line.id]
        parts += [_structure(paper, survey, line, one, held) for one in line.structures]
    parts += [_cross(at) for at in crosses]
    parts += _scale_bar(paper, units)
    north = shows_world(frame) and frame.crs is not None
    parts += _arrow(paper, "N" if north else "y")
    size = f'style="max-width:{paper.width:.0f}px;min-width:{min(paper.width, LEAST_WIDTH):.0f}px"'
    svg = (
        f'<svg viewBox="0 0 {paper.width:.0f} {paper.height:.0f}" role="img" '
        f'aria-label="The lines from above" font-size="12" {size}>{"".join(parts)}</svg>'
    )
    return Drawing("Plan", svg, _about(survey, north=north, several=several, crossed=bool(crossings)), ())


def _about(survey: Survey, *, north: bool, several: bool, crossed: bool) -> str:
    is_open = any(wire.open for wire in survey.wires)
    kinds = {one.kind for one in survey.structures}
    turns = any((one.line_angle_deg or 0.0) >= LEAST_TURN_DEG for one in survey.structures)
    return (
        f"The arrow points {'north' if north else 'along the y axis'}. "
        + ("Line and span" if several else "Spans")
        + ", each with its length, unless an end of it is open, and with its direction, clockwise from "
        + f"{'north' if north else 'the y axis'}. "
        + "Squares are strain and terminal structures, circles all others" * bool(kinds & SQUARE)
        + "Circles are structures" * (not kinds & SQUARE)
        + "; beside their numbers, by how much the line turns there" * turns
        + "; rings: open ends" * is_open
        + "; crosses: where wires of two lines cross" * crossed
        + "; grey: stretches of which too little ground or air was seen, darker where of both"
        * any_not_seen(survey)
        + about_marks(survey)
        + "."
    )


LEAST_TURN_DEG = 0.05
"""Bends that are not 0.0 when they are written."""
STRAIGHT = 0.2
"""Two unit vectors that lead out of a line's spans add up to less where it goes nearly straight on."""
SQUARE = {"strain", "terminal"}
"""Kinds of structures that are drawn as squares: they take the wires' tension."""


def _paper(points: Float[np.ndarray, "n 2"], along: Float[np.ndarray, "2"]) -> _Paper:
    """As large as fits, turned so that a direction leads to the right."""
    u = along / max(float(np.linalg.norm(along)), 1e-9) if along.any() else np.array([1.0, 0.0])
    turn = np.array([[u[0], u[1]], [-u[1], u[0]]])
    points = points @ turn.T
    low, high = points.min(0), points.max(0)
    wide, tall = np.maximum(high - low, 1e-6).tolist()
    per_unit = min((WIDTH - 2 * MARGIN) / wide, (MOST_HEIGHT - 2 * MARGIN) / tall)
    return _Paper(turn, (low + high) / 2, per_unit, WIDTH, max(LEAST_HEIGHT, tall * per_unit + 2 * MARGIN))


def _not_seen(paper: _Paper, survey: Survey) -> list[str]:
    """Grey corridors of the stretches that were not seen."""
    return [
        f'<polygon points="{_path(paper.at(shown(survey.frame, corners)))}" fill="{GREY}" '
        f'fill-opacity="{opacity}"/>'
        for line in survey.lines
        for chain in chains(line)
        for stretch in chain
        for opacity, corners in corridors(survey, stretch, line.id)
    ]


def _wire(paper: _Paper, wire: Wire, curve: Float[np.ndarray, "k 3"]) -> str:
    dashes = ' stroke-dasharray="7 3"' if wire.kind in DASHED else ""
    return (
        f'<polyline points="{_path(paper.at(curve))}" fill="none" stroke="{KINDS[wire.kind][1]}" '
        f'stroke-width="1.3"{dashes}><title>wire {wire.id}, {wire.kind}</title></polyline>'
    )


def _span(paper: _Paper, survey: Survey, one: Stretch, name: str, taken: list[Float[np.ndarray, "2"]]) -> str:
    """Its name, length and direction, along it and beside all of its wires, where no other text is.

    taken: middles of what is drawn already; that of the text is appended.
    """
    units = Units(survey.frame.unit)
    ends = np.array([[*one.base.a, 0.0], [*one.base.b, 0.0]])
    a, b = paper.at(shown(survey.frame, ends))
    along = float(np.hypot(*(b - a)))
    azimuth = degrees(azimuth_deg(survey.frame, one.base), 1)
    number = name.removeprefix("span ")
    texts = [
        f"{name}: {length_of(one, units)}, {azimuth}",
        f"{number}: {length_of(one, units, 0)}, {degrees(azimuth_deg(survey.frame, one.base), 0)}",
        name,
        number,
    ]
    text = next((text for text in texts if LETTER_PX * len(text) + 20 < along), texts[-1])
    angle = math.degrees(math.atan2(b[1] - a[1], b[0] - a[0]))
    angle = (angle + 90) % 180 - 90  # to be read from below or from the right
    up = np.array([math.sin(math.radians(angle)), -math.cos(math.radians(angle))])
    room = max(0.0, 1 - (LETTER_PX * len(text) + 20) / along) / 2
    places = [a + (0.5 + k * room) * (b - a) + _aside(paper, one) * up for k in (0, -0.5, 0.5, -1, 1)]
    x, y = best = max(places, key=lambda at: min(_clear(at, taken), LETTER_PX * len(text)))
    taken.append(best)
    return (
        f'<text transform="translate({x:.1f} {y:.1f}) rotate({angle:.1f})" text-anchor="middle" '
        f'class="halo">{text}</text>'
    )


def _clear(at: Float[np.ndarray, "2"], taken: Sequence[Float[np.ndarray, "2"]]) -> float:
    """Pixels to the nearest of some places."""
    return float(np.linalg.norm(np.array(taken) - at, axis=1).min()) if taken else math.inf


def _aside(paper: _Paper, one: Stretch) -> float:
    """Pixels from a span's axis to beside all of its wires."""
    points = np.concatenate([wire.points(np.linspace(0, wire.base.length_m, 9)) for wire in one.span.wires])
    return float(np.abs(one.base.local(points)[:, 1]).max()) * paper.per_unit + 7


def _structure(paper: _Paper, survey: Survey, line: Line, one: Structure, spans: Sequence[Stretch]) -> str:
    """Its mark, and its number and by how much the line turns: outside of the bend, beyond a line's end."""
    x, y = at = paper.at(shown(survey.frame, one.foot[None]))[0]
    colour, title = CLASSES[TOWER][1], f"structure {one.id} of line {line.id}, {one.kind}"
    tag, where = (
        ("rect", f'x="{x - 5:.1f}" y="{y - 5:.1f}" width="10" height="10"')
        if one.kind in SQUARE
        else ("circle", f'cx="{x:.1f}" cy="{y:.1f}" r="5"')
    )
    angle = one.line_angle_deg
    turns = f" ({degrees(angle, 1)})" if angle is not None and angle >= LEAST_TURN_DEG else ""
    held = [each for each in spans if one.id in each.held]
    out, far = np.zeros(2), 18.0
    for each in held:
        middle = np.array([[*(each.base.a + each.base.b) / 2, 0.0]])
        off = at - paper.at(shown(survey.frame, middle))[0]
        out += off / max(float(np.linalg.norm(off)), 1e-9)
    if len(held) > 1:
        far = max(far, 12 + max(_aside(paper, each) for each in held))
    if np.linalg.norm(out) < STRAIGHT and held:  # the line goes on: below it
        u = paper.at(shown(survey.frame, np.array([[*held[0].base.a, 0.0], [*held[0].base.b, 0.0]])))
        out = np.array([u[0, 1] - u[1, 1], u[1, 0] - u[0, 0]]) * (1 if u[1, 0] >= u[0, 0] else -1)
    dx, dy = far * out / max(float(np.linalg.norm(out)), 1e-9)
    anchor = "start" if dx > 8 else "end" if dx < -8 else "middle"
    return (
        f'<{tag} {where} fill="white" stroke="{colour}" stroke-width="2"><title>{title}</title></{tag}>'
        f'<text x="{x + dx:.1f}" y="{y + dy:.1f}" dy="4" text-anchor="{anchor}" class="halo" '
        f'font-weight="700">{one.id}{turns}</text>'
    )


def _open_ends(paper: _Paper, wire: Wire, curve: Float[np.ndarray, "k 3"]) -> list[str]:
    """A ring at each end that nothing holds."""
    ends = zip(wire.ends, paper.at(curve[[0, -1]]), strict=True)
    return [
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.4" fill="white" stroke="{KINDS[wire.kind][1]}" '
        f'stroke-width="1.4"/>'
        for end, (x, y) in ends
        if not isinstance(end, Attached)
    ]


def _cross(at: Float[np.ndarray, "2"]) -> str:
    x, y = at
    return (
        f'<path d="M{x - 3.5:.1f},{y - 3.5:.1f} l7,7 m0,-7 l-7,7" stroke="{MARK}" stroke-width="1.6" '
        'fill="none"/>'
    )


def _scale_bar(paper: _Paper, units: Units) -> list[str]:
    """A round length at the lower left."""
    length = float(ticks(0.0, 260 / paper.per_unit, 2.0)[1])
    y, end = paper.height - 18, 18 + length * paper.per_unit
    bar = f"M18,{y - 4:.1f} v8 M18,{y:.1f} H{end:.1f} M{end:.1f},{y - 4:.1f} v8"
    text = f"{length:g} {units.short}"
    return [
        f'<path d="{bar}" class="axis" fill="none"/>',
        f'<text x="{(18 + end) / 2:.1f}" y="{y - 6:.1f}" text-anchor="middle">{text}</text>',
    ]


def _arrow(paper: _Paper, name: str) -> list[str]:
    """Along the y axis of shown coordinates, at the upper right."""
    x, y, (dx, dy) = paper.width - 36, 36, paper.turn @ [0.0, 1.0]
    angle = math.degrees(math.atan2(dx, dy))
    return [
        f'<path transform="translate({x:.0f} {y:.0f}) rotate({angle:.1f})" d="M0,14 V-14 m-5,9 l5,-9 l5,9" '
        'class="axis" stroke-width="1.6" fill="none"/>',
        f'<text x="{x + 24 * dx:.1f}" y="{y - 24 * dy:.1f}" dy="4" text-anchor="middle" font-weight="700">'
        f"{name}</text>",
    ]


def _path(points: Float[np.ndarray, "k 2"]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
