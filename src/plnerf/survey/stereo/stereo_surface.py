"""The surfaces of a survey: what stereo measures; of wires, which stereo smears, what a trained field shows.

A field trained for minutes is decimetres to metres off where its images, with their poses, fix points to
centimetres or decimetres, so that none of its other points is kept: most would lie before or behind what
stereo measures.

Letters: n points, m views, h x w pixels.  LineFrame.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from plnerf.findings import Finding, harms
from plnerf.line.wire import Wire
from plnerf.survey.posed_photos import Photos, box_around
from plnerf.survey.stereo.config import StereoConfig
from plnerf.survey.stereo.consistency import consistent
from plnerf.survey.stereo.depth import DepthMap
from plnerf.survey.stereo.depth_maps import depth_maps
from plnerf.survey.stereo.distances import distances_by_matching, distances_of_points
from plnerf.survey.stereo.partners import joined_partners, partners
from plnerf.survey.stereo.stereo_views import Picture, View, picture, shows_wires, view_of
from plnerf.survey.stereo.witnesses import Sight
from plnerf.survey.surface import Surface, joined


def stereo_surface(
    photos: Photos,
    wires: Sequence[Wire],
    field: Surface | None,
    config: StereoConfig,
    progress: Callable[[int, int], None] | None = None,
    keep: Callable[[Sight], None] | None = None,
) -> tuple[Surface, tuple[Finding, ...]]:
    """Points of stereo at those of `config.points` pixels, drawn evenly from the training images, that have a
    depth, and the field's points on the wires.

    Without a field the images alone decide, and wires get no points; so they do of how far away things are
    where a field, trained too little, shows it in too few views.  Where the images make no stereo, all of the
    field, or nothing, with a finding.

    keep: takes every image's depth map, by which points can be judged.
    """
    photos = replace(photos, box=box_around(photos.box, wires))  # cameras may fly high above what they show
    views = [view_of(photos, i, config.longest_px) for i in photos.train]
    by_field = None if field is None else distances_of_points(views, field.xyz, config)
    if by_field is not None and np.isfinite(by_field).all(1).mean() < config.min_views_share:
        by_field = None
    rounds = 1 if by_field is not None else 2

    def report(done: int, of: int) -> None:
        if progress is not None:
            progress(done, of)

    distances = (
        by_field
        if by_field is not None
        else distances_by_matching(photos, wires, config, lambda done, of: report(done, rounds * of))
    )
    chosen, about = _chosen(views, distances, config), list[Finding]()
    if _paired(chosen) < config.pairs.least_paired * len(views):
        wide = replace(config, pairs=replace(config.pairs, max_baseline=config.pairs.wide_baseline))
        farther = by_field if by_field is not None else distances_by_matching(photos, wires, wide)
        others = _chosen(views, farther, wide)
        if _paired(others) > _paired(chosen):
            distances, chosen = farther, others
            about = [_far_apart(_paired(others), config)]
    random = np.random.default_rng(0)
    each = max(1, config.points // min(max(1, len(views)), config.most_sharing))
    parts, images, radii = [], [], []

    def of_view(k: int) -> Picture:
        return picture(photos, photos.train[k], views[k], config.longest_px)[0]

    def without_wires(k: int, depths: DepthMap) -> DepthMap:
        depths.t[shows_wires(views[k], wires, config)] = np.nan
        return depths

    near = [dict.fromkeys(mine, float(own[-1])) for mine, own in zip(chosen, distances, strict=True)]
    for done, (k, depths) in enumerate(depth_maps(near, of_view, without_wires, config.match), 1):
        if depths is not None:
            view = views[k]
            if keep is not None:
                keep(Sight.of(view, depths, photos.train[k]))
            _, rgb = picture(photos, photos.train[k], view, config.longest_px)
            at = _pixels(depths, each, random)
            t, sigma = depths.t[at], depths.sigma[at]
            rays = view.directions(np.stack(at[::-1], -1) + 0.5)
            pixel = t / float(view.focal_px.mean())
            sigma_m = np.hypot(sigma, config.edge_px * pixel)
            parts.append(Surface(view.centre + t[:, None] * rays, rgb[at], sigma_m, rays))
            images.append(np.full(len(t), k))
            # The distance within which another image would have so many points of the same thing.
            apart = np.sqrt(config.consistency.expected_points * depths.t.size / (np.pi * each))
            radii.append(sigma + apart * pixel)
        report(len(views) * (rounds - 1) + done, len(views) * rounds)
    met = joined(parts)
    if len(met.xyz) < config.min_share * each * len(views):
        pairs = f"{_paired(chosen)} of {len(views)}"
        return (Surface.empty() if field is None else field), (_no_stereo(pairs, field is not None),)
    kept = photos.within(met.xyz, config.farthest)
    kept &= consistent(met.xyz, np.concatenate(images), np.concatenate(radii), config.consistency)
    of_field = [] if field is None else [field.chosen(_on_wires(field.xyz, wires))]
    return joined([met.chosen(kept), *of_field]), tuple(about)


def _chosen(
    views: Sequence[View], distances: Float[np.ndarray, "m q"], config: StereoConfig
) -> list[tuple[int, ...]]:
    """Each view's partners: near things need images that are near to one another, far things others."""
    return joined_partners(*(partners(views, distance, config.pairs) for distance in distances.T))


