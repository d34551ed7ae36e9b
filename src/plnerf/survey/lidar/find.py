"""Finds lines in a point cloud without using its classes: structures, spans, wires, and a class per point.

    ground -> places on lines high above it -> tracks -> spans -> structures -> every wire -> lines -> classes

Letters: n points of the cloud, d distinct ones among them; LineFrame: metres, z up.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8
from scipy.spatial import cKDTree

from plnerf.findings import Finding, harms, note
from plnerf.line.cloud import CONDUCTOR, GROUND, NO_WIRE, TOWER, UNCLASSIFIED, Cloud
from plnerf.line.line import Line
from plnerf.survey.ground import Ground, find_ground
from plnerf.survey.lidar.assemble import assemble
from plnerf.survey.lidar.candidates import find_wires
from plnerf.survey.lidar.checks import astray, check_cloud, distinct
from plnerf.survey.lidar.classes import wires_and_structures, with_given, with_ground
from plnerf.survey.lidar.config import LidarConfig
from plnerf.survey.lidar.linear import Linear, find_linear
from plnerf.survey.lidar.loose_wires import loose_wires
from plnerf.survey.lidar.spans import TrackSpan, find_spans
from plnerf.survey.lidar.structures import find_structures
from plnerf.survey.lidar.stubs import about_stubs, without_stubs
from plnerf.survey.lidar.tracks import find_tracks

NOISE_CLASSES = (7, 18)
"""Low and high noise."""
STAGES = 5
"""Of the progress: ground, places on lines, spans, wires, classes."""


@dataclass(frozen=True, eq=False)
class Found:
    """What a cloud shows of lines."""

    lines: tuple[Line, ...]
    cloud: Cloud
    """The points in the order in which they came, each with its class and wire."""
    findings: tuple[Finding, ...]
    """What is missing or doubtful."""


def find_lines(
    xyz: Float[np.ndarray, "n 3"],
    config: LidarConfig,
    progress: Callable[[int, int], None] | None = None,
    given: UInt8[np.ndarray, " n"] | None = None,
) -> Found:
    """Every line of a cloud, with all its wires.

    xyz: LineFrame coordinates.  Neither their order nor how often each occurs has any influence.  given: the
    points' classes, of which noise takes no part, ground is the ground, and all count for what is neither
    wire nor structure; None: they are not known.  What is neither ground, wire nor structure is then a
    building, vegetation or unclassified by its shape (`things.py`).  A cloud
    without wires gives no lines and a finding.  Raises SurveyError for clouds that are empty, not finite, all
    at one place, or in degrees.
    """
    check_cloud(xyz, config.cloud)
    points, which = distinct(xyz)
    kept = ~astray(points, config.cloud)
    stated = None
    if given is not None:
        stated = np.zeros(len(points), np.uint8)
        np.maximum.at(stated, which, given)  # of several points at one place, whatever their order
        noise = np.isin(stated, NOISE_CLASSES)
        kept &= ~noise
    found = _found(points[kept], config, progress or (lambda done, total: None), _some(stated, kept))
    findings = found.findings
    astray_only = ~kept if stated is None else ~kept & ~np.isin(stated, NOISE_CLASSES)
    if astray_only.any():
        far = f"{astray_only[which].sum()} points lie far away from the others in plan and are left out."
        findings = (note("points astray", far), *findings)
    label = np.full(len(points), UNCLASSIFIED, np.uint8)
    wire = np.full(len(points), NO_WIRE, np.int64)
    label[kept], wire[kept] = found.cloud.label, found.cloud.wire
    if stated is not None:
        label[~kept] = np.where(stated[~kept] > UNCLASSIFIED, stated[~kept], UNCLASSIFIED)
    return Found(found.lines, Cloud(xyz, label[which], wire[which]), findings)


def _found(
    points: Float[np.ndarray, "d 3"], config: LidarConfig, progress: Callable[[int, int], None],
    given: UInt8[np.ndarray, " d"] | None,
) -> Found:  # fmt: skip
    """`find_lines` of distinct points."""
    findings: list[Finding] = []
    progress(0, STAGES)
    ground = None
    if given is not None and (given == GROUND).any():
        ground = find_ground(points[given == GROUND], config.ground)
    ground = ground or find_ground(points, config.ground)
    seen = ground is not None
    if ground is None:
        ground = Ground(points[0, :2], 1.0, np.array([[points[:, 2].min()]]))
        findings.append(_no_ground())
    above = ground.above(points)
    progress(1, STAGES)
    high = np.flatnonzero(above >= config.min_height_m) if seen else np.arange(len(points))
    linear = find_linear(points[high], config.linear)
    progress(2, STAGES)
    spans = find_spans(find_tracks(linear, config), linear, config)
    progress(3, STAGES)
    tall = np.flatnonzero(above >= config.low_m) if seen else high
    rest = tall[~_on_tracks(spans, points[tall], config.track.beyond_m)]
    outlines, holders = find_structures(spans, points, points[rest], ground, config.structure, config.span)
    bodies = [tall[outline.own(points[tall], config.structure)] for outline in outlines]
    taken = np.isin(tall, np.concatenate([*bodies, []]))
    candidates = find_wires(spans, outlines, holders, points[tall], taken, config)
    candidates, stubs = without_stubs(candidates, holders, config.span.min_open_m)
    made = assemble(spans, outlines, holders, candidates, [len(body) for body in bodies], config)
    progress(4, STAGES)
    wires = [wire for line in made.lines for wire in line.wires]
    of_wire = {number: tall[its] for number, its in made.points.items()}
    held = [outlines[k] for k in made.outlines.values()]
    free = tall[~taken]
    beyond = free[loose_wires(points[free], linear, held, wires, config)]
    loose = np.concatenate([*(tall[one.points] for one in stubs), beyond]).astype(np.int64)
    cloud = wires_and_structures(points, wires, of_wire, [bodies[k] for k in made.outlines.values()], loose)
    if seen:
        cloud = with_ground(cloud, ground, wires, linear, config)
    if given is not None:
        cloud = with_given(cloud, given)
    if wires:
        inferred = [number for number, k in made.outlines.items() if not outlines[k].seen]
        findings += _inferred(inferred, len(made.outlines))
        findings += about_stubs(stubs, config.span.min_open_m)
        own = points[(cloud.label == TOWER) | (cloud.label == CONDUCTOR) | (cloud.wire != NO_WIRE)]
        findings += _unexplained(linear, own, config)
    else:
        findings.append(_no_wires(len(high), seen, config))
    progress(STAGES, STAGES)
    return Found(made.lines, cloud, tuple(findings))


def _some(given: UInt8[np.ndarray, " d"] | None, kept: Bool[np.ndarray, " d"]) -> np.ndarray | None:
    return None if given is None else given[kept]


def _on_tracks(
    spans: Sequence[TrackSpan], points: Float[np.ndarray, "n 3"], beyond_m: float
) -> Bool[np.ndarray, " n"]:
    on = np.zeros(len(points), np.bool_)
    for track in (track for span in spans for track in span.tracks):
        on |= track.near(points, beyond_m)
    return on


def _no_ground() -> Finding:
    return harms(
        "ground",
        "The cloud shows no ground: wires are sought among all points, heights of structures count from the "
        "lowest point, and nothing is classified as ground or vegetation.",
    )


def _no_wires(high: int, ground: bool, config: LidarConfig) -> Finding:
    where = f"more than {config.min_height_m:g} m above the ground" if ground else "in the cloud"
    if not high:
        return harms(
            "no wires",
            f"No wires were found: the cloud shows nothing {where}.",
            "Give the whole cloud, not its ground alone.",
        )
    return harms(
        "no wires",
        f"No wires were found: of {high} points {where}, none form hanging lines of "
        f"{config.span.min_length_m:g} m or more.",
        "A line that is there may be too sparse: a wire needs a point every few metres.",
    )


def _inferred(structures: Sequence[int], count: int) -> list[Finding]:
    """That structures are inferred from the wires that meet there; nothing where all are seen."""
    if not structures:
        return []
    what = (
        f"The cloud shows {len(structures)} of {count} structures by nothing but the wires that meet there: "
        "they are taken to be as high as their highest wire."
    )
    return [Finding("structures", "note", what, where=tuple(f"structure {one}" for one in structures))]


def _unexplained(linear: Linear, own: Float[np.ndarray, "k 3"], config: LidarConfig) -> list[Finding]:
    """That much lies on lines that became no wire; nothing where little does."""
    left = int((cKDTree(own).query(linear.at)[0] > config.explained_m).sum())
    if left <= config.max_unexplained_share * len(linear.at):
        return []
    return [
        note(
            "places on lines",
            f"{left} of {len(linear.at)} places that lie on lines belong to no wire found: there are wires "
            "that are too short, too slack or too tangled for catenaries between structures, or other things "
            "that are long and thin.",
        )
    ]
