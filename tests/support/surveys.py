"""Surveys for tests of what is told of them: known catenaries over ground with relief, towers and trees."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
from scipy.spatial import cKDTree

from plnerf.line.catenary import Catenary, hang
from plnerf.report.data import Clearance, Picture, Profile, Report
from plnerf.report.overlay import overlay
from plnerf.survey.fit import fit_catenary
from plnerf.survey.model import (
    CONDUCTOR,
    CONNECTOR,
    GROUND,
    HIGH_VEGETATION,
    LOW_VEGETATION,
    SHIELD,
    TOWER,
    VEGETATION,
    Cloud,
    Conductor,
    Survey,
    Tower,
)

REQUIRED_M = {"vegetation": 3.0, "ground": 6.0}
NAMES = {GROUND: "ground", **dict.fromkeys((LOW_VEGETATION, VEGETATION, HIGH_VEGETATION), "vegetation")}


def ground(xy: np.ndarray, relief_m: float) -> np.ndarray:
    """Height of the ground."""
    return relief_m * (np.sin(xy[:, 0] / 31) + 0.5 * np.cos(xy[:, 1] / 17 + xy[:, 0] / 60))


def short(density: float = 1.0) -> Report:
    """Five conductors over 40 m, the fifth a shield wire; local metres of a place on the earth."""
    wires = [hang((-20.0, y, z), (20.0, y + 0.4, z + 0.9), sag) for y, z, sag in (
        (-3.1, 10.0, 1.21), (0.0, 10.1, 1.18), (3.1, 10.0, 1.24), (1.5, 12.6, 1.05), (-0.4, 14.9, 0.62)
    )]  # fmt: skip
    towers = [(-20.4, 0.0, 15.3), (20.4, 0.4, 16.1)]
    trees = [(-6.0, 4.5, 6.1, 2.0), (3.0, -9.0, 7.5, 2.6), (9.5, 5.6, 4.2, 1.4), (-13.0, -7.5, 3.1, 1.2)]
    built = _built([wires], towers, trees, relief_m=0.8, density=density)
    survey = Survey(
        **built, unit="m", crs="EPSG:25832", origin=np.array([8.1234567, 49.7654321, 212.4]),
        source="/data/runs/span-40m", temperature_c=31.0,
        notes=("The scale rests on the photos' positions: it is known to 0.4 %.",),
    )  # fmt: skip
    return _told(survey)


def long(density: float = 1.0) -> Report:
    """A double circuit over two spans with an angle between them, in coordinates of a national grid."""
    at = np.array([[233_145.2, 582_017.7], [233_441.0, 582_139.5], [233_671.3, 582_300.8]])
    spans = []
    for k, (a, b) in enumerate(pairwise(at)):
        u = (b - a) / np.linalg.norm(b - a)
        n = np.array([-u[1], u[0]])
        spans.append([
            hang((*(a + y * n), z + 2.0 * k), (*(b + y * n), z + 2.0 * (k + 1)), sag + 0.1 * j)
            for j, (y, z, sag) in enumerate(
                (y, z, s - 2.1 * k) for z, s in ((24.0, 9.0), (30.5, 8.8), (37.0, 8.6)) for y in (-7.5, 7.5)
            )
        ])
    towers = [(*place, 46.0 + k) for k, place in enumerate(at)]
    random = np.random.default_rng(4)
    trees = []
    for a, b in pairwise(at):
        u = (b - a) / np.linalg.norm(b - a)
        for share, side in zip(random.uniform(0.1, 0.9, 14), random.uniform(-40, 40, 14), strict=True):
            place = a + share * (b - a) + side * np.array([-u[1], u[0]])
            trees.append((*place, random.uniform(6, 14), random.uniform(3, 6)))
    survey = Survey(
        **_built(spans, towers, trees, relief_m=2.5, density=density),
        unit="m", crs="EPSG:28992", origin=None, source="lines/380kV-double.laz",
    )  # fmt: skip
    return _told(survey)


def unscaled() -> Report:
    """The short one in units of its reconstruction, without requirements."""
    report, k = short(0.1), 0.0317
    cloud = report.survey.cloud
    conductors = tuple(
        replace(
            one, fit=fit_catenary(k * one.fit.curve.polyline(0.2), sigma_m=0.001),
            longest_gap_m=k * one.longest_gap_m,
        ) for one in report.survey.conductors
    )  # fmt: skip
    towers = tuple(Tower(k * one.foot, k * one.height_m) for one in report.survey.towers)
    survey = replace(
        report.survey, conductors=conductors, towers=towers, cloud=replace(cloud, xyz=k * cloud.xyz),
        unit="unscaled", crs=None, origin=None, notes=(), temperature_c=None,
    )  # fmt: skip
    clearances = tuple(
        replace(
            one, distance_m=k * one.distance_m, sigma_m=None, place_m=k * one.place_m, required_m=None,
            on_wire=k * one.on_wire, on_obstacle=k * one.on_obstacle, verdict="not judged",
        ) for one in report.clearances
    )  # fmt: skip
    profiles = tuple(
        Profile(one.conductor, *(k * z for z in (one.place_m, one.wire_m, one.ground_m, one.vegetation_m)))
        for one in report.profiles
    )
    return Report(survey, clearances, profiles, made=report.made)


def empty() -> Report:
    """No conductor, but ground."""
    report = short(0.05)
    return Report(replace(report.survey, conductors=(), towers=()), made=report.made)


def _built(
    spans: Sequence[Sequence[Catenary]], towers: Sequence, trees: Sequence, *, relief_m: float, density: float
) -> dict:
    """Cloud, conductors and towers."""
    random = np.random.default_rng(1)
    ends = np.array([place[:2] for place in towers])
    wide = max(12.0, 0.12 * float(np.ptp(ends, axis=0).max()))
    points, labels, owners = [], [], []

    def add(xyz: np.ndarray, label: int, wire: int = 0) -> None:
        points.append(xyz + 0.02 * random.normal(size=xyz.shape))
        labels.append(np.full(len(xyz), label, np.uint8))
        owners.append(np.full(len(xyz), wire))

    for (a, b), wires in zip(pairwise(ends), spans, strict=True):
        u = (b - a) / np.linalg.norm(b - a)
        share, side = random.uniform(-0.08, 1.08, (2, int(60_000 * density)))
        xy = a + share[:, None] * (b - a) + (2 * side - 1)[:, None] * wide * np.array([-u[1], u[0]])
        add(np.column_stack([xy, ground(xy, relief_m)]), GROUND)
        for wire in wires:
            for end in (wire.a, wire.b):
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
    masts = []
    for x, y, height in towers:
        foot = np.array([x, y, ground(np.array([[x, y]]), relief_m)[0]])
        share = random.random(int(3000 * density) + 200)
        corner = random.choice([-1.0, 1.0], (2, len(share))) * (1 - 0.85 * share) * 0.09 * height / 2
        add(foot + np.column_stack([*corner, share * height]), TOWER)
        masts.append(Tower(foot, height))
    conductors = []
    for span, wires in enumerate(spans):
        for wire in wires:
            id_ = len(conductors) + 1
            kind = "shield" if len(wires) == 5 and wire is wires[-1] else "phase"
            seen = wire.polyline(0.1 if wire.span_m < 100 else 0.4)
            share = np.linspace(0, 1, len(seen))
            gap = 0.45 if id_ == 3 else 0.04
            seen = seen[(share < 0.5 - gap / 2) | (share > 0.5 + gap / 2)]
            noisy = seen + 0.02 * random.normal(size=seen.shape)
            add(noisy, SHIELD if kind == "shield" else CONDUCTOR, id_)
            conductors.append(Conductor(
                id_, span, kind, fit_catenary(noisy), 1 - gap, gap * wire.span_m, len(noisy),
                f"{len(noisy):,} points", None if id_ % 3 else "its support is not seen.",
            ))  # fmt: skip
    cloud = Cloud(np.concatenate(points), np.concatenate(labels), np.concatenate(owners).astype(np.int64))
    return {"cloud": cloud, "conductors": tuple(conductors), "towers": tuple(masts)}


def _told(survey: Survey) -> Report:
    """With clearances and profiles by brute force, and a drawn photo."""
    clearances, profiles = [], []
    codes = np.array([NAMES.get(int(label), "") for label in survey.cloud.label])
    groups = {name: survey.cloud.xyz[codes == name] for name in REQUIRED_M}
    trees = {name: cKDTree(points) for name, points in groups.items()}
    flat = {name: cKDTree(points[:, :2]) for name, points in groups.items()}
    for one in survey.conductors:
        curve = one.fit.curve
        s = np.linspace(0, curve.span_m, 161)
        wire = curve.points(s)
        for name, required in REQUIRED_M.items():
            apart, index = trees[name].query(wire)
            k = int(apart.argmin())
            least, sigma = float(apart[k]), 0.05 + 0.02 * one.id
            words = "closer than required" if least < required else "clear"
            if abs(least - required) <= 2 * sigma:
                words = "within its uncertainty"
            clearances.append(Clearance(
                one.id, name, least, sigma, float(s[k]), wire[k], groups[name][index[k]], required, words
            ))  # fmt: skip
        z = {}
        for name, reach in (("ground", 1.5), ("vegetation", 3.0)):
            near = flat[name].query_ball_point(wire[:, :2], reach)
            heights = groups[name][:, 2]
            top = np.max if name == "vegetation" else np.median
            z[name] = np.array([top(heights[i]) if i else np.nan for i in near])
        profiles.append(Profile(one.id, s, wire[:, 2], z["ground"], z["vegetation"]))
    return Report(
        survey, tuple(clearances), tuple(profiles), (photo(len(survey.conductors)),),
        files=("cloud.laz", "conductors.geojson", "conductors.csv", "clearances.csv"),
        made={"preset": "guided", "plnerf": "0.1.0", "date": "2026-11-22"},
    )  # fmt: skip


def photo(count: int, width: int = 1920) -> Picture:
    """A drawn photo of wires before sky and trees, with the fitted ones over it."""
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
    colours = [(213, 94, 0) if k + 1 < count else (0, 114, 178) for k in range(count)]
    return Picture(f"DJI_0007.JPG, {count} fitted wires", overlay(rgb, lines, colours))
