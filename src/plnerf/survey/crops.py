"""Parts of photos that show encroachments and possible obstacles, by which a reader can judge what is there.

Letters: t training images.
"""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float

from plnerf.line.survey import Crop
from plnerf.scene.cameras import project
from plnerf.survey.posed_photos import Photos

EACH = 3
"""Photos of each obstacle at most."""
SIDE = 0.35
"""Side of a crop, as a share of the photo's longer side."""
MARGIN = 0.05
"""An obstacle nearer to the photo's edge than this share of its side is not shown well."""


def crops_of(
    photos: Photos, places: Sequence[tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]]
) -> tuple[Crop, ...]:
    """Of each obstacle the photo that is nearest to it, and those that see it from the most other sides.

    places: of each the obstacle and the place on the wire that is nearest to it.
    """
    found = []
    for k, (obstacle, on_wire) in enumerate(places):
        for i in _chosen(photos, obstacle):
            at, wire = _pixels(photos, i, np.stack([obstacle, on_wire]))
            found.append(_crop(photos, i, k, at, wire))
    return tuple(found)


def _chosen(photos: Photos, point: Float[np.ndarray, "3"]) -> list[int]:
    """Of the training images, the nearest that shows the point well, then each that looks from farthest aside
    of those chosen."""
    distance = photos.distances(point[None])[:, 0]
    inside = np.flatnonzero(np.isfinite(distance)).tolist()
    well = [k for k in inside if _well(photos, photos.train[k], point)]
    if not well:
        return []
    centres = photos.cameras.centre.numpy()[[photos.train[k] for k in well]]
    towards = (point - centres) / np.linalg.norm(point - centres, axis=1)[:, None]
    chosen = [int(distance[well].argmin())]
    while len(chosen) < min(EACH, len(well)):
        nearest = (towards @ towards[chosen].T).max(1)
        nearest[chosen] = np.inf
        chosen.append(int(nearest.argmin()))
    return [photos.train[well[k]] for k in chosen]


def _well(photos: Photos, i: int, point: Float[np.ndarray, "3"]) -> bool:
    at, size = _pixels(photos, i, point[None])[0], photos.cameras.size_px[i].numpy()
    return bool(((at > MARGIN * size) & (at < (1 - MARGIN) * size)).all())


def _pixels(photos: Photos, i: int, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
    pixels, _ = project(photos.cameras[[i]], torch.from_numpy(points))
    found: Float[np.ndarray, "n 2"] = pixels[0].numpy()
    return found


def _crop(
    photos: Photos, i: int, of: int, at: Float[np.ndarray, "2"], wire: Float[np.ndarray, "2"]
) -> Crop:
    """Of the photo at its full size."""
    rgb = photos.full.image(i)
    size = np.array(rgb.shape[1::-1])
    shrink = size / photos.cameras.size_px[i].numpy()
    at, wire = at * shrink, wire * shrink
    side = np.minimum(size, max(2, round(SIDE * int(size.max()))))
    low = np.clip(at - side / 2, 0, size - side).astype(int)
    part = rgb[low[1] : low[1] + side[1], low[0] : low[0] + side[0]].copy()
    return Crop(of, photos.names[i], part, at - low, wire - low)
