"""Surveys of lines of several spans that run anywhere: bends, an open end, wind, a line that crosses."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from plnerf.line.base import Base
from plnerf.line.cloud import CONDUCTOR, GROUND, HIGH_VEGETATION, SHIELD, TOWER, Cloud
from plnerf.line.ends import Attached, End, Evidence, Open
from plnerf.line.frame import LineFrame
from plnerf.line.hang import hang
from plnerf.line.line import Line, Span, Structure
from plnerf.line.survey import Survey
from plnerf.line.wire import Kind, Wire
from plnerf.survey.clearance import measure_clearances
from plnerf.survey.config_ground import ClearanceConfig

DEVIATIONS = np.array([0.02, 0.02, 0.015, 0.015, 0.01, np.radians(0.1)])
"""Of theta."""
NOT_FILMED = Open("not filmed")
PHASES: tuple[tuple[float, float, Kind], ...] = (
    (-5.0, 18.0, "phase"), (0.0, 18.3, "phase"), (5.0, 18.0, "phase"), (0.0, 24.0, "shield"),
)  # fmt: skip
"""y, height above the foot and kind of a line's wires."""
LOW: tuple[tuple[float, float, Kind], ...] = (
    (-1.2, 12.0, "phase"),
    (1.2, 12.0, "phase"),
    (0.0, 12.6, "phase"),
)
FRAME = LineFrame(
    np.array([[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]]), 1.0, np.array([40.0, -7.5, 101.25]), "m",
    "EPSG:25832", np.array([8.1234567, 49.7654321, 212.4]), scene_per_unit=0.05,
)  # fmt: skip


def line_along(
    feet: Sequence[tuple[float, float]],
    wires: Sequence[tuple[float, float, Kind]],
    *,
    after: Line | None = None,
    sag_share: float = 0.03,
    open_end: bool = False,
) -> Line:
    """A line from foot to foot on ground of height 0, whose arms halve its bends.

    after: the line whose numbers it continues.  open_end: nothing is seen of what holds its last end.
    """
    id, first, number, span = (1, 1, 1, 1) if after is None else (
        after.id + 1, len(after.structures) + 1, sum(1 for _ in after.wires) + 1, len(after.spans) + 1
    )  # fmt: skip
    at = np.array(feet)
    u = np.diff(at, axis=0) / np.linalg.norm(np.diff(at, axis=0), axis=1)[:, None]
    arms = np.array([u[0], *(a + b for a, b in pairwise(u)), u[-1]])
    arms = np.stack([-arms[:, 1], arms[:, 0]], 1) / np.linalg.norm(arms, axis=1)[:, None]
    angle = np.degrees(np.unwrap(np.arctan2(u[:, 1], u[:, 0])))
    bends = [None, *np.abs(np.diff(angle)), None]
    top = max(height for _, height, _ in wires)
    kinds = ["terminal", *("strain" if bend > 3 else "suspension" for bend in bends[1:-1]), "terminal"]
    structures = [
        Structure(
            first + k, np.array([*at[k], 0.0]), top + 2.0, 0.05, "kinks of 4 wires", kinds[k], None, bends[k]
        )
        for k in range(len(at))
    ]
    spans = []
    for k in range(len(u)):
        length, hung = float(np.linalg.norm(at[k + 1] - at[k])), []
        for y, height, kind in wires:
            a, b = (np.array([*(at[j] + y * arms[j]), height]) for j in (k, k + 1))
            sag = sag_share * length * (0.8 if kind == "shield" else 1.0)
            ends: tuple[End, End] = Attached(first + k, a, 0.05), Attached(first + k + 1, b, 0.05)
            wire = hang(a, b, sag, id=number, kind=kind, ends=ends)
            seen = Evidence("24 images", 24, 0.96, 3.0, 0.012, 0.009)
            hung.append(replace(wire, covariance=np.diag(np.append(DEVIATIONS[:5], 0) ** 2), evidence=seen))
            number += 1
        spans.append(Span(span + k, (first + k, first + k + 1), tuple(hung)))
    if open_end:
        last = spans[-1]
        cut = tuple(
            replace(wire.between(0.0, 0.7 * wire.base.length_m), ends=(wire.ends[0], NOT_FILMED))
            for wire in last.wires
        )
        spans[-1] = replace(last, structures=(last.structures[0], None), wires=cut)
        structures.pop()
    return Line(id, tuple(structures), tuple(spans))


