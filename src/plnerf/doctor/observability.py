"""How well a set of views fixes where a wire is, across its direction.

A view sees a wire as a line in its image, and so fixes one thing of a point of it: the distance from the
viewing plane, which holds the camera's centre and the wire's direction there.  Along the wire nothing moves
in the image.  Letters: n cameras, p points of a wire with unit tangents u; e1, e2 two unit vectors across u;
m (2) the derivative of the signed distance in pixels of the projected wire by a displacement along e1, e2.

    I = sum over views of m m^T / (sigma_px^2 + |m|^2 pose_sigma^2),      covariance = I^-1

A view's own error is sigma_px in its image and pose_sigma of its centre, independent between views: errors
that all views share (a drift of the whole flight) do not show here.  All lengths are in the cameras' unit.
If all views lie in one plane with the wire, as those of a camera that moves along it, I is singular: the
position in that plane is not observable at any number of views.  Occlusion is not known and not considered.
"""

from dataclasses import dataclass, fields

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from plnerf.doctor.config import SCENES
from plnerf.scene.cameras import Cameras, distort

SINGULAR = 1e-6
"""Singular values below this share of the largest are rounding (camera centres are float32): not seen."""


@dataclass(frozen=True, eq=False)
class Observability:
    """Per point of a wire; lengths in the cameras' unit, infinite where not observable."""

    worst: Float[np.ndarray, " p"]
    """1-sigma of the position in the direction across the wire that is known worst."""
    best: Float[np.ndarray, " p"]
    """1-sigma in the direction across the wire that is known best."""
    worst_direction: Float[np.ndarray, "p 3"]
    """Unit vector."""
    spread_deg: Float[np.ndarray, " p"]
    """Greatest angle between two viewing planes, 0 to 90; 0 for fewer than two views."""
    views: Int[np.ndarray, " p"]
    distance: Float[np.ndarray, " p"]
    """Of the nearest camera that sees the point; infinite without any."""
    px_per_length: Float[np.ndarray, " p"]
    """Greatest magnification among the views across the wire: times the diameter, its width in pixels."""

    def __getitem__(self, index: Bool[np.ndarray, " p"] | Int[np.ndarray, " q"]) -> "Observability":
        """The chosen points."""
        return Observability(*(getattr(self, field.name)[index] for field in fields(self)))


def observe_wire(
    cameras: Cameras,
    points: Float[np.ndarray, "p 3"],
    tangents: Float[np.ndarray, "p 3"],
    *,
    sigma_px: float = SCENES.sigma_px,
    pose_sigma: float = 0.0,
    least_px_per_length: float = 0.0,
) -> Observability:
    """How well the cameras fix the points of a wire (the cameras' frame).

    least_px_per_length: views that magnify less do not count (a wire needs some width to be found).  A lens's
    distortion decides what is in the image, and is neglected in the derivatives.
    """
    u = tangents / np.linalg.norm(tangents, axis=1, keepdims=True)
    across = _across(u)
    rotation = cameras.R_scene_camera.double().cpu().numpy()
    centre = cameras.centre.double().cpu().numpy()
    offset = points[None] - centre[:, None]
    distance = np.linalg.norm(offset, axis=2)
    m, sees = _derivatives(cameras, rotation, offset, u, across)
    magnification = np.linalg.norm(m, axis=2)
    sees &= (magnification >= least_px_per_length) & (magnification > 0)
    noise = np.sqrt(sigma_px**2 + (magnification * pose_sigma) ** 2)
    rows = np.where(sees[..., None], m / noise[..., None], 0.0).transpose(1, 0, 2)  # p n 2
    if rows.shape[1] < 2:
        rows = np.concatenate([rows, np.zeros((len(points), 2 - rows.shape[1], 2))], axis=1)
    _, singular, right = np.linalg.svd(rows, full_matrices=False)  # p 2, p 2 2: keeps twice I's digits
    known = singular > SINGULAR * singular[:, :1]
    sigma = np.where(known, 1.0 / np.where(known, singular, 1.0), np.inf)
    return Observability(
        worst=sigma[:, 1],
        best=sigma[:, 0],
        worst_direction=np.einsum("pk,pkd->pd", right[:, 1], across),
        spread_deg=_spread_deg(m, sees),
        views=sees.sum(0),
        distance=np.where(sees, distance, np.inf).min(0, initial=np.inf),
        px_per_length=np.where(sees, magnification, 0.0).max(0, initial=0.0),
    )


