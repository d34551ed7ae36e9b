"""Surveys for tests of reports and exports: known wires over ground with relief, structures and trees."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
from scipy.spatial import cKDTree

from plnerf.findings import note
from plnerf.line.clearances import GROUPS, Clearances, Group, Place, Profile, Requirement, WireClearance
from plnerf.line.cloud import (
    CONDUCTOR,
    CONNECTOR,
    GROUND,
    HIGH_VEGETATION,
    LOW_VEGETATION,
    SHIELD,
    TOWER,
    VEGETATION,
    Cloud,
)
from plnerf.line.coverage import Coverage
from plnerf.line.ends import Attached, Evidence, Open
from plnerf.line.frame import LineFrame
from plnerf.line.hang import hang
from plnerf.line.line import Line, Span, Structure
from plnerf.line.survey import Picture, Survey
from plnerf.line.wire import Kind, Wire

REQUIRED_M = 5.0
SIGMA = np.array([0.02, 0.02, 0.015, 0.015, 0.01, 0.0])
"""Standard deviations of theta."""
GROUP: dict[int, Group] = {
    GROUND: "ground",
    **dict.fromkeys((LOW_VEGETATION, VEGETATION, HIGH_VEGETATION), "vegetation"),
}  # type: ignore[assignment]
FILES = ("cloud.laz", "conductors.geojson", "conductors.csv", "clearances.csv")
Ends = tuple[tuple[float, float, float], tuple[float, float, float], float]
"""First end, last end, sag."""


def ground(xy: np.ndarray, relief_m: float) -> np.ndarray:
    """Height of the ground."""
    return relief_m * (np.sin(xy[:, 0] / 31) + 0.5 * np.cos(xy[:, 1] / 17 + xy[:, 0] / 60))


def turned(degrees: float) -> np.ndarray:
    """A rotation about z."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


FRAME = LineFrame(
    turned(-24.0), 1.0, np.array([12.0, -7.5, 101.25]), "m", "EPSG:25832",
    np.array([8.1234567, 49.7654321, 212.4]), scene_per_unit=0.05,
)  # fmt: skip
"""Of a scene: neither the world's axes nor its origin."""


def short(density: float = 1.0) -> Survey:
    """Five wires over 40 m, the fifth a shield wire; in local metres of a place on the earth."""
    wires: list[Ends] = [((-20.0, y, z), (20.0, y + 0.4, z + 0.9), sag) for y, z, sag in (
        (-3.1, 10.0, 1.21), (0.0, 10.1, 1.18), (3.1, 10.0, 1.24), (1.5, 12.6, 1.05), (-0.4, 14.9, 0.62)
    )]  # fmt: skip
    structures = [(-20.4, 0.0, 15.3), (20.4, 0.4, 16.1)]
    trees = [(-6.0, 4.5, 6.1, 2.0), (3.0, -9.0, 7.5, 2.6), (9.5, 5.6, 4.2, 1.4), (-13.0, -7.5, 3.1, 1.2)]
    line, cloud = _built([wires], structures, trees, relief_m=0.8, density=density)
    survey = Survey(
        FRAME, (line,), cloud, "/data/runs/span-40m",
        made={"input": "span-40m: 96 images", "preset": "pl-nerf-wire", "program": "plnerf 0.1.0"},
        settings={"refine": {"prior_px": 0.5}},
        findings=(note("scale", "The scale rests on the photos' positions: it is known to 0.4 %."),),
        temperature_c=31.0,
        from_images=True,
    )  # fmt: skip
    return replace(survey, clearances=_clearances(survey), pictures=(photo(5),))


