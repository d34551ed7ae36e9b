"""Conductors, shields and supports in a point cloud that says nothing of classes.

    ground -> places on lines high above it -> tracks -> spans -> supports -> every wire -> classes

Letters: n points of the cloud, d distinct ones among them; metres, z up.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy.spatial import cKDTree

from plnerf.survey.ground import NEAR_M, Ground, find_ground, vegetation
from plnerf.survey.kinds import kinds
from plnerf.survey.lidar.checks import astray, check_cloud, distinct
from plnerf.survey.lidar.linear import Lines, lines
from plnerf.survey.lidar.spans import Span, spans
from plnerf.survey.lidar.towers import Held, Support, on_support, supports
from plnerf.survey.lidar.tracks import near, tracks
from plnerf.survey.lidar.wires import BOW_M, MISFIT_M, Wire, wires
from plnerf.survey.model import (
    CONDUCTOR,
    GROUND,
    NO_WIRE,
    SHIELD,
    TOWER,
    UNCLASSIFIED,
    Cloud,
    Conductor,
    Tower,
)

LEAST_ABOVE_M = 4.0
"""Wires hang higher above the ground; fences do not."""
LOW_M = 2.0
"""What is higher above the ground may be a support's, or beside a wire."""
STAGES = 5
STRAY_M, APART_M = 0.75, 1.0
"""Points so near to a wire are plants only if they are so near to plants that are farther away."""
EXPLAINED_M, MOST_UNEXPLAINED = 1.5, 0.15
"""A place on a line is explained by a wire's or support's point so near; more than this share that are not
are told."""


@dataclass(frozen=True, eq=False)
class Found:
    """What a cloud shows of a line."""

    conductors: tuple[Conductor, ...]
    towers: tuple[Tower, ...]
    cloud: Cloud
    """The points as they came, with their class and wire."""
    notes: tuple[str, ...]
    """What is missing or doubtful, in words."""


def find_conductors(
    xyz: Float[np.ndarray, "n 3"],
    least_above_m: float = LEAST_ABOVE_M,
    progress: Callable[[int, int], None] | None = None,
) -> Found:
    """Every wire of a cloud in metres with z up, span by span along the line, and the supports.

    Neither the order of the points nor how often each occurs has any influence.  What is neither ground, wire
    nor support is vegetation by its height: buildings are not told from it.  Without wires the result holds
    none, and a note.  Raises SurveyError for clouds that are empty, not finite, all at one place, or in
    degrees.
    """
    check_cloud(xyz)
    points, which = distinct(xyz)
    kept = ~astray(points)
    told = progress or (lambda done, of: None)
    conductors, towers, cloud, notes = _found(points[kept], least_above_m, told)
    if not kept.all():
        far = f"{(~kept[which]).sum()} points lie far away from the others in plan and are left out."
        notes = (far, *notes)
    label = np.full(len(points), UNCLASSIFIED, np.uint8)
    wire = np.full(len(points), NO_WIRE, np.int64)
    label[kept], wire[kept] = cloud.label, cloud.wire
    return Found(conductors, towers, Cloud(xyz, label[which], wire[which]), notes)


def _found(
    points: Float[np.ndarray, "d 3"], least_above_m: float, told: Callable[[int, int], None]
) -> tuple[tuple[Conductor, ...], tuple[Tower, ...], Cloud, tuple[str, ...]]:
    """`find_conductors` of distinct points."""
    notes = []
    told(0, STAGES)
    ground = find_ground(points)
    seen = ground is not None
    if ground is None:
        ground = Ground(points[0, :2], 1.0, np.array([[points[:, 2].min()]]))
        notes.append(
            "The cloud shows no ground: wires are looked for among all points, heights of towers count from "
            "the lowest point, and nothing is classified as ground or vegetation."
        )
    above = ground.above(points)
    told(1, STAGES)
    high = np.flatnonzero(above >= least_above_m) if seen else np.arange(len(points))
    found = lines(points[high])
    told(2, STAGES)
    line = spans(tracks(found), found)
    told(3, STAGES)
    tall = np.flatnonzero(above >= LOW_M) if seen else high
    rest = tall[~_on_tracks(line, points[tall])]
    stands, held = supports(line, points, points[rest], ground)
    bodies = [tall[on_support(support, points[tall])] for support in stands]
    body = np.isin(tall, np.concatenate([*bodies, []]))
    all_wires = wires(line, stands, held, points[tall], body)
    holding = sorted({k for wire in all_wires for k in held[wire.span].by if k is not None})
    told(4, STAGES)
    conductors, label, wire = _named(all_wires, held, points, tall)
    for k in holding:
        label[bodies[k][label[bodies[k]] == UNCLASSIFIED]] = TOWER
    if seen:
        label[(label == UNCLASSIFIED) & (np.abs(above) <= NEAR_M)] = GROUND
        plants = np.flatnonzero((label == UNCLASSIFIED) & (above > NEAR_M))
        plants = plants[~_stray(points[plants], points[wire != NO_WIRE], conductors)]
        label[plants] = vegetation(above[plants])
    notes += _notes(conductors, [stands[k] for k in holding], len(high), least_above_m, seen)
    if conductors:
        notes += _unexplained(found, points[(label == TOWER) | (wire != NO_WIRE)])
    told(STAGES, STAGES)
    towers = tuple(stands[k].tower for k in holding)
    return tuple(conductors), towers, Cloud(points, label, wire), tuple(notes)


