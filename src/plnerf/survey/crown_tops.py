"""Tops of plants near wires, above what stereo finds of them.

A crown's top is single leaves, past which stereo sees: of thin crowns up to 3 m are missing, and by as much
a plant below a wire is nearer than its points.  Above the highest point of each crown near a wire it is
therefore asked, a step at a time, whether the photos show something before what lies behind
(`stereo/before_backdrop.py`); as far as most of them do, the crown goes on.

Letters: n points, c of curves, h heights above a crown's highest point; LineFrame, metres, z up.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.stats import binom

from plnerf.findings import Finding, note
from plnerf.line.cloud import GROUND, HIGH_VEGETATION, LOW_VEGETATION, NO_WIRE, VEGETATION, Cloud
from plnerf.line.wire import Wire
from plnerf.survey.config import SurveyConfig
from plnerf.survey.config_crown_tops import CrownTopConfig
from plnerf.survey.obstacles import is_shown
from plnerf.survey.posed_photos import Photos
from plnerf.survey.single_objects import GroundHeights, dense_groups, members, separated
from plnerf.survey.stereo.before_backdrop import BESIDE, Backdrop, shown_on_axis
from plnerf.survey.stereo.stereo_views import picture, shows_wires, view_of
from plnerf.survey.stereo.witnesses import Sight

KEPT = 64
"""Photos that are held at a time."""
AT_ONCE = 4
"""Heights that are examined together: of most crowns no more are."""
TURNS = np.arange(8) * np.pi / 4
BUNCH = 0.15 * np.array([[0.0, 0.0, 0.0], *np.stack([np.cos(TURNS), np.sin(TURNS), 0 * TURNS], 1)])
"""Points at every height: so dense that how far apart points are adds little to what is not known."""


@dataclass(frozen=True, eq=False)
class _Top:
    """Points that continue a crown upwards."""

    highest: int
    """Index of the crown's highest point."""
    xyz: Float[np.ndarray, "n 3"]
    """From below upwards."""
    shown: Int[np.ndarray, " n"]
    """Photos that show something at the height of each."""
    past: Int[np.ndarray, " n"]
    """Photos that do not."""


def with_crown_tops(
    cloud: Cloud,
    photos: Photos,
    sights: Sequence[Sight],
    wires: Sequence[Wire],
    config: SurveyConfig,
) -> tuple[Cloud, tuple[Finding, ...]]:
    """The cloud with points at every step of the crowns' tops, of the class of the crown's highest point, and
    what a reader must know of them.  Lengths must be metres.

    cloud: with its witnesses.  sights: as `stereo_surface` keeps them.
    """
    if not wires or not sights or cloud.seen is None or cloud.past is None:
        return cloud, ()
    full, by_image = photos.full_size(), {one.image: one for one in sights}

    longest_px = config.crown_tops.longest_px

    @lru_cache(maxsize=KEPT)
    def backdrop(i: int) -> Backdrop:
        view = view_of(full, i, longest_px)
        grey, rgb = picture(full, i, view, longest_px)
        return Backdrop(view, rgb, grey.valid & ~shows_wires(view, wires, config.stereo), by_image[i])

    full = replace(full, train=tuple(i for i in full.train if i in by_image))
    curves = np.concatenate([wire.polyline() for wire in wires])
    found = []
    for crown in _crowns(cloud, curves, config):
        top = _top_of(crown, cloud, full, curves, backdrop, config.crown_tops)
        if top is not None:
            found.append(top)
    return _joined(cloud, found, config.crown_tops)


def _crowns(
    cloud: Cloud, curves: Float[np.ndarray, "c 3"], config: SurveyConfig
) -> list[Int[np.ndarray, " _"]]:
    """Indices of the points of each crown near a wire, in order along x, so that photos are read once."""
    grouping = config.encroachments
    plants = np.isin(cloud.label, (LOW_VEGETATION, VEGETATION, HIGH_VEGETATION)) & (cloud.wire == NO_WIRE)
    index = np.flatnonzero(plants & is_shown(cloud, config.clearance.obstacles))
    if not len(index):
        return []
    heights = GroundHeights.of(cloud.xyz[cloud.label == GROUND])
    xyz = cloud.xyz[index]
    above = xyz[:, 2] - heights.at(xyz[:, :2])
    above = np.where(np.isfinite(above), above, 0.0)
    number = separated(xyz, above, grouping)
    dense = dense_groups(xyz, number, heights.spacing_m, grouping)
    near = []
    for group in (group for group, one in zip(members(number), dense, strict=True) if one):
        top = group[xyz[group, 2].argmax()]
        away_m = float(np.hypot(*(curves[:, :2] - xyz[top, :2]).T).min())
        if away_m <= max(config.crown_tops.reach_m, above[top] + config.crown_tops.most_m):
            near.append(index[group])
    return sorted(near, key=lambda group: float(cloud.xyz[group, 0].mean()))


