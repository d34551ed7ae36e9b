"""How much of the ground and of the air around each span was seen, so that "nothing found" is told from
"nothing seen".

The corridor of a span, its wires' with a margin on both sides, is divided into columns.  A column's ground is
seen if the cloud has a point in it; its air, from there up to the highest wire, is seen where enough images
have a depth at a place or beyond it: a silent image, such as one of a bare surface without texture, shows
neither that there is something nor that there is nothing.

Letters: c columns, n places; s along the span, y to its left; LineFrame, metres.
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from plnerf.findings import Finding, harms
from plnerf.line.cloud import CONDUCTOR, CONNECTOR, LOW_NOISE, NO_WIRE, NOISE, SHIELD, TOWER
from plnerf.line.coverage import Coverage
from plnerf.line.stations import Stretch, chains
from plnerf.line.survey import Survey
from plnerf.survey.config_ground import CoverageConfig
from plnerf.survey.stereo.witnesses import Sight, witnesses

COVERAGE = "coverage"
"""Kind of the finding."""
WIRE_PLACES = 61
"""Places between which a wire's curve is straight enough for columns metres wide."""
_NOT_BELOW = (SHIELD, CONDUCTOR, TOWER, CONNECTOR, NOISE, LOW_NOISE)


def coverage_of(survey: Survey, sights: Sequence[Sight], config: CoverageConfig) -> tuple[Coverage, ...]:
    """Of every span that has wires; nothing without scale.  sights: none of clouds, whose air is not
    judged."""
    if survey.frame.unit != "m":
        return ()
    cloud = survey.cloud
    use = (cloud.wire == NO_WIRE) & ~np.isin(cloud.label, _NOT_BELOW)
    if cloud.sigma_m is not None:
        use &= cloud.sigma_m <= config.max_sigma_m
    points = cloud.xyz[use]
    return tuple(
        _of_span(line.id, stretch, points, sights, config)
        for line in survey.lines
        for chain in chains(line)
        for stretch in chain
    )


def _of_span(
    line: int,
    stretch: Stretch,
    points: Float[np.ndarray, "n 3"],
    sights: Sequence[Sight],
    config: CoverageConfig,
) -> Coverage:
    length = stretch.base.length_m
    count = max(1, round(length / config.stretch_m))
    place, lowest, highest = _columns(stretch, config)
    of = np.minimum((place[:, 0] / length * count).astype(np.int64), count - 1)
    top, known = _below(stretch, place, points, lowest, config)
    edges = stretch.from_m + np.linspace(0.0, length, count + 1)
    ground = np.bincount(of, known, count) / np.maximum(np.bincount(of, minlength=count), 1)
    air, images = np.full(count, np.nan), np.full(count, np.nan)
    if sights:
        air, images = _air(stretch, place, of, (top, highest), sights, config)
    return Coverage(
        line, stretch.span.id, edges[:-1], edges[1:], ground, air, images, config.least_share
    )  # fmt: skip


def _columns(
    stretch: Stretch, config: CoverageConfig
) -> tuple[Float[np.ndarray, "c 2"], Float[np.ndarray, " c"], Float[np.ndarray, " c"]]:
    """s and y of the corridor's columns, and the heights of the lowest and the highest wire there."""
    step, rows = config.step_m, math.ceil(stretch.base.length_m / config.step_m)
    s = (np.arange(rows) + 0.5) / rows * stretch.base.length_m
    y, z = [], []
    for wire in stretch.span.wires:
        curve = stretch.base.local(wire.points(np.linspace(0, wire.base.length_m, WIRE_PLACES)))
        curve = curve[np.argsort(curve[:, 0])]
        y.append(np.interp(s, curve[:, 0], curve[:, 1]))
        z.append(np.interp(s, curve[:, 0], curve[:, 2]))
    columns = []
    for at, left, right, low, high in zip(
        s, np.min(y, axis=0), np.max(y, axis=0), np.min(z, axis=0), np.max(z, axis=0), strict=True
    ):
        wide = right - left + 2 * config.side_m
        middles = left - config.side_m + np.linspace(step / 2, wide - step / 2, max(1, round(wide / step)))
        columns += [(at, across, low, high) for across in middles]
    found = np.array(columns)
    return found[:, :2], found[:, 2], found[:, 3]


def _below(
    stretch: Stretch,
    place: Float[np.ndarray, "c 2"],
    points: Float[np.ndarray, "n 3"],
    lowest_wire: Float[np.ndarray, " c"],
    config: CoverageConfig,
) -> tuple[Float[np.ndarray, " c"], Bool[np.ndarray, " c"]]:
    """Height of the highest point in each column below the wires, elsewhere of the nearest column that has
    one; and which columns have one."""
    local = stretch.base.local(points)
    reach = config.step_m / 2
    inside = (local[:, 0] >= -reach) & (local[:, 0] <= stretch.base.length_m + reach)
    local = local[inside]
    top = np.full(len(place), -np.inf)
    if len(local):
        apart, nearest = cKDTree(place).query(local[:, :2])
        within = (apart <= reach * math.sqrt(2)) & (local[:, 2] < lowest_wire[nearest])
        np.maximum.at(top, nearest[within], local[within, 2])
    known = np.isfinite(top)
    if not known.any():
        return lowest_wire - config.unknown_drop_m, known
    filled = top[known][cKDTree(place[known]).query(place)[1]]
    return np.where(known, top, np.minimum(filled, lowest_wire)), known


def _air(
    stretch: Stretch,
    place: Float[np.ndarray, "c 2"],
    of: Int[np.ndarray, " c"],
    heights: tuple[Float[np.ndarray, " c"], Float[np.ndarray, " c"]],
    sights: Sequence[Sight],
    config: CoverageConfig,
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """By stretch, the share of the places in the air that enough images see, and how many do, the median."""
    rows, piece = [], []
    for (s, y), k, low, high in zip(place, of, *heights, strict=True):
        z = np.arange(low + config.step_m / 2, max(high, low + config.step_m), config.step_m)
        rows.append(np.stack([np.full(len(z), s), np.full(len(z), y), z], 1))
        piece.append(np.full(len(z), k))
    local, k = np.concatenate(rows), np.concatenate(piece)
    at = stretch.base.place(local[:, 0], local[:, 1:])
    seen, past = witnesses(at, np.zeros(len(at)), sights, config.witnesses)
    enough, count = seen + past >= config.min_images, int(of.max()) + 1
    air = np.bincount(k, enough, count) / np.maximum(np.bincount(k, minlength=count), 1)
    images = np.array([float(np.median((seen + past)[k == one])) for one in range(count)])
    return air, images


def about_coverage(found: Sequence[Coverage], *, several_lines: bool) -> list[Finding]:
    """What a reader must know of stretches that were not seen; nothing where all was."""
    silent = [one for one in found if one.silent]
    if not silent:
        return []
    parts = [
        (f"line {one.line}, " if several_lines else "")
        + f"span {one.span}: {one.silent_m:.0f} m of {one.length_m:.0f} m, at "
        + ", ".join(f"{begin:.0f} to {end:.0f} m" for begin, end in one.silent)
        for one in silent
    ]
    return [
        harms(
            COVERAGE,
            "Stretches of which too little ground or air was seen, by stations along the line ("
            + "; ".join(parts)
            + "): where nothing is found there, something may be, and clearances are of what was seen.",
            "See under Coverage, and take more images there.",
        )
    ]
