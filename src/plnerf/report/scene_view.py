"""The view of a survey in space that a reader can turn: what is drawn, as numbers inside of the page.

Points are thinned evenly and rounded to 16 bits of the box around them (1.5 cm in a kilometre); everything is
counted from the middle of the wires, so that the browser's arithmetic stays fine far from the origin.  The
drawing itself is `data/report/view.js`, a parallel projection.
"""

import base64
import json
from importlib.resources import files
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from plnerf.report.colours import CLASSES, KINDS, MARK, OTHER
from plnerf.report.data import Report
from plnerf.report.markup import Markup, joined, tag
from plnerf.report.words import counted, listed, units_of
from plnerf.survey.model import TOWER, Cloud, Tower

MOST_POINTS = 60_000
AROUND = 0.5
"""Points farther from the wires, horizontally, than this share of the longest span are not drawn."""
WIRE_VERTICES = 49
GRID_STEPS = 65_535
_FIRST_THIN = 8
"""Of more points than so many times MOST_POINTS about as many are drawn by lot, before the even thinning."""


def view(report: Report) -> Markup:
    """The drawing, its buttons, and a legend that hides and shows classes."""
    data = scene(report)
    if not data["count"] and not data["wires"]:
        return tag("p", "There are neither points nor conductors to draw.", class_="empty")
    canvas = tag("canvas", id="view", tabindex="0", role="img", aria_label="The survey in space")
    names = ("oblique", "side", "top", "along")
    buttons = [tag("button", name, type="button", data_view=name) for name in names]
    drawn, total = data["count"], len(report.survey.cloud.xyz)
    share = counted(total, "point") if drawn == total else f"{drawn:,} of {total:,} points, thinned evenly"
    parts = [
        share,
        *["the fitted conductors with their ids"] * bool(data["wires"]),
        *["towers"] * bool(data["towers"]),
        *["the worst clearance to each class"] * bool(data["marks"]),
    ]
    told = (
        f"Drawn are {listed(parts)}; in brackets: points of the cloud. Parallel projection. Drag to turn, "
        "Shift and drag or two fingers to move, pinch, + and - or (after a click) the wheel to zoom."
    )
    # "<" could end the script: JSON may write it as an escape.
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    code = files("plnerf").joinpath("data/report/view.js").read_text(encoding="utf-8")
    return joined([
        tag("div", tag("div", *buttons, class_="buttons"), canvas, class_="view"),
        _legend(report),
        tag("p", told, class_="about"),
        tag("noscript", "This drawing needs JavaScript, which the page brings along."),
        Markup(f'<script type="application/json" id="view-data">{text}</script>'),
        Markup(f"<script>{code}</script>"),
    ])


def scene(report: Report) -> dict[str, Any]:
    """What `view.js` draws, as plain values; points as base64 of little-endian numbers."""
    survey = report.survey
    places, reach = held(report)
    low, high = places.min(0), places.max(0)
    middle = (low + high) / 2
    kept, edge = thinned(survey.cloud, places, reach)
    xyz = survey.cloud.xyz[kept]
    corner = xyz.min(0) if len(xyz) else low
    step = np.maximum(np.ptp(xyz, axis=0) if len(xyz) else high - low, 1e-9) / GRID_STEPS
    order = {code: k for k, code in enumerate(CLASSES)}
    label = np.array([order.get(int(code), len(CLASSES)) for code in range(256)], np.uint8)
    curves = [one.fit.curve for one in survey.conductors]
    first = np.subtract(curves[0].b, curves[0].a) if curves else high - low
    return {
        "unit": units_of(survey).short,
        "axes": ["E", "N", "up"] if survey.crs else ["x", "y", "z"],
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
                "id": str(one.id),
                "colour": KINDS[one.kind],
                "dashed": one.kind == "shield",
                "points": _plain(curve.points(np.linspace(0, curve.span_m, WIRE_VERTICES)) - middle),
            }
            for one, curve in zip(survey.conductors, curves, strict=True)
        ],
        "towers": [_plain(_mast(one) - middle) for one in survey.towers],
        "tower_colour": CLASSES[TOWER][1],
        "marks": [
            {
                "points": _plain(np.array([one.on_wire, one.on_obstacle]) - middle),
                "text": f"{one.to} {units_of(survey).with_unit(one.distance_m)}",
            }
            for one in report.worst()
        ],
        "mark_colour": MARK,
    }


def held(report: Report) -> tuple[Float[np.ndarray, "h 3"], float]:
    """Places on wires, towers and worst clearances, and how far around them points of the cloud are drawn.

    Where there are none, the corners of a box that holds nearly all points.
    """
    survey = report.survey
    curves = [one.fit.curve for one in survey.conductors]
    places = [curve.points(np.linspace(0, curve.span_m, WIRE_VERTICES)) for curve in curves]
    places += [_mast(one) for one in survey.towers]
    places += [np.array([one.on_wire, one.on_obstacle]) for one in report.worst()]
    if not places and len(survey.cloud.xyz):  # a few points far off do not make the drawing small
        places = [np.percentile(survey.cloud.xyz, [0.5, 99.5], axis=0)]
    found = np.concatenate(places) if places else np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    if curves:
        return found, AROUND * max(curve.span_m for curve in curves)
    return found, float(np.linalg.norm(np.ptp(found, axis=0)))


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


def _mast(one: Tower) -> Float[np.ndarray, "2 3"]:
    """From foot to top."""
    return one.foot + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, one.height_m]])


def _legend(report: Report) -> Markup:
    """A box to tick for each class that has points, and what the lines mean."""
    entries = []
    counts = np.bincount(report.survey.cloud.label, minlength=256)
    for k, (code, (name, colour)) in enumerate([*CLASSES.items(), (None, OTHER)]):
        count = int(counts[code] if code is not None else counts.sum() - counts[list(CLASSES)].sum())
        if count:
            ticked = Markup(f'<input type="checkbox" checked data-class="{k}">')
            entries.append(tag("label", ticked, _swatch(colour), f"{name} ({count:,})"))
    entries += [
        tag("span", tag("i", class_=f"line {kind}"), f"fitted {name}")
        for kind, name in (("phase", "conductor"), ("shield", "shield wire"))
        if any(one.kind == kind for one in report.survey.conductors)
    ]
    if report.clearances:
        entries.append(tag("span", tag("i", class_="line mark"), "worst clearance to each class"))
    return tag("div", *entries, class_="legend")


def _swatch(colour: str) -> Markup:
    return tag("i", class_="swatch", style=f"background:{colour}")


def _plain(values: np.ndarray) -> Any:
    """Lists of numbers with seven significant digits of the largest."""
    digits = 6 - int(np.floor(np.log10(max(float(np.abs(values).max(initial=0.0)), 1e-12))))
    return np.round(values, digits).tolist()


def _base64(values: np.ndarray) -> str:
    return base64.b64encode(values.tobytes()).decode()
