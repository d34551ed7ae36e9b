"""Clouds of lines whose every wire is known: catenaries, lattice towers, relief, trees, bars."""

from dataclasses import dataclass, field, replace

import numpy as np

from plnerf.line.hang import hang
from plnerf.line.wire import Wire

SHIELD_M = 33.0
ARMS = {20.0: 6.0, 26.0: 5.0}
"""Height of the wires on each arm, and how far to either side they hang."""


@dataclass
class Line:
    """Points by what they are, and the truth."""

    wires: list[Wire] = field(default_factory=list)
    """With their kinds, numbered from 1, span by span."""
    feet: list[np.ndarray] = field(default_factory=list)
    points: list[np.ndarray] = field(default_factory=list)
    classes: list[np.ndarray] = field(default_factory=list)
    owners: list[np.ndarray] = field(default_factory=list)

    def add(self, points: np.ndarray, code: int, owner: int = -1) -> None:
        self.points.append(points)
        self.classes.append(np.full(len(points), code))
        self.owners.append(np.full(len(points), owner))

    @property
    def xyz(self) -> np.ndarray:
        return np.concatenate(self.points)

    @property
    def truth(self) -> np.ndarray:
        return np.concatenate(self.classes)

    @property
    def owner(self) -> np.ndarray:
        """Index of the wire a point is on, -1 elsewhere."""
        return np.concatenate(self.owners)


def relief(xy: np.ndarray) -> np.ndarray:
    """Hills and a slope."""
    return 2 * np.sin(xy[:, 0] / 40) + 1.5 * np.cos(xy[:, 1] / 30) + 0.06 * xy[:, 0]


def line(
    feet: np.ndarray, twin_m: float = 0.4, noise_m: float = 0.03, density: float = 3.0, seed: int = 0
) -> Line:
    """Spans over towers at `feet` (x, y): two phases on the left, as bundles of two, two on the right that
    are single, and a shield; ground, trees beside the line."""
    random, made = np.random.default_rng(seed), Line()
    at = [np.append(xy, relief(xy[None])[0]) for xy in feet.astype(float)]
    made.feet = at
    turns = np.gradient(feet.astype(float), axis=0)
    left = np.stack([-turns[:, 1], turns[:, 0]], 1) / np.linalg.norm(turns, axis=1)[:, None]
    for k in range(len(feet) - 1):
        for height, arm in ARMS.items():
            for side in (arm - twin_m / 2, arm + twin_m / 2, -arm):
                _hang(made, at[k : k + 2], left[k : k + 2], side, height, random, noise_m, density)
        _hang(made, at[k : k + 2], left[k : k + 2], 0.0, SHIELD_M, random, noise_m, density / 3)
    for foot, across in zip(at, left, strict=True):
        made.add(tower(foot, across, random), 15)
    corner, size = feet.min(0) - 30, np.ptp(feet, axis=0) + 60
    ground(made, corner, size, random)
    for k in range(len(feet) - 1):
        for share in (0.3, 0.7):
            middle = feet[k] + share * (feet[k + 1] - feet[k]) + 16 * left[k]
            tree(made, middle, random)
    return made


def blown(still: Line, degrees: float) -> Line:
    """The line in a wind that swings its phases so far, and its shields twice as far."""
    moved = Line(feet=still.feet, classes=still.classes, owners=still.owners)
    for wire in still.wires:
        swing = np.radians(degrees * (2 if wire.kind == "shield" else 1))
        moved.wires.append(replace(wire, theta=np.append(wire.theta[:5], swing)))
    for points, owner in zip(still.points, still.owners, strict=True):
        if owner[0] < 0:
            moved.points.append(points)
            continue
        old, new = still.wires[owner[0]], moved.wires[owner[0]]
        local = old.base.local(points)
        yz = local[:, 1:] + new.at(local[:, 0]) - old.at(local[:, 0])
        moved.points.append(old.base.place(local[:, 0], yz))
    return moved


def _hang(
    made: Line, feet: list[np.ndarray], left: np.ndarray, side: float, height: float,
    random: np.random.Generator, noise_m: float, density: float,
) -> None:  # fmt: skip
    a, b = (
        np.append(foot[:2] + side * across, foot[2] + height) for foot, across in zip(feet, left, strict=True)
    )
    shield = height == SHIELD_M
    span = np.linalg.norm(b[:2] - a[:2])
    wire = hang(
        a, b, float(span**2) / (8 * (1900.0 if shield else 1500.0)),
        id=len(made.wires) + 1, kind="shield" if shield else "phase",
    )  # fmt: skip
    s = random.uniform(0, wire.base.length_m, int(density * wire.base.length_m))
    made.add(
        wire.points(s) + noise_m * random.normal(size=(len(s), 3)), 13 if shield else 14, len(made.wires)
    )
    made.wires.append(wire)


def tower(foot: np.ndarray, left: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Four legs that come together, and arms 2 m above the wires they hold."""
    along = np.array([left[1], -left[0]])
    up = np.sort(random.uniform(0, 35.0, 600))
    half = 2.5 - 2.2 * up / 35.0
    signs = random.choice([-1.0, 1.0], (600, 2))
    legs = foot[:2] + (signs[:, :1] * along + signs[:, 1:] * left) * half[:, None]
    parts = [np.column_stack([legs, foot[2] + up])]
    for height, arm in ARMS.items():
        y, s = random.uniform(-arm - 0.5, arm + 0.5, 150), random.uniform(-0.4, 0.4, 150)
        parts.append(np.column_stack([foot[:2] + y[:, None] * left + s[:, None] * along,
                                      np.full(150, foot[2] + height + 2)]))  # fmt: skip
    return np.concatenate(parts)


def ground(
    made: Line, corner: np.ndarray, size: np.ndarray, random: np.random.Generator, density: float = 1.5
) -> None:
    xy = corner + random.random((int(density * size.prod()), 2)) * size
    made.add(np.column_stack([xy, relief(xy) + 0.03 * random.normal(size=len(xy))]), 2)


def tree(made: Line, middle: np.ndarray, random: np.random.Generator, height: float = 11.0) -> None:
    """A crown full of leaves, and nothing else."""
    offset = random.normal(size=(900, 3))
    offset *= (random.random(900) ** (1 / 3) / np.linalg.norm(offset, axis=1))[:, None]
    foot = relief(middle[None])[0]
    made.add(np.append(middle, foot + 0.6 * height) + offset * [3.0, 3.0, 0.4 * height], 5)


def bars(ends: np.ndarray, per_metre: float, thick_m: float, random: np.random.Generator) -> np.ndarray:
    """Points of straight bars, (k, 2, 3)."""
    parts = []
    for a, b in ends:
        count = int(per_metre * np.linalg.norm(b - a))
        parts.append(a + random.random((count, 1)) * (b - a) + thick_m * random.normal(size=(count, 3)))
    return np.concatenate(parts)
