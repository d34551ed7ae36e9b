"""Strings of insulators, found between a wire's attachment and the arm that a cloud shows.

    suspension   the arm is straight above the clamp: points of the structure that spread as arms do, over
                 free space in which a string is thin
    strain       the wire ends apart on either side of an arm, and a string leads from each end to it

Letters: n points of structures; LineFrame, metres, z up.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree

from plnerf.line.cloud import CONNECTOR, TOWER
from plnerf.line.ends import Attached
from plnerf.line.line import Line
from plnerf.line.phases import InsulatorString, StringKind
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.survey.config_wires import KindsConfig
from plnerf.survey.kinds import through_spans

THIN_M, AROUND_M, LONGEST_M = 0.25, 0.8, 6.0
"""Half the width of a string; within what distance of its axis the arm shows; the longest string."""
LEAST_M, APART_M = 0.4, 0.6
"""The shortest suspension string; ends of one wire that are farther apart are held by strain strings."""
ARM_POINTS, LEVEL_M = 3, 0.2
"""Points, and half the height of the layer in which they lie, that show an arm."""
INTO_ARM_M = 0.15
"""Points so near to the arm are its own."""


def with_strings(survey: Survey, kinds: KindsConfig) -> Survey:
    """The survey with its strings, whose points are of the class of connectors (16)."""
    cloud = survey.cloud
    steel = np.flatnonzero(cloud.label == TOWER)
    if not len(steel) or survey.frame.unit != "m":
        return survey
    tree = cKDTree(cloud.xyz[steel])
    found, label = [], cloud.label.copy()
    for line in survey.lines:
        for structure, wires, kind, clamp, to in _wanted(line, kinds):
            arm = (
                _arm_above(cloud.xyz[steel[tree.query_ball_point(clamp, LONGEST_M)]], clamp)
                if to is None
                else (to if len(tree.query_ball_point(to, AROUND_M)) >= ARM_POINTS else None)
            )
            if arm is None:
                continue
            near = steel[tree.query_ball_point((clamp + arm) / 2, LONGEST_M / 2 + 1)]
            on = near[_on_segment(cloud.xyz[near], clamp, arm)]
            label[on] = CONNECTOR
            found.append(
                InsulatorString(structure, wires, kind, np.array([arm, clamp]), LEVEL_M, len(on))
            )
    return replace(survey, strings=tuple(found), cloud=replace(cloud, label=label))


_Wanted = tuple[int, tuple[int, ...], StringKind, Float[np.ndarray, "3"], Float[np.ndarray, "3"] | None]


def _wanted(line: Line, kinds: KindsConfig) -> Iterator[_Wanted]:
    """Of every place where wires are held: structure, wires, kind, clamp, and of strain strings the arm."""
    through = through_spans([span.wires for span in line.spans], kinds)
    held: dict[tuple[int, int], list[tuple[Wire, Attached]]] = {}
    for wire, group in zip(line.wires, through, strict=True):
        for end in wire.ends:
            if isinstance(end, Attached):
                held.setdefault((end.structure, int(group)), []).append((wire, end))
    for (structure, _), ends in held.items():
        points = np.array([end.point for _, end in ends])
        ids = tuple(wire.id for wire, _ in ends)
        if len(ends) == 2 and np.linalg.norm(points[0] - points[1]) > APART_M:
            for (wire, _), point in zip(ends, points, strict=True):
                yield structure, (wire.id,), "strain", point, points.mean(0)
        else:
            yield structure, ids, "suspension", points.mean(0), None


def _arm_above(
    steel: Float[np.ndarray, "n 3"], clamp: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3"] | None:
    """Where above the clamp the arm is: the lowest layer with points outside of the string as well; None
    where there is none, or it is at the clamp."""
    up = steel[:, 2] - clamp[2]
    off = np.linalg.norm(steel[:, :2] - clamp[:2], axis=1)
    arm = np.sort(up[(off > THIN_M) & (off <= AROUND_M) & (up > 0)])
    for low in arm:
        layer = (arm >= low) & (arm <= low + 2 * LEVEL_M)
        if layer.sum() >= ARM_POINTS:
            height = float(arm[layer].mean())
            if not LEAST_M <= height <= LONGEST_M:
                return None
            return clamp + np.array([0.0, 0.0, height])
    return None


def _on_segment(
    points: Float[np.ndarray, "n 3"], clamp: Float[np.ndarray, "3"], arm: Float[np.ndarray, "3"]
) -> Bool[np.ndarray, " n"]:
    """Which points lie on a string, and not at the arm."""
    along = arm - clamp
    length = float(np.linalg.norm(along))
    s = (points - clamp) @ along / length
    off = np.linalg.norm(points - clamp - s[:, None] * along / length, axis=1)
    on: Bool[np.ndarray, " n"] = (off <= THIN_M) & (s >= -INTO_ARM_M) & (s <= length - INTO_ARM_M)
    return on