def _paired(chosen: Sequence[tuple[int, ...]]) -> int:
    """How many views have two partners, which a depth needs."""
    return sum(len(others) > 1 for others in chosen)


def inflate_sigma(
    surface: Surface, sights: Sequence[Sight], residual_px: float, config: StereoConfig
) -> tuple[Surface, list[Sight]]:
    """The same points and depths, less certain: both images of a pair lie `residual_px` off their poses."""
    factor = np.hypot(1.0, np.sqrt(2) * residual_px / config.match.sigma_px)
    looser = [replace(one, sigma=one.sigma * np.float32(factor)) for one in sights]
    return replace(surface, sigma_m=surface.sigma_m * factor), looser


def _no_stereo(pairs: str, has_field: bool) -> Finding:
    left = (
        "ground and plants are the field's alone, which may be metres off."
        if has_field
        else "neither ground nor plants are measured."
    )
    what = f"The images make no stereo ({pairs} have two partners that look the same way from beside them): "
    return harms("stereo", what + left, "Take images side by side that overlap by two thirds.")


def _far_apart(paired: int, config: StereoConfig) -> Finding:
    pairs = config.pairs
    return harms(
        "stereo",
        f"Most images are farther apart than {pairs.max_baseline:.0%} of the distance to what they show. "
        f"With {pairs.wide_baseline:.0%} allowed {paired} have two partners, but of what stands up little is "
        "matched.",
        "Take images that overlap by three quarters.",
    )


def _on_wires(points: Float[np.ndarray, "n 3"], wires: Sequence[Wire]) -> Bool[np.ndarray, " n"]:
    """Which points lie between a wire's ends, within its `evidence.reach_m` of its curve."""
    on = np.zeros(len(points), np.bool_)
    for wire in wires:
        if wire.evidence.reach_m is None:  # it comes from points, not from images
            continue
        local = wire.base.local(points)
        beside = np.flatnonzero((local[:, 0] >= 0) & (local[:, 0] <= wire.base.length_m))
        off = local[beside, 1:] - wire.at(local[beside, 0])
        on[beside] |= np.linalg.norm(off, axis=1) <= wire.evidence.reach_m
    return on


def _pixels(
    depths: DepthMap, each: int, random: np.random.Generator
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Rows and columns of those of `each` pixels of the image, drawn at random, that have a depth."""
    drawn = random.choice(depths.t.size, min(each, depths.t.size), replace=False)
    row, column = np.divmod(np.sort(drawn), depths.t.shape[1])
    use = np.isfinite(depths.t[row, column])
    return row[use], column[use]
