"""Lines hung from known structures, and their wires as they are detected: beyond or short of these, noisy."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from plnerf.line.base import Base
from plnerf.line.ends import Evidence, Open
from plnerf.line.hang import hang
from plnerf.line.wire import Wire
from plnerf.survey.surface import Surface

OPEN = (Open("not searched"), Open("not searched"))
SIGMA = np.array([0.006, 0.006, 0.006, 0.006, 0.005, 0.0])
"""Of theta: what the refit to images leaves."""
ARMS = ((-4.0, 18.0), (0.0, 18.0), (4.0, 18.0), (0.0, 24.0))
"""y and height of attachments."""


def attachments(
    feet: np.ndarray, arms: Sequence[tuple[float, float]] = ARMS, along: np.ndarray | None = None
) -> np.ndarray:
    """Where structures (s 2) hold wires, of each structure (s w 3); crossarms halve the bends.

    along: (s w) how much further on along the line each is.
    """
    u = np.diff(feet, axis=0)
    u /= np.linalg.norm(u, axis=1)[:, None]
    t = np.array([u[0], *(a + b for a, b in pairwise(u)), u[-1]])
    t /= np.linalg.norm(t, axis=1)[:, None]
    n = np.stack([-t[:, 1], t[:, 0]], 1)
    y, z = np.array(arms).T
    along = np.zeros((len(feet), len(y))) if along is None else along
    flat = feet[:, None] + y[:, None] * n[:, None] + along[..., None] * t[:, None]
    return np.concatenate([flat, np.broadcast_to(z[:, None], (*flat.shape[:2], 1))], -1)


def true_spans(held: np.ndarray, sag_share: float = 0.03) -> list[list[Wire]]:
    """The wires of each span."""
    return [
        [hang(p, q, sag_share * float(np.linalg.norm((q - p)[:2]))) for p, q in zip(a, b, strict=True)]
        for a, b in pairwise(held)
    ]


def detected(
    wire: Wire, random: np.random.Generator | None, beyond: tuple[float, float] = (0.0, 0.0)
) -> Wire:
    """The wire with errors (none without a generator) and their covariance, as far as so much beyond its
    attachments."""
    covariance = np.diag(SIGMA**2)
    theta = wire.theta + (0.0 if random is None else random.normal(size=6) * SIGMA)
    seen = Evidence("a test", 40, reach_m=0.1)
    known = replace(wire, id=0, theta=theta, covariance=covariance, ends=OPEN, evidence=seen)
    return known.between(-beyond[0], wire.base.length_m + beyond[1])


def turned_by(degrees: float) -> np.ndarray:
    """A rotation about the upright, (3 3)."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def rotated(wire: Wire, R: np.ndarray) -> Wire:
    """The wire in a frame that is turned about the upright."""
    return replace(wire, base=Base(R[:2, :2] @ wire.base.a, R[:2, :2] @ wire.base.b))


def surface(*parts: np.ndarray) -> Surface:
    """Of points."""
    xyz = np.concatenate([np.zeros((0, 3)), *parts])
    n = len(xyz)
    return Surface(xyz, np.zeros((n, 3), np.uint8), np.full(n, 0.05), np.tile([0.0, 1.0, 0.0], (n, 1)))


def ground(random: np.random.Generator, low: tuple[float, float], high: tuple[float, float]) -> np.ndarray:
    """At height 0."""
    flat = random.uniform(low, high, (8000, 2))
    return np.column_stack([flat, random.normal(0, 0.05, len(flat))])


def tower(random: np.random.Generator, held: np.ndarray, body: bool = True) -> np.ndarray:
    """What holds wires at some points (w 3): strings of a metre and arms above them, on a lattice."""
    strings = np.concatenate([
        np.column_stack([random.normal(p[:2], 0.08, (60, 2)), random.uniform(p[2], p[2] + 1, 60)])
        for p in held
    ])  # fmt: skip
    ends = np.array([held[held[:, 2] == z][[0, -1]] for z in np.unique(held[:, 2])])
    share = random.random((len(ends), 150, 1))
    arms = (ends[:, :1] + share * (ends[:, 1:] - ends[:, :1])).reshape(-1, 3) + np.array([0.0, 0.0, 1.0])
    axis, top = held[:, :2].mean(0), held[:, 2].max() + 1
    lattice = np.column_stack([axis + random.uniform(-0.7, 0.7, (900, 2)), random.uniform(0, top, 900)])
    points = [strings, arms + random.normal(0, 0.05, arms.shape)]
    return np.concatenate([*points, lattice] if body else points)