def _top_of(
    crown: Int[np.ndarray, " _"],
    cloud: Cloud,
    photos: Photos,
    curves: Float[np.ndarray, "c 3"],
    backdrop: Callable[[int], Backdrop],
    config: CrownTopConfig,
) -> _Top | None:
    """The points above a crown's highest point that photos show; None where they show none."""
    xyz = cloud.xyz[crown]
    highest = int(crown[xyz[:, 2].argmax()])
    z0 = float(cloud.xyz[highest, 2])
    x, y = np.median(xyz[xyz[:, 2] >= z0 - config.top_m][:, :2], axis=0)
    above = np.hypot(*(curves[:, :2] - [x, y]).T) <= config.top_m
    ceiling = float(curves[above, 2].min(initial=np.inf)) - config.below_wire_m
    z = np.arange(z0 + config.step_m, min(z0 + config.most_m, ceiling) + 1e-6, config.step_m)
    axis = np.stack([np.full(len(z), x), np.full(len(z), y), z], 1)
    if not len(z):
        return None
    apart = photos.distances(axis[:1])[:, 0]
    nearest = np.argsort(apart, kind="stable")[: config.photos]
    chosen = [photos.train[k] for k in nearest.tolist() if apart[k] <= config.farthest_m]
    counts, gap = np.zeros((2, 0), np.int64), round(config.gap_m / config.step_m)
    for first in range(0, len(axis), AT_ONCE):
        more = shown_on_axis(axis[first : first + AT_ONCE], chosen, backdrop, config.backdrop)
        counts = np.concatenate([counts, more], axis=1)
        goes_on = _is_shown(counts[0], counts[1], config)
        if not goes_on[-gap:].any():
            break
    h = _last(goes_on, gap)
    if h * config.step_m < config.least_m:
        return None
    xyz = (axis[:h, None] + BUNCH).reshape(-1, 3)
    shown, could = np.repeat(counts[:, :h], len(BUNCH), axis=1)
    return _Top(highest, xyz, shown, could - shown)


def _is_shown(
    shown: Int[np.ndarray, " h"], could: Int[np.ndarray, " h"], config: CrownTopConfig
) -> Bool[np.ndarray, " h"]:
    """At which heights more photos show something than chance explains."""
    chance = binom.sf(shown - 1, could, 1 / len(BESIDE))
    enough: Bool[np.ndarray, " h"] = (chance <= config.chance) & (shown >= config.least_share * could)
    return enough


def _last(goes_on: Bool[np.ndarray, " h"], gap: int) -> int:
    """Number of heights from the lowest to the last one before `gap` heights at which nothing is shown."""
    last = 0
    for k in np.flatnonzero(goes_on).tolist():
        if k - last >= gap:
            break
        last = k + 1
    return last


def _joined(cloud: Cloud, tops: Sequence[_Top], config: CrownTopConfig) -> tuple[Cloud, tuple[Finding, ...]]:
    if not tops or cloud.sigma_m is None or cloud.seen is None or cloud.past is None:
        return cloud, ()
    of = np.repeat([one.highest for one in tops], [len(one.xyz) for one in tops])
    made = replace(
        cloud,
        xyz=np.concatenate([cloud.xyz, *(one.xyz for one in tops)]),
        label=np.concatenate([cloud.label, cloud.label[of]]),
        wire=np.concatenate([cloud.wire, np.full(len(of), NO_WIRE)]),
        rgb=None if cloud.rgb is None else np.concatenate([cloud.rgb, cloud.rgb[of]]),
        sigma_m=np.concatenate([cloud.sigma_m, np.full(len(of), config.sigma_m)]),
        seen=np.concatenate([cloud.seen, *(one.shown for one in tops)]),
        past=np.concatenate([cloud.past, *(one.past for one in tops)]),
    )
    rise = [float(one.xyz[-1, 2] - cloud.xyz[one.highest, 2]) for one in tops]
    finding = note(
        "tops of plants",
        f"Of plants near wires {len(tops)} go on above their points, by {np.median(rise):.1f} m (median) to "
        f"{max(rise):.1f} m: stereo sees past such thin tops, but most photos show something before what "
        "lies behind. A column of points stands there.",
    )
    return made, (finding,)
