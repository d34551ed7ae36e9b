"""A wire as one camera sees it, and where other wires cross its neighbourhood.

Letters: k samples along the wire; u the pixel's place relative to the principal point, over the focal length.
LineFrame.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree

from plnerf.line.base import Base
from plnerf.line.curve import curve_at
from plnerf.scene.cameras import Cameras, project

MOVES = 6
"""Numbers of an image's pose residual."""


@dataclass(frozen=True, eq=False)
class Projection:
    """A wire in one image."""

    s: Float[np.ndarray, " k"]
    """Along the wire's base."""
    pixel: Float[np.ndarray, "k 2"]
    tangent: Float[np.ndarray, "k 2"]
    normal: Float[np.ndarray, "k 2"]
    """Unit vectors in the image."""
    by_yz: Float[np.ndarray, "k 2"]
    """How far the curve moves along its normal when the wire moves along y, and along z: pixels per metre."""
    by_pose: Float[np.ndarray, "k 6"]
    """How far it moves along its normal by a unit of each pose residual (du, dv, roll, mu, mv, mw): the image
    moves by a pixel right, by one down, and turns by one at the focal length from its middle; what is at the
    usual distance in it moves by a pixel right, by one down, and outwards by one at the focal length from the
    middle, and what is farther by less."""
    front: Bool[np.ndarray, " k"]
    """In front of the camera."""
    good: Bool[np.ndarray, " k"]
    """Within the image and not seen end-on, too."""


def project_wire(
    camera: Cameras,
    base: Base,
    theta: Float[np.ndarray, "6"],
    s: Float[np.ndarray, " k"],
    pose_residual: Float[np.ndarray, "6"],
    usual_m: float,
    end_on: float,
) -> Projection:
    """Projects a wire.  camera: one, in float64.  pose_residual: of its image; usual_m: distance, see
    `Projection.by_pose`."""
    L = base.length_m
    step = 1e-4 * L
    here = curve_at(theta, L, s)
    places = [base.place(s, here), base.place(s + step, curve_at(theta, L, s + step))]
    places += [base.place(s, here + step * axis) for axis in np.eye(2)]
    pixels, depths = project(camera, torch.from_numpy(np.concatenate(places)))
    (pixel, on, y_px, z_px), depth = np.split(pixels[0].numpy(), 4), depths[0].numpy().reshape(4, -1)
    front = np.asarray((depth > 1e-6).all(0))
    length = np.linalg.norm(on - pixel, axis=1)
    tangent = (on - pixel) / np.maximum(length, 1e-12)[:, None]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], 1)
    by_yz = np.stack([((to - pixel) * normal).sum(1) / step for to in (y_px, z_px)], 1)
    focal = float(camera.focal_px[0, 0])
    u = (pixel - camera.principal_px[0].numpy()) / focal
    turn = np.stack([-u[:, 1], u[:, 0]], 1)
    nearness = (usual_m / np.where(front, depth[0], np.inf))[:, None]
    pixel = pixel + pose_residual[:2] + pose_residual[2] * turn
    pixel += nearness * (pose_residual[3:5] + pose_residual[5] * u)
    inside = ((pixel > 0) & (pixel < camera.size_px[0].numpy())).all(1)
    square_on = focal * step / np.where(front, depth[0], 1.0)
    rolled, outwards = ((normal * by).sum(1, keepdims=True) for by in (turn, u))
    by_pose = np.concatenate([normal, rolled, normal * nearness, outwards * nearness], 1)
    good = front & inside & (length > end_on * square_on)
    return Projection(s, pixel, tangent, normal, by_yz, by_pose, front, good)


def crossings(
    seen: Projection, others: Sequence[Projection], within_px: float, most: int, least_sine: float
) -> Float[np.ndarray, "k most"]:
    """Where other wires cross the normals of a wire: signed distances from it (px), the nearest first, NaN
    where there are fewer.

    0 stands for a wire that runs along the normal (the sine of their angle below `least_sine`), so that it is
    nowhere in particular.
    """
    rows = [np.full(len(seen.s), np.nan)] * most
    if seen.good.any():
        low, high = seen.pixel[seen.good].min(0) - within_px, seen.pixel[seen.good].max(0) + within_px
        for other in others:
            # A sample beyond the edge on either side, so that no crossing is lost at it.
            near = other.front & ((other.pixel > low) & (other.pixel < high)).all(1)
            near = np.convolve(near, np.ones(3), "same")[: len(near)].astype(bool) & other.front
            if near.any():
                rows.append(
                    _crossing(seen, other.pixel[near], other.tangent[near], within_px, least_sine)
                )
    apart = np.stack(rows, 1)
    order = np.argsort(np.where(np.isnan(apart), np.inf, np.abs(apart)), 1)[:, :most]
    nearest: Float[np.ndarray, "k most"] = np.take_along_axis(apart, order, 1)
    return nearest


def _crossing(
    seen: Projection,
    pixel: Float[np.ndarray, "n 2"],
    tangent: Float[np.ndarray, "n 2"],
    within_px: float,
    least_sine: float,
) -> Float[np.ndarray, " k"]:
    """Of one other wire: by the straight line through its nearest sample."""
    spacing = float(np.linalg.norm(np.diff(pixel, axis=0), axis=1).max(initial=0.0))
    away, nearest = cKDTree(pixel).query(seen.pixel, distance_upper_bound=1.5 * within_px + spacing)
    hit = np.isfinite(away)
    nearest = np.where(hit, nearest, 0)
    to, along = pixel[nearest] - seen.pixel, tangent[nearest]
    sine = seen.normal[:, 0] * along[:, 1] - seen.normal[:, 1] * along[:, 0]
    crosses = np.abs(sine) >= least_sine
    off = (to[:, 0] * along[:, 1] - to[:, 1] * along[:, 0]) / np.where(crosses, sine, 1.0)
    off = np.where(crosses, off, 0.0)
    return np.where(hit & (np.abs(off) <= within_px), off, np.nan)
