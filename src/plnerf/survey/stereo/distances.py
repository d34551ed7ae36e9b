"""How far away the things are that each view shows: what its partners and its search range depend on.

A trained field gives these distances; without one, reduced images are matched first, with partners for every
distance that may occur.

Letters: m views, n points, q quantiles of distances, the farthest first.  LineFrame.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from plnerf.line.wire import Wire
from plnerf.survey.posed_photos import Photos
from plnerf.survey.stereo.config import StereoConfig
from plnerf.survey.stereo.depth import DepthMap
from plnerf.survey.stereo.depth_maps import depth_maps
from plnerf.survey.stereo.partners import partners
from plnerf.survey.stereo.stereo_views import View, picture, shows_wires, view_of


def distances_of_points(
    views: Sequence[View], points: Float[np.ndarray, "n 3"], config: StereoConfig
) -> Float[np.ndarray, "m q"]:
    """Quantiles of the distances of the points that each view has in its image; NaN where they are fewer than
    `min_seen`."""
    found = np.full((len(views), len(config.quantiles)), np.nan)
    for k, view in enumerate(views):
        _, inside = view.project(points)
        if inside.sum() >= config.min_seen:
            apart = np.linalg.norm(points[inside] - view.centre, axis=1)
            found[k] = np.quantile(apart, config.quantiles)
    return found


def distances_by_matching(
    photos: Photos,
    wires: Sequence[Wire],
    config: StereoConfig,
    progress: Callable[[int, int], None] | None = None,
) -> Float[np.ndarray, "m q"]:
    """Quantiles of the distances of what each training image shows, by matching the images at reduced size.

    Images in which fewer than `min_share` of the pixels get a depth take the distances of the nearest view
    that has some; NaN where there is none.
    """
    views = [view_of(photos, i, config.coarse.longest_px) for i in photos.train]
    pictures = [
        picture(photos, i, view, config.coarse.longest_px)[0]
        for i, view in zip(photos.train, views, strict=True)
    ]
    near: list[dict[int, float]] = [{} for _ in views]
    for distance in tried_distances(photos, config):  # the nearest comes last and rules the search range
        for mine, others in zip(
            near, partners(views, np.full(len(views), distance), config.pairs), strict=True
        ):
            mine.update(dict.fromkeys(others, distance))

    def quantiles(k: int, depths: DepthMap) -> Float[np.ndarray, " q"] | None:
        """The quantiles of view k; None where too little of it is matched."""
        depths.t[shows_wires(views[k], wires, config)] = np.nan
        known = np.isfinite(depths.t)
        t = depths.t[known]
        t = t[photos.within(views[k].centre + t[:, None] * views[k].rays()[known], config.farthest)]
        return np.quantile(t, config.coarse.quantiles) if len(t) >= config.min_share * known.size else None

    found = np.full((len(views), len(config.coarse.quantiles)), np.nan)
    for done, (k, some) in enumerate(depth_maps(near, pictures.__getitem__, quantiles, config.match), 1):
        if some is not None:
            found[k] = some
        if progress is not None:
            progress(done, len(views))
    return _filled(found, np.array([view.centre for view in views]))


def tried_distances(photos: Photos, config: StereoConfig) -> list[float]:
    """From the farthest that counts down to where even neighbouring images are too far apart."""
    low, high = photos.box
    centres = photos.cameras.centre.numpy()[list(photos.train)]
    spacing = float(np.median(cKDTree(centres).query(centres, k=2)[0][:, 1])) if len(centres) > 1 else np.inf
    distances = [config.farthest * float((high - low).max()) / 2]
    while len(distances) < config.coarse.most_distances:
        nearer = distances[-1] / config.coarse.distance_step
        if nearer * config.pairs.max_baseline < spacing:
            break
        distances.append(nearer)
    return distances


def _filled(
    distances: Float[np.ndarray, "m q"], centres: Float[np.ndarray, "m 3"]
) -> Float[np.ndarray, "m q"]:
    known = np.isfinite(distances[:, 0])
    if not known.any():
        return distances
    nearest = cKDTree(centres[known]).query(centres)[1]
    filled: Float[np.ndarray, "m q"] = np.where(known[:, None], distances, distances[known][nearest])
    return filled
