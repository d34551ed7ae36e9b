"""The view of a survey in space that a reader can turn: what is drawn, as numbers inside of the page.

Points are thinned evenly and rounded to 16 bits of the box around them (1.5 cm in a kilometre); everything is
counted from the middle of the wires, so that the browser's arithmetic stays fine far from the origin.  The
drawing itself is `data/report/view.js`, a parallel projection.
"""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from plnerf.line.cloud import TOWER, Cloud
from plnerf.line.line import Structure
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.report.colours import CLASSES, DASHED, KINDS, MARK, OTHER
from plnerf.report.figures import Units, counted, listed
from plnerf.report.nearest import Nearest, worst
from plnerf.report.shown import shown, shows_world

MOST_POINTS = 60_000
AROUND = 0.5
"""Points farther from the wires, horizontally, than this share of the longest wire are not drawn."""
WIRE_VERTICES = 49
GRID_STEPS = 65_535
_FIRST_THIN = 8
"""Of more points than so many times MOST_POINTS about as many are drawn by lot, before the even thinning."""


@dataclass(frozen=True)
class ClassEntry:
    """A class in the legend, whose points can be hidden."""

    number: int
    """Of its colour in the drawing's data."""
    colour: str
    text: str


@dataclass(frozen=True)
class LineEntry:
    """What the legend says of a drawn line."""

    colour: str
    dashed: bool
    text: str


@dataclass(frozen=True)
class View:
    """The drawing's data, its legend, and a sentence about it."""

    data: dict[str, Any]
    classes: list[ClassEntry]
    lines: list[LineEntry]
    about: str


def view(survey: Survey, rows: list[Nearest]) -> View | None:
    """The drawing of a survey and its least clearances; None where there is nothing to draw."""
    data = scene(survey, rows)
    if not data["count"] and not data["wires"]:
        return None
    drawn, total = data["count"], len(survey.cloud.xyz)
    parts = [
        counted(total, "point") if drawn == total else f"{drawn:,} of {total:,} points, thinned evenly",
        *["the fitted wires with their numbers"] * bool(data["wires"]),
        *["structures"] * bool(data["structures"]),
        *["the worst clearance to each group"] * bool(data["marks"]),
    ]
    about = (
        f"Drawn are {listed(parts)}; in brackets: points of the cloud. Parallel projection. Drag to turn, "
        "Shift and drag or two fingers to move, pinch, + and - or (after a click) the wheel to zoom."
    )
    return View(data, _classes(survey), _lines(survey, rows), about)


def scene(survey: Survey, rows: list[Nearest]) -> dict[str, Any]:
    """What `view.js` draws, as plain values; points as base64 of little-endian numbers."""
    frame, units = survey.frame, Units(survey.frame.unit)
    places, reach = anchors(survey, rows)
    kept, edge = thinned(survey.cloud, places, reach)
    at = shown(frame, places)
    low, high = at.min(0), at.max(0)
    middle = (low + high) / 2
    xyz = shown(frame, survey.cloud.xyz[kept])
    corner = xyz.min(0) if len(xyz) else low
    step = np.maximum(np.ptp(xyz, axis=0) if len(xyz) else high - low, 1e-9) / GRID_STEPS
    order = {code: k for k, code in enumerate(CLASSES)}
    label = np.array([order.get(int(code), len(CLASSES)) for code in range(256)], np.uint8)
    curves = [shown(frame, _curve(wire)) for wire in survey.wires]
    first = _along(curves) if curves else high - low
    return {
        "unit": units.short,
        "axes": ["E", "N", "up"] if shows_world(frame) and frame.crs else ["x", "y", "z"],
        "low": _plain(low - middle),
        "high": _plain(high - middle),
        "azimuth": round(float(np.arctan2(first[1], first[0])), 4),
        "count": len(xyz),
        "edge": edge,
        "corner": (corner - middle).tolist(),
        "step": step.tolist(),
        "xyz": _base64(np.round((xyz - corner) / step).astype("<u2")),
        "label": _base64(label[survey.cloud.label[kept]]),
        "colours": [colour for _, colour in (*CLASSES.values(), OTHER)],
        "wires": [
            {
                "id": str(wire.id),
                "colour": KINDS[wire.kind][1],
                "dashed": wire.kind in DASHED,
                "points": _plain(curve - middle),
            }
            for wire, curve in zip(survey.wires, curves, strict=True)
        ],
        "structures": [
            {"id": str(one.id), "points": _plain(shown(frame, _mast(one)) - middle)}
            for one in survey.structures
        ],
        "structure_colour": CLASSES[TOWER][1],
        "marks": [
            {
                "points": _plain(shown(frame, _gap(one)) - middle),
                "text": f"{one.to} {one.sign}{units.interval_with_unit(one.distance)}",
            }
            for one in worst(rows)
        ],
        "mark_colour": MARK,
    }