def swung(wire: Wire, degrees: float) -> Wire:
    """Blown aside by so much between its ends, and as uncertain as wind is."""
    theta = wire.theta.copy()
    theta[5] = np.radians(degrees)
    return replace(wire, theta=theta, covariance=np.diag(DEVIATIONS**2))


def blown(line: Line, span: int, degrees: float) -> Line:
    """The line with the wires of one span in the wind."""
    spans = list(line.spans)
    spans[span] = replace(spans[span], wires=tuple(swung(wire, degrees) for wire in spans[span].wires))
    return replace(line, spans=tuple(spans))


def lines_of(survey: Survey, *lines: Line) -> Survey:
    """The survey with other lines, and their clearances."""
    survey = replace(survey, lines=lines, clearances=None, findings=())
    found, findings = measure_clearances(survey, ClearanceConfig(clearance_m=5.0))
    return replace(survey, clearances=found, findings=findings)


def over_ground(
    *lines: Line, trees: Sequence[tuple[float, float, float]] = (), wide_m: float = 25.0
) -> Survey:
    """A survey of lines over ground of height 0 with trees (x, y, height), as a laser sees it."""
    random, points, labels, owners = np.random.default_rng(1), [], [], []

    def add(xyz: np.ndarray, label: int, wire: int = 0) -> None:
        points.append(xyz)
        labels.append(np.full(len(xyz), label, np.uint8))
        owners.append(np.full(len(xyz), wire))

    for line in lines:
        for structure in line.structures:
            share = random.random(300)[:, None]
            add(structure.foot + share * [0, 0, structure.height_m], TOWER)
        for span in line.spans:
            base: Base = span.wires[0].base
            s, y = random.uniform(-10, base.length_m + 10, 4000), random.uniform(-wide_m, wide_m, 4000)
            add(base.place(s, np.stack([y, 0 * y], 1)), GROUND)
            for wire in span.wires:
                on = wire.points(np.linspace(0, wire.base.length_m, int(wire.base.length_m)))
                add(on, SHIELD if wire.kind == "shield" else CONDUCTOR, wire.id)
    for x, y, height in trees:
        add([x, y, 0.7 * height] + random.normal(size=(400, 3)) * [1.2, 1.2, 0.1 * height], HIGH_VEGETATION)
    cloud = Cloud(np.concatenate(points), np.concatenate(labels), np.concatenate(owners).astype(np.int64))
    bare = Survey(
        FRAME, lines, cloud, "/data/lines/bent", made={"program": "plnerf 0.1.0"}, temperature_c=18.0
    )
    return lines_of(bare, *lines)


FEET = ((0.0, 0.0), (70.0, -40.0), (150.0, -85.0), (225.0, -88.0))
"""Spans of 80.6, 91.8 and 75.1 m; a bend of hardly 1 degree and one of 27."""


def bent() -> Survey:
    """Three spans askew, the second in the wind and the last one filmed in part; a low line crosses the
    second."""
    main = blown(line_along(FEET, PHASES, open_end=True), 1, 6.0)
    low = line_along(((95.0, -115.0), (125.0, -5.0)), LOW, after=main)
    trees = [(30.0, -12.0, 9.0), (100.0, -50.0, 12.0), (170.0, -90.0, 14.0), (152.0, -95.0, 10.0)]
    return over_ground(main, low, trees=trees)


def eight() -> Survey:
    """Eight spans of one line with two bends."""
    turn = np.cumsum(np.radians([17.0, 0.0, 0.0, 24.0, 0.0, 1.0, -38.0, 0.0]))
    steps = np.array([240.0, 310.0, 280.0, 295.0, 330.0, 260.0, 305.0, 275.0])
    at = np.cumsum(np.stack([steps * np.cos(turn), steps * np.sin(turn)], 1), axis=0)
    feet = [(0.0, 0.0), *((float(x), float(y)) for x, y in at)]
    trees = [(float(x) - 60, float(y) + 4 * k, 8.0 + k) for k, (x, y) in enumerate(at)]
    return over_ground(line_along(feet, PHASES), trees=trees, wide_m=40.0)
