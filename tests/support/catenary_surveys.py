"""Surveys made of known wires, for tests of what is measured in them and of what is exported."""

from dataclasses import replace

import numpy as np

from plnerf.line.base import Base
from plnerf.line.cloud import Cloud
from plnerf.line.ends import Attached
from plnerf.line.frame import LineFrame
from plnerf.line.hang import hang
from plnerf.line.line import Line, Span, Structure
from plnerf.line.survey import Survey
from plnerf.line.wire import Kind, Wire
from plnerf.survey.fit import fit_wire

ZERO = np.zeros(3)
UTM = np.array([500_000.0, 5_700_000.0, 0.0])
KINDS: tuple[Kind, ...] = ("phase", "phase", "shield")


def wires(origin: np.ndarray = ZERO) -> list[Wire]:
    """Two phases at different heights and a steep shield wire, on a span of 120 m; exact."""
    starts, ends = [(0, 0, 20), (0, 4, 26), (0, 2, 30)], [(118, 22, 24), (118, 26, 28), (118, 24, 55)]
    return [
        hang(origin + a, origin + b, sag, id=i, kind=kind)
        for i, (a, b, sag, kind) in enumerate(zip(starts, ends, (3.0, 2.0, 1.5), KINDS, strict=True), 1)
    ]


def fitted(wire: Wire, noise_m: float = 0.0, seed: int = 0) -> Wire:
    """A wire through 60 noisy points of another, which it replaces: with its id, its kind and its ends."""
    s = np.linspace(0, wire.base.length_m, 60)
    points = wire.points(s) + noise_m * np.random.default_rng(seed).normal(size=(60, 3))
    found, _ = fit_wire(points, Base(points[0, :2], points[-1, :2]))
    seen = replace(found.evidence, coverage=0.9, longest_gap_m=2.5)
    return replace(found, id=wire.id, kind=wire.kind, ends=wire.ends, evidence=seen)


def cloud(groups: dict[int, np.ndarray], **more: np.ndarray) -> Cloud:
    """Points by class."""
    label = np.concatenate([np.full(len(points), code, np.uint8) for code, points in groups.items()])
    xyz = np.concatenate(list(groups.values())).astype(np.float64)
    return Cloud(xyz, label, more.pop("wire", np.zeros(len(label), np.int64)), **more)


def corridor(origin: np.ndarray = UTM, count: int = 3000, seed: int = 1) -> Survey:
    """Three wires over sloping ground with trees, a house and what is not classified.

    origin: world coordinates of the LineFrame's origin; the world has the LineFrame's axes.
    """
    random, three = np.random.default_rng(seed), wires()
    ground = np.stack([random.uniform(-15, 135, count), random.uniform(-25, 50, count), np.zeros(count)], 1)
    ground[:, 2] = 0.03 * ground[:, 0] - 0.02 * ground[:, 1]
    tree = np.array([60.0, 8.0, 9.0]) + random.normal(size=(count // 10, 3)) * [2.0, 2.0, 3.0]
    bush = np.array([20.0, 9.0, 4.0]) + random.normal(size=(count // 10, 3))
    house = np.array([90.0, 30.0, 6.0]) + random.uniform(-3, 3, (count // 10, 3))
    stray = random.uniform([-10, -10, 5], [130, 40, 35], (count // 30, 3))
    on = [wire.points(np.linspace(0, wire.base.length_m, 50)) for wire in three]
    points = {2: ground, 5: tree, 3: bush, 6: house, 1: stray, 14: np.concatenate(on[:2]), 13: on[2]}
    label_free = sum(len(part) for part in points.values()) - 150
    of_wire = np.concatenate([np.zeros(label_free, np.int64), np.repeat([1, 2, 3], 50)])
    n = len(of_wire)
    return Survey(
        frame=LineFrame(np.eye(3), 1.0, origin, "m", "EPSG:25832"),
        lines=(line_of([fitted(one, 0.01, one.id) for one in three], feet()),),
        cloud=cloud(
            points,
            wire=of_wire,
            rgb=random.integers(0, 256, (n, 3)).astype(np.uint8),
            sigma_m=random.uniform(0.02, 0.1, n),
        ),
        source="cloud.laz",
    )


def feet() -> tuple[Structure, Structure]:
    """The structures of the corridor."""
    return (
        Structure(1, np.array([0.0, 2.0, 0.0]), 31.0, 0.1, "given"),
        Structure(2, np.array([118.0, 24.0, 3.0]), 53.0, 0.1, "given"),
    )


def line_of(span: list[Wire], structures: tuple[Structure, ...] = ()) -> Line:
    """A line of one span, between what holds its first wire."""
    first, last = (end.structure if isinstance(end, Attached) else None for end in span[0].ends)
    return Line(1, structures, (Span(1, (first, last), tuple(span)),))