def anchors(survey: Survey, rows: list[Nearest]) -> tuple[Float[np.ndarray, "h 3"], float]:
    """Points on wires, structures and worst clearances, and how far around them the cloud is drawn.

    All in the LineFrame.  Where there are none, the corners of a box that holds nearly all points.
    """
    found = [_curve(wire) for wire in survey.wires]
    found += [_mast(one) for one in survey.structures]
    found += [_gap(one) for one in worst(rows)]
    if not found and len(survey.cloud.xyz):  # a few points far off do not make the drawing small
        found = [np.percentile(survey.cloud.xyz, [0.5, 99.5], axis=0)]
    points = np.concatenate(found) if found else np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    if survey.wires:
        return points, AROUND * max(wire.base.length_m for wire in survey.wires)
    return points, float(np.linalg.norm(np.ptp(points, axis=0)))


def thinned(
    cloud: Cloud, places: Float[np.ndarray, "h 3"], reach: float
) -> tuple[Int[np.ndarray, " k"], float]:
    """At most MOST_POINTS of the points around some places, one in each cube, and the cubes' edge.

    Each class has cubes of its own, so that a thin thing in front of a large one stays.
    """
    low, high = places.min(0) - reach, places.max(0) + reach
    kept = np.flatnonzero(((cloud.xyz >= low) & (cloud.xyz <= high)).all(1))
    if len(kept) > _FIRST_THIN * MOST_POINTS:
        kept = kept[np.random.default_rng(0).random(len(kept)) < _FIRST_THIN * MOST_POINTS / len(kept)]
    apart, _ = cKDTree(places[:, :2]).query(cloud.xyz[kept, :2], distance_upper_bound=reach)
    kept = kept[np.isfinite(apart)]
    # As if all lay on one sheet; more than that in the air takes larger cubes.
    edge = float(np.sqrt(np.prod(np.sort(high - low)[1:]) / MOST_POINTS)) / 4
    if len(kept) <= MOST_POINTS:
        return kept, 2 * edge
    while True:
        cube = np.floor((cloud.xyz[kept] - low) / edge).astype(np.int64)
        (_, b, c), label = cube.max(0) + 1, cloud.label[kept].astype(np.int64)
        number = ((cube[:, 0] * b + cube[:, 1]) * c + cube[:, 2]) * 256 + label
        _, some = np.unique(number, return_index=True)
        if len(some) <= MOST_POINTS:
            return kept[np.sort(some)], edge
        edge *= 1.2


def _curve(wire: Wire) -> Float[np.ndarray, "k 3"]:
    return wire.points(np.linspace(0.0, wire.base.length_m, WIRE_VERTICES))


def _along(curves: Sequence[Float[np.ndarray, "_ 3"]]) -> Float[np.ndarray, "2"]:
    """The horizontal direction in which most of the wires' length runs."""
    chords = np.array([curve[-1, :2] - curve[0, :2] for curve in curves])
    along: Float[np.ndarray, 2] = np.linalg.svd(chords, full_matrices=False)[2][0]
    return along if along @ chords[0] > 0 else -along


def _mast(one: Structure) -> Float[np.ndarray, "2 3"]:
    """From foot to top."""
    return np.stack([one.foot, one.top])


def _gap(one: Nearest) -> Float[np.ndarray, "2 3"]:
    """From the wire to the obstacle."""
    return np.stack([one.place.on_wire, one.place.on_obstacle])


def _classes(survey: Survey) -> list[ClassEntry]:
    """An entry for each class that has points."""
    entries = []
    counts = np.bincount(survey.cloud.label, minlength=256)
    for k, (code, (name, colour)) in enumerate([*CLASSES.items(), (None, OTHER)]):
        count = int(counts[code] if code is not None else counts.sum() - counts[list(CLASSES)].sum())
        if count:
            entries.append(ClassEntry(k, colour, f"{name} ({count:,})"))
    return entries


def _lines(survey: Survey, rows: list[Nearest]) -> list[LineEntry]:
    kinds = {wire.kind for wire in survey.wires}
    entries = [
        LineEntry(colour, kind in DASHED, f"fitted {name}")
        for kind, (name, colour) in KINDS.items()
        if kind in kinds
    ]
    return entries + [LineEntry(MARK, False, "worst clearance to each group")] * bool(rows)


def _plain(values: np.ndarray) -> Any:
    """Lists of numbers with seven significant digits of the largest."""
    digits = 6 - int(np.floor(np.log10(max(float(np.abs(values).max(initial=0.0)), 1e-12))))
    return np.round(values, digits).tolist()


def _base64(values: np.ndarray) -> str:
    return base64.b64encode(values.tobytes()).decode()
