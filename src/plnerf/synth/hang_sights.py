"""Which photos show a wire, how wide, and whether they show it from sides that fix its place.

Letters: v photos, n stations along the wire.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from plnerf.synth.hang_depth import Depth
from plnerf.synth.hang_views import PhotoView

OFFSET = 1e-4
"""Of the depth: the sideways step whose picture is measured for the width."""


@dataclass(frozen=True, eq=False)
class Sights:
    """How photos show the stations of a wire."""

    inside: Bool[np.ndarray, "v n"]
    """Whether a station lies in the photo, hidden or not."""
    seen: Bool[np.ndarray, "v n"]
    """Whether it is shown."""
    ratio: Float[np.ndarray, "v n"]
    """Its depth as a share of the photo's typical one."""
    px_per_unit: Float[np.ndarray, "v n"]
    """Width in the photo of a wire of unit diameter."""
    angle_deg: Float[np.ndarray, " n"]
    """Greatest angle between the planes of wire and camera of two photos that show it."""

    @property
    def images(self) -> Int[np.ndarray, " n"]:
        """Photos that show each station."""
        return self.seen.sum(0)

    def observable(self, least_images: int, least_angle_deg: float) -> Bool[np.ndarray, " n"]:
        """Stations that so many photos show, whose planes span such an angle."""
        enough: Bool[np.ndarray, " n"] = (self.images >= least_images) & (self.angle_deg >= least_angle_deg)
        return enough


def sights(
    points: Float[np.ndarray, "n 3"],
    views: Sequence[PhotoView],
    depths: Sequence[Depth],
    behind: float,
) -> Sights:
    """How photos show the curve through the points, which follow one another along a wire.

    behind: relative difference by which the scene must be nearer than the wire to hide it.
    """
    tangent = np.gradient(points, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    inside = np.zeros((len(views), len(points)), np.bool_)
    seen, ratio, scale = inside.copy(), np.full(inside.shape, np.nan), np.full(inside.shape, np.nan)
    normals = np.zeros((*inside.shape, 3))
    for k, (view, depth) in enumerate(zip(views, depths, strict=True)):
        pixel, z, ahead = view.project(points)
        at = np.flatnonzero(ahead & view.inside(pixel))
        if not len(at):
            continue
        inside[k, at] = True
        ratio[k, at] = z[at] / depth.typical
        local = view.local(points[at])
        seen[k, at] = z[at] < depth.at(local[:, :2] / local[:, 2:]) * (1 + behind)
        away = points[at] - view.centre
        normal = np.cross(away, tangent[at])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
        normals[k, at] = normal
        step = OFFSET * z[at, None]
        beside = view.project(points[at] + step * normal)[0] - pixel[at]
        along = view.project(points[at] + step * tangent[at])[0] - pixel[at]
        across = np.abs(beside[:, 0] * along[:, 1] - beside[:, 1] * along[:, 0])
        scale[k, at] = across / np.maximum(np.linalg.norm(along, axis=1), 1e-12) / step[:, 0]
    return Sights(inside, seen, ratio, scale, _angles(normals, seen))


def _angles(normals: Float[np.ndarray, "v n 3"], seen: Bool[np.ndarray, "v n"]) -> Float[np.ndarray, " n"]:
    """Greatest angle between two of the planes that each station is seen in, degrees."""
    found = np.zeros(seen.shape[1])
    for i in np.flatnonzero(seen.sum(0) >= 2):
        mine = normals[seen[:, i], i]
        found[i] = np.degrees(np.arccos(min(1.0, float(np.abs(mine @ mine.T).min()))))
    return found
