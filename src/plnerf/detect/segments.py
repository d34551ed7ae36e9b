"""The straight pieces of the thin lines of all images, each with the plane in which it lies in space.

Letters: m pixels of `LineMaps`; s segments of all views together.
"""

from itertools import pairwise
from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int

from plnerf.detect.chains import curves_through, without_lens
from plnerf.detect.config_lines import SegmentConfig
from plnerf.detect.line_maps import LineMaps, unit
from plnerf.detect.views import Views
from plnerf.ops.kernel_cache import njit


class Segments(NamedTuple):
    """Segments, those of one view after another's."""

    owner: Int[np.ndarray, " s"]
    """The view."""
    normal: Float[np.ndarray, "s 3"]
    """Unit normal of the plane through the camera's centre and both ends; scene frame."""
    ends: Float[np.ndarray, "s 2 3"]
    """Rays to both ends, of depth 1; scene frame."""
    length_px: Float[np.ndarray, " s"]

    def of(self, keep: Bool[np.ndarray, " s"]) -> "Segments":
        """Some of them."""
        return Segments(*(part[keep] for part in self))


def segments_of(
    maps: LineMaps, views: Views, config: SegmentConfig
) -> tuple[Segments, Int[np.ndarray, " m"]]:
    """The longest segments of each view, and the segment of each pixel, -1 for none."""
    chain = linked(maps, views, config)
    count = int(chain.max(initial=-1)) + 1
    at = np.stack([maps.pixel % views.sizes[maps.view, 0], maps.pixel // views.sizes[maps.view, 0]], 1) + 0.5
    bounds = np.searchsorted(maps.view, np.arange(len(views.R) + 1))
    flat = [without_lens(at[a:b], views, n) for n, (a, b) in enumerate(pairwise(bounds))]
    on = chain >= 0
    curves, rms = curves_through(np.concatenate([np.zeros((0, 2)), *flat])[on], chain[on], count)
    owner = np.zeros(count, np.int64)
    owner[chain[on]] = maps.view[on]
    focal = views.focal[owner, 0]
    length_px = (curves[:, 6] - curves[:, 5]) * focal
    keep = (length_px >= config.least_px) & (rms * focal <= config.rms_px)
    keep &= _rank_in_view(owner, np.where(keep, length_px, 0.0)) < config.most
    number = np.append(np.where(keep, np.cumsum(keep) - 1, -1), -1)  # the last: of pixels without a chain
    ends = _rays_to_ends(curves[keep], views.R[owner[keep]])
    normal = unit(np.cross(ends[:, 0], ends[:, 1]))
    return Segments(owner[keep], normal, ends, length_px[keep]), number[chain]


def linked(maps: LineMaps, views: Views, config: SegmentConfig) -> Int[np.ndarray, " m"]:
    """The chain of each pixel, -1 for those that respond too little: neighbours along a line are of one."""
    clear = np.flatnonzero(maps.response >= config.min_response)
    normal = np.einsum("mij,mj->mi", views.R[maps.view[clear]], maps.normal[clear].astype(np.float64))
    tangent = np.arctan2(normal[:, 0], -normal[:, 1])
    w, h = views.sizes[maps.view[clear]].T
    index = np.full((int(h.max(initial=1)) + 1, int(w.max(initial=1)) + 2), -1, np.int32)
    root = link(maps.view[clear], maps.pixel[clear] // w, maps.pixel[clear] % w, tangent,
                np.cos(config.turn_rad), index)  # fmt: skip
    chain = np.full(len(maps.view), -1)
    chain[clear] = np.unique(root, return_inverse=True)[1]
    return chain


@njit(cache=True)
@no_type_check
def link(view, row, column, tangent, least_cosine, index):
    """The first pixel of each pixel's chain; pixels in order of view, row and column.

    Neighbours are of one chain where their tangents agree, so that lines which cross stay two.  index: -1
    everywhere, at least one row and two columns larger than any image.
    """
    root = np.arange(len(view)).astype(np.int32)
    begin = 0
    for m in range(len(view)):
        if m > 0 and view[m] != view[m - 1]:
            for k in range(begin, m):
                index[row[k] + 1, column[k] + 1] = -1
            begin = m
        index[row[m] + 1, column[m] + 1] = m
        for dy, dx in ((0, -1), (-1, -1), (-1, 0), (-1, 1)):
            k = index[row[m] + 1 + dy, column[m] + 1 + dx]
            if k >= 0 and abs(np.cos(tangent[m] - tangent[k])) >= least_cosine:
                a, b = first_of(root, m), first_of(root, k)
                root[max(a, b)] = min(a, b)
    for m in range(len(view)):
        root[m] = first_of(root, m)
    return root


@njit(cache=True)
@no_type_check
def first_of(root, m):
    """The pixel that stands for m's chain."""
    while root[m] != m:
        root[m] = root[root[m]]
        m = root[m]
    return m


def _rank_in_view(owner: Int[np.ndarray, " s"], length: Float[np.ndarray, " s"]) -> Int[np.ndarray, " s"]:
    """The place of each segment among those of its view, the longest first."""
    order = np.lexsort((-length, owner))
    first = np.searchsorted(owner[order], owner[order])
    rank = np.empty(len(owner), np.int64)
    rank[order] = np.arange(len(owner)) - first
    return rank


def _rays_to_ends(
    curves: Float[np.ndarray, "s 7"], R_camera_scene: Float[np.ndarray, "s 3 3"]
) -> Float[np.ndarray, "s 2 3"]:
    u, v, p0, p1, p2 = curves[:, :5].T[:, :, None]
    t = curves[:, 5:]
    across = p0 + t * (p1 + t * p2)
    rays = np.stack([t * u - across * v, t * v + across * u, np.ones_like(t)], 2)
    return np.einsum("sji,skj->ski", R_camera_scene, rays)
