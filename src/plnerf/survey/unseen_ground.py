"""What is known of the ground where images did not see it, and of heights above it.

Where images show little of the ground, the lowest that they show may be the tops of plants; below plants it
may be their lowest leaves: such points are ground only where they continue the ground that was seen around.
A wire's least height above the ground is known only if it cannot be less over what was not seen.

Letters: n points, k stations along a wire; LineFrame, metres.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage
from scipy.spatial import cKDTree

from plnerf.findings import Finding, harms
from plnerf.line.clearances import SIGMAS, Clearances
from plnerf.line.cloud import (
    GROUND,
    HIGH_VEGETATION,
    LOW_VEGETATION,
    NO_WIRE,
    UNCLASSIFIED,
    VEGETATION,
)
from plnerf.line.coverage import Coverage
from plnerf.line.stations import Stretch, chains
from plnerf.line.survey import Survey
from plnerf.survey.config_ground import GroundConfig, GroundSectionConfig
from plnerf.survey.ground import find_ground

LEAVES = (LOW_VEGETATION, VEGETATION, HIGH_VEGETATION, UNCLASSIFIED)
"""Classes of what may be leaves of a plant."""
UNSEEN = "ground"
"""Kind of the findings."""


def without_unseen_ground(
    survey: Survey, coverage: Sequence[Coverage], config: GroundSectionConfig, filter_: GroundConfig
) -> tuple[Survey, tuple[Finding, ...]]:
    """A survey of images whose points count as unclassified, in place of ground, below plants, and below and
    beside stretches of which too little ground was seen, unless they continue what was seen; other surveys as
    they are.

    filter_: what finds the ground through points that are sure.
    """
    if not survey.from_images or survey.cloud.sigma_m is None:
        return survey, ()
    stretches = {
        (line.id, one.span.id): one for line in survey.lines for chain in chains(line) for one in chain
    }
    label = survey.cloud.label.copy()
    index = np.flatnonzero(label == GROUND)
    xyz = survey.cloud.xyz[index]
    sure, doubted = np.zeros(len(index), np.bool_), np.zeros(len(index), np.bool_)
    for one in coverage:
        of = _stretch_of(stretches[one.line, one.span], one, xyz, config.side_m)
        doubted |= (of >= 0) & one.no_ground[of]
        sure |= (of >= 0) & ~one.no_ground[of]
    doubted &= ~sure  # what another span's stretch shows well
    plants = survey.cloud.xyz[np.isin(survey.cloud.label, LEAVES) & (survey.cloud.wire == NO_WIRE)]
    doubted |= _below(plants, xyz, config.below_plants_m, filter_.cell_m)
    doubted[doubted] = ~_continues(xyz[~doubted], xyz[doubted], config, filter_)
    if not doubted.any():
        return survey, ()
    label[index[doubted]] = UNCLASSIFIED
    finding = harms(
        UNSEEN,
        f"{doubted.sum():,} points where too little ground was seen to distinguish it from plants are "
        "unclassified.",
        "See under Coverage, and take more images there.",
    )
    return replace(survey, cloud=replace(survey.cloud, label=label)), (finding,)


def _stretch_of(
    span: Stretch, coverage: Coverage, xyz: Float[np.ndarray, "n 3"], side_m: float
) -> Int[np.ndarray, " n"]:
    """Index of the stretch of a span that each point is below or beside; -1 of none.

    What lies beyond an end of the span, as near as what lies beside it, is of the stretch at that end.
    """
    ys = [span.base.local(wire.points(np.array([0.0, wire.base.length_m])))[:, 1] for wire in span.span.wires]
    local = span.base.local(xyz)
    station = span.from_m + local[:, 0]
    of = np.searchsorted(coverage.from_m, station, side="right") - 1
    beside = (local[:, 1] >= np.min(ys) - side_m) & (local[:, 1] <= np.max(ys) + side_m)
    beside &= (station >= coverage.from_m[0] - side_m) & (station <= coverage.to_m[-1] + side_m)
    return np.where(beside, np.maximum(of, 0), -1)


def _below(
    plants: Float[np.ndarray, "m 3"], points: Float[np.ndarray, "n 3"], by_m: float, cell_m: float
) -> Bool[np.ndarray, " n"]:
    """Which points have plants in their cell, or in one beside it, that are higher by more than so much."""
    if not len(plants):
        return np.zeros(len(points), np.bool_)
    corner = np.minimum(points.min(0, initial=np.inf), plants.min(0))[:2]
    cells, of = (((some[:, :2] - corner) // cell_m).astype(np.int64) for some in (plants, points))
    top = np.full(np.maximum(cells.max(0), of.max(0, initial=0)) + 1, -np.inf)
    np.maximum.at(top, tuple(cells.T), plants[:, 2])
    top = ndimage.maximum_filter(top, 3, mode="constant", cval=-np.inf)
    higher: Bool[np.ndarray, " n"] = top[tuple(of.T)] - points[:, 2] > by_m
    return higher


def _continues(
    sure: Float[np.ndarray, "n 3"],
    points: Float[np.ndarray, "m 3"],
    config: GroundSectionConfig,
    filter_: GroundConfig,
) -> Bool[np.ndarray, " m"]:
    """Which points are no further from the ground through those that are sure than the ground may rise or
    fall, `unseen_slope` by the metre from the nearest of these."""
    ground = find_ground(sure, filter_) if len(sure) and len(points) else None
    if ground is None:
        return np.zeros(len(points), np.bool_)
    away = cKDTree(sure[:, :2]).query(points[:, :2])[0]
    near: Bool[np.ndarray, " m"] = np.abs(ground.above(points)) <= filter_.near_m + config.unseen_slope * away
    return near


def may_be_less_m(
    s: Float[np.ndarray, " k"],
    height: Float[np.ndarray, " k"],
    points_z: Float[np.ndarray, " k"],
    config: GroundSectionConfig,
) -> float:
    """Length of a wire over which its height above the ground is not known (NaN) and may be less than the
    least that is known; 0 where none is.

    points_z: of the wire.  There the ground may be as high as at the nearest station where it is known, and
    `unseen_slope` higher by the metre, in two standard deviations.
    """
    known = np.isfinite(height)
    if not known.any():
        return 0.0
    nearest = np.abs(s[:, None] - s[known]).argmin(1)
    away = np.abs(s - s[known][nearest])
    ground = (points_z - height)[known][nearest] + SIGMAS * config.unseen_slope * away
    less = ~known & (points_z - ground < height[known].min())
    return float(less.sum() * (s[-1] - s[0]) / max(len(s) - 1, 1))


def about_unknown_heights(clearances: Clearances) -> list[Finding]:
    """Which wires have no least height above the ground, and why."""
    unknown = [one for one in clearances.wires if one.no_vertical is not None]
    if not unknown:
        return []
    parts = "; ".join(f"wire {one.wire}: {one.no_vertical}" for one in unknown)
    return [
        harms(
            UNSEEN,
            f"The least height above the ground is not stated of {len(unknown)} of {len(clearances.wires)} "
            f"wires ({parts}).",
            "Take images that show the ground there.",
        )
    ]
