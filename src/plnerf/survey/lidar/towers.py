"""Supports of a line in a cloud: what stands where the spans end, and which points are its own.

A support is where two spans meet, or where one ends although the cloud goes on and something upright reaches
its highest wires.  Letters: n points; s along a span, y to its left; metres, z up.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage
from scipy.spatial import cKDTree

from plnerf.survey.ground import Ground
from plnerf.survey.lidar.spans import Span, meet
from plnerf.survey.model import Tower

AROUND_M, BESIDE_M = 10.0, 3.0
"""How far along the line from the wires' ends a support is looked for, and how far beside the outer wires."""
TOP_M = 1.5
"""A support reaches up to its highest wire but for this, and what is above its lowest wire but for this is
taller than trees may be there."""
BODY_M, BODY_SHARE, BODY_FROM_M = 4.0, 0.4, 2.0
"""Half the width of its body below the wires and the depth of all of it, and the share of the metres between
the ground's plants and its lowest wire that must show it, where only one span ends."""
FEWEST = 4
AHEAD_M = (5.0, 10.0, 15.0)
"""Where beyond its tracks' ends points show that the cloud goes on."""
VOID_M = 2.0
"""Without a point within this distance in plan there is no cloud."""
CELL_M = 1.0
"""Side of the cells of which neighbouring ones belong to one body."""


@dataclass(frozen=True, eq=False)
class Support:
    """A tower, and its outline in plan: a rectangle across the line."""

    tower: Tower
    u: Float[np.ndarray, "2"]
    """Along the line, at right angles to its crossarms."""
    half_width_m: float
    lowest_wire_m: float
    """World z."""
    seen: bool
    """False: it is taken to stand where spans meet; the cloud shows nothing of it."""

    def flat(self, points: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n 2"]:
        """Along and across the line, from its axis."""
        return (points[:, :2] - self.tower.foot[:2]) @ _axes(self.u)


@dataclass(frozen=True, eq=False)
class Held:
    """What holds a span's first and last end: an index of a support; None: the cloud does not show it."""

    by: tuple[int | None, int | None]
    cut: tuple[bool, bool]
    """Whether the cloud itself ends where the span does."""


def supports(
    spans: Sequence[Span], points: Float[np.ndarray, "n 3"], other: Float[np.ndarray, "k 3"], ground: Ground
) -> tuple[list[Support], list[Held]]:
    """Supports in the order of the spans, and what holds each span.

    points: the whole cloud, for where it ends; other: those above the ground that are on no wire.
    """
    plan = cKDTree(points[:, :2])
    found: list[Support] = []
    by: list[list[int | None]] = [[None, None] for _ in spans]
    cut = [(_cloud_ends(span, False, plan), _cloud_ends(span, True, plan)) for span in spans]
    for k, span in enumerate(spans):
        for last in (False, True):
            if by[k][last] is not None:
                continue
            ends = [(k, last)]
            for j, partner in enumerate(spans):
                met = meet(span, partner) if j != k else None
                if met is not None and met[0] == last:
                    ends.append((j, met[1]))
            if len(ends) == 1 and cut[k][last]:
                continue
            support = _support([(spans[j], at) for j, at in ends], other, ground)
            if support is not None:
                for j, at in ends:
                    by[j][at] = len(found)
                found.append(support)
    return found, [Held((b[0], b[1]), c) for b, c in zip(by, cut, strict=True)]


def on_support(support: Support, other: Float[np.ndarray, "k 3"]) -> Bool[np.ndarray, " k"]:
    """Which points are a support's: in its outline, and joined to what is as high as its wires."""
    mine = np.zeros(len(other), np.bool_)
    if not support.seen:
        return mine
    flat = np.abs(support.flat(other))
    arms = (other[:, 2] >= support.lowest_wire_m - TOP_M) & (flat[:, 1] <= support.half_width_m + BESIDE_M)
    box = np.flatnonzero((flat[:, 0] <= BODY_M) & (arms | (flat[:, 1] <= BODY_M)))
    cell = ((other[box] - other[box].min(0)) / CELL_M).astype(int)
    filled = np.zeros(cell.max(0) + 1, np.bool_)
    filled[tuple(cell.T)] = True
    body, _ = ndimage.label(filled, np.ones((3, 3, 3)))
    label = body[tuple(cell.T)]
    mine[box] = np.isin(label, label[other[box, 2] >= support.lowest_wire_m - TOP_M])
    return mine


def _axes(u: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2 2"]:
    return np.array([[u[0], -u[1]], [u[1], u[0]]])


def _cloud_ends(span: Span, last: bool, plan: cKDTree) -> bool:
    """Whether there are hardly any points beyond the ends of its tracks."""
    outward = span.u if last else -span.u
    ends = [track.points(np.array(track.ends))[:, :2] for track in span.tracks]
    outer = np.array([both[(both @ outward).argmax()] for both in ends])
    ahead = np.concatenate([outer + far * outward for far in AHEAD_M])
    return bool((plan.query(ahead)[0] > VOID_M).mean() > 0.5)


def _support(
    ends: Sequence[tuple[Span, bool]], other: Float[np.ndarray, "k 3"], ground: Ground
) -> Support | None:
    """What stands where spans end; where several do, something does even if no point shows it."""
    wires = np.concatenate([span.end(last) for span, last in ends])
    low, high = float(wires[:, 2].min()), float(wires[:, 2].max())
    place = np.mean([span.end(last)[:, :2].mean(0) for span, last in ends], axis=0)
    u = np.sum([span.u for span, _ in ends], axis=0)
    axes = _axes(u / np.linalg.norm(u))
    half = float(np.abs((wires[:, :2] - place) @ axes[:, 1]).max())
    flat = (other[:, :2] - place) @ axes
    upper = (np.abs(flat) <= [AROUND_M, half + BESIDE_M]).all(1) & (other[:, 2] >= low - TOP_M)
    if upper.any():
        upper &= np.abs(flat[:, 0] - np.median(flat[upper, 0])) <= BODY_M
    seen = bool(upper.sum() >= FEWEST and other[upper, 2].max() >= high - TOP_M)
    middle = np.median(flat[upper], axis=0) if seen else np.zeros(2)
    xy = place + axes @ middle
    z = float(ground.below(xy[None])[0])
    if len(ends) == 1:
        body = other[(np.abs(flat - middle) <= [BODY_M, half + BESIDE_M]).all(1), 2] - z
        metres = np.unique(body[(body >= BODY_FROM_M) & (body < low - z)].astype(int))
        seen = seen and len(metres) >= BODY_SHARE * (low - z - BODY_FROM_M)
    if not seen and len(ends) == 1:
        return None
    top = float(other[upper, 2].max()) if seen else high
    tower = Tower(np.append(xy, z), top - z)
    return Support(tower, axes[:, 0], half, low, seen)