def long(density: float = 1.0) -> Survey:
    """A double circuit over two spans with an angle between them, in coordinates of a national grid."""
    at = np.array([[233_145.2, 582_017.7], [233_441.0, 582_139.5], [233_671.3, 582_300.8]])
    frame = LineFrame.of_cloud(np.column_stack([at, np.zeros(3)]), "EPSG:28992")
    at = frame.from_world(np.column_stack([at, np.zeros(3)]))[:, :2]
    spans: list[list[Ends]] = []
    for k, (a, b) in enumerate(pairwise(at)):
        u = (b - a) / np.linalg.norm(b - a)
        n = np.array([-u[1], u[0]])
        spans.append([
            ((*(a + y * n), z + 2.0 * k), (*(b + y * n), z + 2.0 * (k + 1)), sag + 0.1 * j)
            for j, (y, z, sag) in enumerate(
                (y, z, s - 2.1 * k) for z, s in ((24.0, 9.0), (30.5, 8.8), (37.0, 8.6)) for y in (-7.5, 7.5)
            )
        ])
    structures = [(*place, 46.0 + k) for k, place in enumerate(at)]
    random = np.random.default_rng(4)
    trees = []
    for a, b in pairwise(at):
        u = (b - a) / np.linalg.norm(b - a)
        for share, side in zip(random.uniform(0.1, 0.9, 14), random.uniform(-40, 40, 14), strict=True):
            place = a + share * (b - a) + side * np.array([-u[1], u[0]])
            trees.append((*place, random.uniform(6, 14), random.uniform(3, 6)))
    line, cloud = _built(spans, structures, trees, relief_m=2.5, density=density)
    survey = Survey(frame, (line,), cloud, "lines/380kV-double.laz", made={"program": "plnerf 0.1.0"})
    return replace(survey, clearances=_clearances(survey))


def unscaled(density: float = 0.1) -> Survey:
    """The short one in units of its reconstruction: no clearances, no place on the earth."""
    frame = replace(FRAME, scale=31.5, unit="unscaled", crs=None, origin_lon_lat_height=None)
    return replace(
        short(density), frame=frame, clearances=None, findings=(), temperature_c=None, pictures=()
    )  # fmt: skip


def empty(density: float = 0.05) -> Survey:
    """No wire, but ground."""
    return replace(short(density), lines=(), clearances=None, pictures=(), temperature_c=None)


def open_ended(density: float = 1.0) -> Survey:
    """The short one filmed to three quarters: the last ends of all wires are open, one wire was half seen."""
    survey = short(density)
    (line,) = survey.lines
    wires = []
    for wire in line.wires:
        cut = replace(wire.between(0.0, 30.0), ends=(wire.ends[0], Open("not filmed beyond it")))
        seen = ((0.0, 11.0), (17.5, 30.0)) if wire.id == 2 else None
        wires.append(replace(cut, evidence=replace(cut.evidence, seen_m=seen)))
    span = Span(1, (1, None), tuple(wires))
    survey = replace(survey, lines=(replace(line, structures=line.structures[:1], spans=(span,)),))
    return replace(survey, clearances=_clearances(survey))


def two_lines(density: float = 0.1) -> Survey:
    """Two lines beside each other, whose spans and structures are both numbered from 1."""
    survey = short(density)
    (line,) = survey.lines
    shift = np.array([0.0, 7.0, 4.0])
    wires = tuple(moved(wire, shift, id=wire.id + 5) for wire in line.wires)
    second = replace(
        line, id=2, spans=(replace(line.spans[0], wires=wires),),
        structures=tuple(replace(one, foot=one.foot + shift) for one in line.structures),
    )  # fmt: skip
    survey = replace(survey, lines=(line, second), pictures=())
    return replace(survey, clearances=_clearances(survey))


def half_seen() -> Survey:
    """A span of which the ground was not seen from 10 m on, and neither ground nor air from 20 to 30 m."""
    survey = short(0.1)
    edges = np.arange(0.0, 41.0, 10.0)
    one = Coverage(
        1, 1, edges[:-1], edges[1:], np.array([0.9, 0.4, 0.1, 0.8]), np.array([0.9, 0.8, 0.3, 0.7]),
        np.array([9.0, 7.0, 1.0, 5.0]), 0.5,
    )  # fmt: skip
    return replace(survey, coverage=(one,))