def _stray(
    plants: Float[np.ndarray, "k 3"], on_wires: Float[np.ndarray, "m 3"], conductors: Sequence[Conductor]
) -> Bool[np.ndarray, " k"]:
    """Which points beside wires have nothing but the wire near them: noise, spacers, dampers, no plants.

    As plants they would break every clearance.
    """
    if not conductors or not len(plants):
        return np.zeros(len(plants), np.bool_)
    curves = np.concatenate([on_wires, *(c.fit.curve.polyline(STRAY_M / 2) for c in conductors)])
    beside = cKDTree(curves).query(plants, distance_upper_bound=STRAY_M)[0] <= STRAY_M
    beside[beside] = cKDTree(plants[~beside]).query(plants[beside])[0] > APART_M if (~beside).any() else True
    return beside


def _on_tracks(line: Sequence[Span], points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    on = np.zeros(len(points), np.bool_)
    for track in (track for span in line for track in span.tracks):
        on |= near(track, points)
    return on


def _named(
    all_wires: Sequence[Wire], held: Sequence[Held],
    points: Float[np.ndarray, "d 3"], tall: Int[np.ndarray, " k"],
) -> tuple[list[Conductor], UInt8[np.ndarray, " d"], Int[np.ndarray, " d"]]:  # fmt: skip
    """Wires as conductors, numbered from 1 in spans numbered from 0, and the points' classes and wires."""
    label = np.full(len(points), UNCLASSIFIED, np.uint8)
    of_wire = np.full(len(points), NO_WIRE, np.int64)
    conductors: list[Conductor] = []
    used = sorted({wire.span for wire in all_wires})
    for number, span in enumerate(used):
        mine = [wire for wire in all_wires if wire.span == span]
        for wire, kind in zip(mine, kinds([w.fit for w in mine], [len(w.points) for w in mine]), strict=True):
            name = len(conductors) + 1
            its = tall[wire.points]
            label[its] = SHIELD if kind == "shield" else CONDUCTOR
            of_wire[its] = name
            conductors.append(
                Conductor(
                    id=name,
                    span=number,
                    kind=kind,
                    fit=wire.fit,
                    coverage=wire.coverage,
                    longest_gap_m=wire.longest_gap_m,
                    evidence=len(its),
                    source=f"{len(its):,} points",
                    note=_note(wire, held[span]),
                )
            )
    return conductors, label, of_wire


def _note(wire: Wire, hold: Held) -> str | None:
    said = []
    for name, seen, cut in zip(("first", "last"), wire.seen, hold.cut, strict=True):
        if not seen and cut:
            said.append(f"The cloud ends at its {name} end: its support there is not seen.")
        elif not seen:
            said.append(f"No support is seen at its {name} end: it may go on.")
    if wire.bow_m >= BOW_M:
        said.append(f"It bows {wire.bow_m:.2f} m sideways, by wind perhaps; its curve is upright.")
    if wire.misfit_m >= MISFIT_M:
        said.append(f"It departs {wire.misfit_m:.2f} m from one catenary: something may hold it in between.")
    return " ".join(said) or None


def _notes(
    conductors: Sequence[Conductor], stands: Sequence[Support], high: int, least_above_m: float, ground: bool
) -> list[str]:
    notes = []
    if not conductors:
        where = f"more than {least_above_m:g} m above the ground" if ground else "in the cloud"
        notes.append(
            f"No wires were found: of {high} points {where}, none make hanging lines of 30 m or more. A line "
            "that is there may be too sparse: a wire needs a point every few metres."
        )
        return notes
    unseen = [support for support in stands if not support.seen]
    if unseen:
        notes.append(
            f"The cloud shows {len(unseen)} of {len(stands)} towers by nothing but the wires that meet "
            "there: they are as high as their highest wire."
        )
    return notes


def _unexplained(found: Lines, own: Float[np.ndarray, "k 3"]) -> list[str]:
    """What is said of lines that became no wire."""
    left = int((cKDTree(own).query(found.at)[0] > EXPLAINED_M).sum())
    if left <= MOST_UNEXPLAINED * len(found.at):
        return []
    return [
        f"{left} of {len(found.at)} places that lie on lines belong to no wire found: there are wires that "
        "are too short, too slack or too tangled for catenaries between supports, or other things that are "
        "long and thin."
    ]
