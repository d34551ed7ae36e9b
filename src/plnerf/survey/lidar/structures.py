"""Structures of a line in a cloud: what stands where the spans end, and which points belong to it.

A structure is where two spans meet, or where one ends although the cloud continues and something upright
reaches its highest wires.  Letters: n points; s along a span, y to its left; metres, z up.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage
from scipy.spatial import cKDTree

from plnerf.line.ends import Open
from plnerf.survey.ground import Ground
from plnerf.survey.lidar.config import SpanConfig, StructureConfig
from plnerf.survey.lidar.spans import TrackSpan, meet

CLOUD_ENDS = Open("the cloud ends there")
NOTHING_SEEN = Open("no support is seen there")


@dataclass(frozen=True, eq=False)
class Outline:
    """A structure in plan: a rectangle across the line."""

    foot: Float[np.ndarray, "3"]
    height_m: float
    u: Float[np.ndarray, "2"]
    """Along the line, at right angles to its crossarms."""
    half_width_m: float
    lowest_wire_m: float
    """z of the lowest wire that hangs there."""
    seen: bool
    """False: it is inferred from spans that meet, and the cloud shows nothing of it."""

    def flat(self, points: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n 2"]:
        """Distances of points from its axis, along and across the line."""
        return (points[:, :2] - self.foot[:2]) @ _axes(self.u)

    def own(self, points: Float[np.ndarray, "n 3"], config: StructureConfig) -> Bool[np.ndarray, " n"]:
        """Which points are its own: in its outline, and connected with what is as high as its wires."""
        mine = np.zeros(len(points), np.bool_)
        if not self.seen:
            return mine
        flat = np.abs(self.flat(points))
        upper = self.lowest_wire_m - config.top_m
        arms = (points[:, 2] >= upper) & (flat[:, 1] <= self.half_width_m + config.beside_m)
        box = np.flatnonzero((flat[:, 0] <= config.body_m) & (arms | (flat[:, 1] <= config.body_m)))
        cell = ((points[box] - points[box].min(0)) / config.cell_m).astype(int)
        filled = np.zeros(cell.max(0) + 1, np.bool_)
        filled[tuple(cell.T)] = True
        body, _ = ndimage.label(filled, np.ones((3, 3, 3)))
        label = body[tuple(cell.T)]
        mine[box] = np.isin(label, label[points[box, 2] >= upper])
        return mine


Holder = int | Open
"""The index of the outline that holds an end of a span, or why it is open."""


def find_structures(
    spans: Sequence[TrackSpan], points: Float[np.ndarray, "n 3"], other: Float[np.ndarray, "k 3"],
    ground: Ground, config: StructureConfig, meeting: SpanConfig,
) -> tuple[list[Outline], list[tuple[Holder, Holder]]]:  # fmt: skip
    """Structures in the order of the spans, and what holds the first and the last end of each span.

    points: the whole cloud, for where it ends; other: those above the ground that are on no wire.
    """
    plan = cKDTree(points[:, :2])
    found: list[Outline] = []
    holders: dict[tuple[int, bool], Holder] = {}
    for k, span in enumerate(spans):
        for last in (False, True):
            if (k, last) in holders:
                continue
            ends = [(k, last)]
            for j, partner in enumerate(spans):
                met = meet(span, partner, meeting) if j != k else None
                if met is not None and met[0] == last:
                    ends.append((j, met[1]))
            edge = len(ends) == 1 and _cloud_ends(span, last, plan, config)
            outline = _outline([(spans[j], at) for j, at in ends], other, ground, config, edge)
            if outline is None:
                holders[k, last] = CLOUD_ENDS if edge else NOTHING_SEEN
                continue
            holders.update(dict.fromkeys(ends, len(found)))
            found.append(outline)
    return found, [(holders[k, False], holders[k, True]) for k in range(len(spans))]


def _axes(u: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2 2"]:
    """Unit vectors along and across as columns."""
    return np.array([[u[0], -u[1]], [u[1], u[0]]])


def _cloud_ends(span: TrackSpan, last: bool, plan: cKDTree, config: StructureConfig) -> bool:
    """Whether there are hardly any points beyond the ends of its tracks."""
    outward = span.u if last else -span.u
    ends = [track.points(np.array(track.ends))[:, :2] for track in span.tracks]
    outer = np.array([both[(both @ outward).argmax()] for both in ends])
    ahead = np.concatenate([outer + far * outward for far in config.ahead_m])
    return bool((plan.query(ahead)[0] > config.void_m).mean() > 0.5)


def _outline(
    ends: Sequence[tuple[TrackSpan, bool]], other: Float[np.ndarray, "k 3"], ground: Ground,
    config: StructureConfig, edge: bool,
) -> Outline | None:  # fmt: skip
    """What stands where spans end; where several do, something does even if no point shows it.

    edge: the cloud ends there, and wires may end with it: what is no whole structure may be a tree.
    """
    wires = np.concatenate([span.end(last) for span, last in ends])
    low, high = float(wires[:, 2].min()), float(wires[:, 2].max())
    place = np.mean([span.end(last)[:, :2].mean(0) for span, last in ends], axis=0)
    u = np.sum([span.u for span, _ in ends], axis=0)
    axes = _axes(u / np.linalg.norm(u))
    half = float(np.abs((wires[:, :2] - place) @ axes[:, 1]).max())
    flat = (other[:, :2] - place) @ axes
    near = (np.abs(flat) <= [config.around_m, half + config.beside_m]).all(1)
    upper = near & (other[:, 2] >= low - config.top_m)
    if upper.any():
        upper &= np.abs(flat[:, 0] - np.median(flat[upper, 0])) <= config.body_m
    seen = bool(upper.sum() >= config.min_points and other[upper, 2].max() >= high - config.top_m)
    middle = np.median(flat[upper], axis=0) if seen else np.zeros(2)
    xy = place + axes @ middle
    z = float(ground.below(xy[None])[0])
    if len(ends) == 1:
        around = (np.abs(flat - middle) <= [config.body_m, half + config.beside_m]).all(1)
        body = other[around, 2] - z
        metres = np.unique(body[(body >= config.body_from_m) & (body < low - z)].astype(int))
        share = config.edge_body_share if edge else config.min_body_share
        seen = seen and len(metres) >= share * (low - z - config.body_from_m)
        if edge:  # one wire alone is as wide as nothing, and tells no arms from twigs
            seen = seen and half > 0 and bool(np.ptp(flat[upper, 1]) >= config.edge_arms_share * 2 * half)
    if not seen and len(ends) == 1:
        return None
    top = float(other[upper, 2].max()) if seen else high
    return Outline(np.append(xy, z), top - z, axes[:, 0], half, low, seen)