def moved(wire: Wire, by: np.ndarray, **changed: object) -> Wire:
    """The same wire elsewhere."""
    base = replace(wire.base, a=wire.base.a + by[:2], b=wire.base.b + by[:2])
    theta = wire.theta + by[2] * np.array([0, 0, 1, 1, 0, 0])
    ends = tuple(
        replace(end, point=end.point + by) if isinstance(end, Attached) else end for end in wire.ends
    )
    return replace(wire, base=base, theta=theta, ends=ends, **changed)


def _built(
    spans: Sequence[Sequence[Ends]], towers: Sequence, trees: Sequence, *, relief_m: float, density: float
) -> tuple[Line, Cloud]:
    """The line and its cloud."""
    random = np.random.default_rng(1)
    feet = np.array([place[:2] for place in towers])
    wide = max(12.0, 0.12 * float(np.ptp(feet, axis=0).max()))
    points, labels, owners = [], [], []

    def add(xyz: np.ndarray, label: int, wire: int = 0) -> None:
        points.append(xyz + 0.02 * random.normal(size=xyz.shape))
        labels.append(np.full(len(xyz), label, np.uint8))
        owners.append(np.full(len(xyz), wire))

    for (a, b), wires in zip(pairwise(feet), spans, strict=True):
        u = (b - a) / np.linalg.norm(b - a)
        share, side = random.uniform(-0.08, 1.08, (2, int(60_000 * density)))
        xy = a + share[:, None] * (b - a) + (2 * side - 1)[:, None] * wide * np.array([-u[1], u[0]])
        add(np.column_stack([xy, ground(xy, relief_m)]), GROUND)
        for first, last, _ in wires:
            for end in (first, last):
                add(np.array(end) + [0, 0, 0.3] + 0.12 * random.normal(size=(40, 3)), CONNECTOR)
    for x, y, height, radius in trees:
        foot = ground(np.array([[x, y]]), relief_m)[0]
        n = int(2500 * density) + 60
        direction = random.normal(size=(n, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        crown = [x, y, foot + 0.62 * height] + direction * [radius, radius, 0.38 * height]
        crown += 0.1 * random.normal(size=crown.shape)
        above = crown[:, 2] - foot
        for label, low, high in ((LOW_VEGETATION, -1, 0.5), (VEGETATION, 0.5, 2), (HIGH_VEGETATION, 2, 99)):
            add(crown[(above >= low) & (above < high)], label)
    structures = []
    for number, (x, y, height) in enumerate(towers, 1):
        foot = np.array([x, y, ground(np.array([[x, y]]), relief_m)[0]])
        share = random.random(int(3000 * density) + 200)
        corner = random.choice([-1.0, 1.0], (2, len(share))) * (1 - 0.85 * share) * 0.09 * height / 2
        add(foot + np.column_stack([*corner, share * height]), TOWER)
        structures.append(Structure(number, foot, height, 0.04, "its body in the cloud", "suspension"))
    made, id_ = [], 0
    for number, wires in enumerate(spans, 1):
        hung = []
        for k, ends in enumerate(wires):
            id_ += 1
            wire = _hung(ends, id_, number, "shield" if len(wires) == 5 and k == 4 else "phase")
            hung.append(wire)
            length = wire.base.length_m
            s = np.linspace(0, length, round(length / (0.1 if length < 100 else 0.4)))
            gap = 1 - wire.evidence.coverage
            share = s / length
            on = wire.points(s[(share < 0.5 - gap / 2) | (share > 0.5 + gap / 2)])
            add(on, SHIELD if wire.kind == "shield" else CONDUCTOR, id_)
        made.append(Span(number, (number, number + 1), tuple(hung)))
    cloud = Cloud(np.concatenate(points), np.concatenate(labels), np.concatenate(owners).astype(np.int64))
    return Line(1, tuple(structures), tuple(made)), cloud


def _hung(ends: Ends, id_: int, span: int, kind: Kind) -> Wire:
    """With an uncertainty, evidence, and a note for every third."""
    gap = 0.45 if id_ == 3 else 0.04
    first, last, sag = ends
    wire = hang(first, last, sag, id=id_, kind=kind)
    length = wire.base.length_m
    return replace(
        wire,
        covariance=np.diag(SIGMA**2),
        ends=(Attached(span, np.array(first), 0.03), Attached(span + 1, np.array(last), 0.03)),
        evidence=Evidence(f"{1200 + id_:,} points", 1200 + id_, 1 - gap, gap * length, 0.012, 0.009),
        notes=() if id_ % 3 else ("its support is not seen.",),
    )


def _clearances(survey: Survey) -> Clearances:
    """By brute force."""
    codes = np.array([GROUP.get(int(label), "") for label in survey.cloud.label])
    groups: dict[Group, np.ndarray] = {
        group: survey.cloud.xyz[codes == group] for group in ("ground", "vegetation")
    }
    trees = {group: cKDTree(points) for group, points in groups.items()}
    flat = {group: cKDTree(points[:, :2]) for group, points in groups.items()}
    found = []
    for span, wire in [(of, wire) for of in survey.spans for wire in of.wires]:
        s = np.linspace(0, wire.base.length_m, 161)
        points, places, distances, z = wire.points(s), {}, {}, {}
        for group, code, reach, top in (
            ("ground", GROUND, 1.5, np.median), ("vegetation", HIGH_VEGETATION, 3.0, np.max)
        ):  # fmt: skip
            distances[group], index = trees[group].query(points)
            k = int(distances[group].argmin())
            places[group] = (Place(
                wire.id, span.id, wire.kind, group, code, "distance", float(distances[group][k]),
                0.05 + 0.02 * wire.id, float(s[k]), points[k], groups[group][index[k]],
            ),)  # fmt: skip
            near = flat[group].query_ball_point(points[:, :2], reach)
            z[group] = np.array([top(groups[group][i, 2]) if i else np.nan for i in near])
        down = points[:, 2] - z["ground"]
        k = int(np.nanargmin(down))
        vertical = Place(
            wire.id, span.id, wire.kind, "ground", GROUND, "vertical", float(down[k]), 0.04, float(s[k]),
            points[k], np.array([*points[k, :2], z["ground"][k]]),
        )  # fmt: skip
        profile = Profile(
            wire.id, s, points, wire.sigma_at(s)[:, 1], z["ground"], z["vegetation"],
            {group: distances.get(group, np.full(len(s), np.nan)) for group in GROUPS},
        )  # fmt: skip
        places = {group: places.get(group, ()) for group in GROUPS}
        found.append(WireClearance(wire.id, span.id, wire.kind, places, vertical, profile))
    needed = Requirement(REQUIRED_M, ("ground", "vegetation"), "5 m", "given by the user")
    return Clearances(tuple(found), needed)


def photo(count: int, width: int = 1920) -> Picture:
    """A drawn photo of wires before sky and trees, and where the survey's are in it."""
    height = width * 9 // 16
    sky = np.linspace(205, 240, height)[:, None, None] * [0.86, 0.93, 1.0]
    rgb = np.broadcast_to(sky, (height, width, 3)).astype(np.uint8).copy()
    random = np.random.default_rng(2)
    for x in random.uniform(0, width, 60):
        colour = (int(random.uniform(40, 90)), int(random.uniform(80, 120)), 50)
        cv2.circle(rgb, (int(x), height), int(random.uniform(0.1, 0.3) * height), colour, -1, cv2.LINE_AA)
    x = np.linspace(-50, width + 50, 120)
    lines = []
    for k in range(count):
        y = height * (0.15 + 0.5 * k / count) + height * 0.12 * (1 - ((x - width / 2) / width * 2) ** 2)
        lines.append(np.column_stack([x, y]))
        at = np.round((lines[-1] - 0.5) * 16).astype(np.int32)
        cv2.polylines(rgb, [at], False, (50, 50, 55), 3, cv2.LINE_AA, 4)
    return Picture("DJI_0007.JPG", rgb, tuple(lines))