def _across(u: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, "p 2 3"]:
    """Two unit vectors perpendicular to each tangent and to each other."""
    least = np.eye(3)[np.abs(u).argmin(1)]
    first = np.cross(u, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    pair: Float[np.ndarray, "p 2 3"] = np.stack([first, np.cross(u, first)], axis=1)
    return pair


def _derivatives(
    cameras: Cameras,
    rotation: Float[np.ndarray, "n 3 3"],
    offset: Float[np.ndarray, "n p 3"],
    u: Float[np.ndarray, "p 3"],
    across: Float[np.ndarray, "p 2 3"],
) -> tuple[Float[np.ndarray, "n p 2"], Bool[np.ndarray, "n p"]]:
    """m, and which cameras have the point in front and in the image.

    With J (2x3) the derivative of the pixel by the point in camera axes, and t the unit direction of J u in
    the image, m is what is perpendicular to t of J e1 and J e2.
    """
    in_camera = np.einsum("nji,npj->npi", rotation, offset)
    focal = cameras.focal_px.double().cpu().numpy()[:, None]
    z = in_camera[..., 2]
    front = z > 1e-6 * np.linalg.norm(in_camera, axis=2).clip(1e-300)
    depth = np.where(front, z, 1.0)
    plane = in_camera[..., :2] / depth[..., None]

    def moved(direction: Float[np.ndarray, "n p 3"]) -> Float[np.ndarray, "n p 2"]:
        by: Float[np.ndarray, "n p 2"] = direction[..., :2] - plane * direction[..., 2:]
        return focal * by / depth[..., None]

    line = moved(np.einsum("nji,pj->npi", rotation, u))
    length = np.linalg.norm(line, axis=2)
    # Looking along the wire, it is a point: nothing is known of a line then.
    scale = focal.max(2) / depth
    front &= length > 1e-9 * scale
    normal = np.stack([-line[..., 1], line[..., 0]], axis=2) / np.where(front, length, 1.0)[..., None]
    parts = [
        np.einsum("npi,npi->np", normal, moved(np.einsum("nji,pj->npi", rotation, across[:, k])))
        for k in range(2)
    ]
    distorted = distort(torch.from_numpy(plane), cameras.distortion[:, None].double().cpu()).numpy()
    pixel = distorted * focal + cameras.principal_px.double().cpu().numpy()[:, None]
    inside = (pixel >= 0) & (pixel <= cameras.size_px.cpu().numpy()[:, None])
    # Far outside the image, a lens's polynomial can fold back into it.
    inside &= np.abs(plane) * focal <= 2 * cameras.size_px.cpu().numpy()[:, None]
    return np.stack(parts, axis=2), front & inside.all(2)


def _spread_deg(m: Float[np.ndarray, "n p 2"], sees: Bool[np.ndarray, "n p"]) -> Float[np.ndarray, " p"]:
    """The greatest angle between two viewing planes; m is normal to them."""
    angles = np.arctan2(m[..., 1], m[..., 0])
    spread = np.zeros(m.shape[1])
    for i in range(m.shape[1]):
        mine = angles[sees[:, i], i]
        if len(mine) > 1:
            between = np.abs(mine[:, None] - mine) % np.pi
            spread[i] = np.degrees(np.minimum(between, np.pi - between).max())
    return spread
