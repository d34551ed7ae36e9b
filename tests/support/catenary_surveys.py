"""Surveys made of known catenaries, for tests of what is measured in them and of what is exported."""

import numpy as np

from plnerf.line.catenary import Catenary, hang
from plnerf.survey.fit import fit_catenary
from plnerf.survey.model import Cloud, Conductor, Kind, Survey, Tower

UTM = np.array([500_000.0, 5_700_000.0, 0.0])


def wires(origin: np.ndarray) -> list[Catenary]:
    """Two phases at different heights and a steep shield wire, on a span of 120 m."""
    starts, ends = [(0, 0, 20), (0, 4, 26), (0, 2, 30)], [(118, 22, 24), (118, 26, 28), (118, 24, 55)]
    return [
        hang(tuple((origin + a).tolist()), tuple((origin + b).tolist()), sag)
        for a, b, sag in zip(starts, ends, (3.0, 2.0, 1.5), strict=True)
    ]


def conductor(
    wire: Catenary, number: int = 1, noise_m: float = 0.0, seed: int = 0, kind: Kind = "phase"
) -> Conductor:
    points = wire.points(np.linspace(0, wire.span_m, 60))
    points = points + noise_m * np.random.default_rng(seed).normal(size=points.shape)
    return Conductor(number, 0, kind, fit_catenary(points), 0.9, 2.5, 60, "60 points")


def cloud(groups: dict[int, np.ndarray], **more: np.ndarray) -> Cloud:
    """Points by class."""
    label = np.concatenate([np.full(len(points), code, np.uint8) for code, points in groups.items()])
    xyz = np.concatenate(list(groups.values())).astype(np.float64)
    return Cloud(xyz, label, more.pop("wire", np.zeros(len(label), np.int64)), **more)


def corridor(origin: np.ndarray = UTM, count: int = 3000, seed: int = 1) -> Survey:
    """Three wires over sloping ground with trees, a house and what is not classified."""
    random, three = np.random.default_rng(seed), wires(origin)
    ground = np.stack([random.uniform(-15, 135, count), random.uniform(-25, 50, count), np.zeros(count)], 1)
    ground[:, 2] = 0.03 * ground[:, 0] - 0.02 * ground[:, 1]
    tree = np.array([60.0, 8.0, 9.0]) + random.normal(size=(count // 10, 3)) * [2.0, 2.0, 3.0]
    bush = np.array([20.0, 9.0, 4.0]) + random.normal(size=(count // 10, 3))
    house = np.array([90.0, 30.0, 6.0]) + random.uniform(-3, 3, (count // 10, 3))
    stray = random.uniform([-10, -10, 5], [130, 40, 35], (count // 30, 3))
    on = [wire.points(np.linspace(0, wire.span_m, 50)) - origin for wire in three]
    points = {2: ground, 5: tree, 3: bush, 6: house, 1: stray, 14: np.concatenate(on[:2]), 13: on[2]}
    label_free = sum(len(part) for part in points.values()) - 150
    wire = np.concatenate([np.zeros(label_free, np.int64), np.repeat([1, 2, 3], 50)])
    n = len(wire)
    return Survey(
        tuple(
            conductor(one, i, 0.01, i, kind)
            for i, (one, kind) in enumerate(zip(three, ["phase", "phase", "shield"], strict=True), 1)
        ),
        (Tower(origin + np.array([0, 2, 0]), 31.0), Tower(origin + np.array([118, 24, 3]), 53.0)),
        cloud(
            {code: part + origin for code, part in points.items()},
            wire=wire,
            rgb=random.integers(0, 256, (n, 3)).astype(np.uint8),
            sigma_m=random.uniform(0.02, 0.1, n),
        ),
        "m",
        "EPSG:25832",
        None,
        "cloud.laz",
    )
