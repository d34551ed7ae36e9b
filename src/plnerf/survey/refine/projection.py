"""A wire as one camera sees it, and where the others cross its neighbourhood.

Letters: k samples along the wire; u the pixel's place relative to the principal point, over the focal length.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree

from plnerf.scene.cameras import Cameras, project
from plnerf.survey.fit import Base

END_ON = 0.15
"""Sine of the angle between wire and line of sight below which a view says nothing of a wire's place."""
LEAST_CROSSING = 0.2
"""Sine of the angle between a sample's normal and another wire, below which that runs along the normal."""


@dataclass(frozen=True, eq=False)
class Track:
    """A wire in one image."""

    s: Float[np.ndarray, " k"]
    """Along the wire, as `Base` counts it."""
    pixel: Float[np.ndarray, "k 2"]
    tangent: Float[np.ndarray, "k 2"]
    normal: Float[np.ndarray, "k 2"]
    """Unit vectors in the image."""
    g: Float[np.ndarray, "k 2"]
    """How far the curve moves along its normal when the wire moves along y, and along z: pixels per unit."""
    motion: Float[np.ndarray, "k 3"]
    """How far it moves along its normal when the image moves by a pixel right, by one down, and when it turns
    by one at the focal length from its middle."""
    front: Bool[np.ndarray, " k"]
    """In front of the camera."""
    good: Bool[np.ndarray, " k"]
    """Within the image and not seen end-on, too."""


def track(
    camera: Cameras,
    base: Base,
    q: Float[np.ndarray, "5"],
    s: Float[np.ndarray, " k"],
    moved: Float[np.ndarray, "3"],
) -> Track:
    """Projects a wire.  camera: one, in float64.  moved: of the image, in the terms of `Track.motion`."""
    step = 1e-4 * base.length_m
    here = base.at(q, s)
    places = [_world(base, s, here), _world(base, s + step, base.at(q, s + step))]
    places += [_world(base, s, here + step * axis) for axis in np.eye(2)]
    pixels, depths = project(camera, torch.from_numpy(np.concatenate(places)))
    (pixel, on, y_px, z_px), depth = np.split(pixels[0].numpy(), 4), depths[0].numpy().reshape(4, -1)
    front = np.asarray((depth > 1e-6).all(0))
    length = np.linalg.norm(on - pixel, axis=1)
    tangent = (on - pixel) / np.maximum(length, 1e-12)[:, None]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], 1)
    g = np.stack([((to - pixel) * normal).sum(1) / step for to in (y_px, z_px)], 1)
    focal = float(camera.focal_px[0, 0])
    u = (pixel - camera.principal_px[0].numpy()) / focal
    turn = np.stack([-u[:, 1], u[:, 0]], 1)
    pixel = pixel + moved[:2] + moved[2] * turn
    inside = ((pixel > 0) & (pixel < camera.size_px[0].numpy())).all(1)
    square_on = focal * step / np.where(front, depth[0], 1.0)
    return Track(
        s, pixel, tangent, normal, g, np.concatenate([normal, (normal * turn).sum(1, keepdims=True)], 1),
        front, front & inside & (length > END_ON * square_on),
    )  # fmt: skip


def crossings(
    seen: Track, others: Sequence[Track], within_px: float, most: int
) -> Float[np.ndarray, "k most"]:
    """Where other wires cross the normals of a wire: signed distances from it (px), the nearest first, NaN
    where there are fewer.

    0 stands for a wire that runs along the normal, so that it is nowhere in particular.
    """
    rows = [np.full(len(seen.s), np.nan)] * most
    if seen.good.any():
        low, high = seen.pixel[seen.good].min(0) - within_px, seen.pixel[seen.good].max(0) + within_px
        for other in others:
            # A sample beyond the edge on either side, so that no crossing is lost at it.
            near = other.front & ((other.pixel > low) & (other.pixel < high)).all(1)
            near = np.convolve(near, np.ones(3), "same")[: len(near)].astype(bool) & other.front
            if near.any():
                rows.append(_crossing(seen, other.pixel[near], other.tangent[near], within_px))
    apart = np.stack(rows, 1)
    order = np.argsort(np.where(np.isnan(apart), np.inf, np.abs(apart)), 1)[:, :most]
    nearest: Float[np.ndarray, "k most"] = np.take_along_axis(apart, order, 1)
    return nearest


def _crossing(
    seen: Track, pixel: Float[np.ndarray, "n 2"], tangent: Float[np.ndarray, "n 2"], within_px: float
) -> Float[np.ndarray, " k"]:
    """Of one other wire: by the straight line through its nearest sample."""
    spacing = float(np.linalg.norm(np.diff(pixel, axis=0), axis=1).max(initial=0.0))
    away, nearest = cKDTree(pixel).query(seen.pixel, distance_upper_bound=1.5 * within_px + spacing)
    hit = np.isfinite(away)
    nearest = np.where(hit, nearest, 0)
    to, along = pixel[nearest] - seen.pixel, tangent[nearest]
    sine = seen.normal[:, 0] * along[:, 1] - seen.normal[:, 1] * along[:, 0]
    crosses = np.abs(sine) >= LEAST_CROSSING
    off = (to[:, 0] * along[:, 1] - to[:, 1] * along[:, 0]) / np.where(crosses, sine, 1.0)
    off = np.where(crosses, off, 0.0)
    return np.where(hit & (np.abs(off) <= within_px), off, np.nan)


def _world(base: Base, s: Float[np.ndarray, " k"], yz: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "k 3"]:
    flat = base.o + s[:, None] * base.u + yz[:, :1] * base.n
    return np.concatenate([flat, yz[:, 1:]], 1)
