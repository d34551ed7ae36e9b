"""Which photos say something of where wires are: of a long flight most show a span small and far away.

Letters: t photos, k places along a wire, n the normal of the plane through a camera and a wire.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from plnerf.line.wire import Wire
from plnerf.survey.posed_photos import Photos

PLACES = 30
"""Along each wire."""


def telling(photos: Photos, wires: Sequence[Wire], least: float, end_on: float) -> Photos:
    """The photos without those whose leverage is below `least` at every place of the wires; all where no
    photo says anything."""
    most: Float[np.ndarray, " t"] = np.zeros(len(photos.train))
    for wire in wires:
        most = np.maximum(most, leverages(photos, wire, end_on).max(1, initial=0.0))
    kept = tuple(i for i, share in zip(photos.train, most.tolist(), strict=True) if share >= least)
    return replace(photos, train=kept) if kept else photos


def leverages(photos: Photos, wire: Wire, end_on: float) -> Float[np.ndarray, "t k"]:
    """How much of what all photos say of a place across and up each one says, 0 to 1; they sum to 2.

    A photo says how far off the place is along n, the better the nearer it is: what all say is the sum of
    n n^T / distance^2, in which a direction from which few look counts for more (leverages of least squares).
    end_on: sine of the angle between wire and line of sight below which a photo says nothing.
    """
    points = wire.points(np.linspace(0.0, wire.base.length_m, PLACES))
    apart = photos.distances(points)
    along = (points[-1] - points[0]) / np.linalg.norm(points[-1] - points[0])
    across = np.array([*wire.base.n, 0.0])
    sight = points - photos.cameras.centre.numpy()[list(photos.train), None]
    normal = np.cross(sight / np.linalg.norm(sight, axis=2, keepdims=True), along)
    sine = np.linalg.norm(normal, axis=2)
    says = np.isfinite(apart) & (sine >= end_on)
    n = np.stack([normal @ across, normal @ np.cross(along, across)], 2) / np.maximum(sine, 1e-9)[:, :, None]
    n /= np.where(says, apart, np.inf)[:, :, None]
    every = np.einsum("tka,tkb->kab", n, n)
    every += 1e-6 * np.trace(every, axis1=1, axis2=2)[:, None, None] * np.eye(2) + 1e-300 * np.eye(2)
    found: Float[np.ndarray, "t k"] = np.einsum("tka,kab,tkb->tk", n, np.linalg.inv(every), n)
    return found
