"""Catenaries fitted to the images themselves: all wires together, each image free to be a little off.

    minimise  sum rho((e - g (dy, dz) - normal . t_n - |g| c_wk) / sigma_px)
              + sum |t_n|^2 / SHIFT_PX^2 + sum c_wk^2 / bias^2

over the q of every wire w (`catenary.py`), a shift t_n of every image n in pixels, which stands for what its
pose is off by, and a displacement c_wk of what is seen of a wire from the k-th direction around it: light
falls on one side of it, and against sky and ground another part of it shows.  Errors of poses and of light so
show in the wires' covariance.  Gauss-Newton, with a window around each wire that narrows.  One sighting is
one ridge (`sightings.py`).
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float

from plnerf.scene.cameras import Cameras
from plnerf.scene.scene import Scene
from plnerf.survey.catenary import LEAST_BEND_M, Base, jacobian
from plnerf.survey.sightings import Sightings, Track, sight, track

WINDOWS_PX = (6.0, 4.0, 3.0, 2.5, 2.0, 2.0)
SAMPLES = 400
SIGMA_PX = 0.3
"""Least standard deviation of a sighting; what they show instead wins where it is more."""
SHIFT_PX = 0.3
"""Standard deviation of an image's shift."""
DIRECTIONS = 9
"""Around a wire, of 20 degrees each."""
LIGHT_SHARE = 0.25
"""Standard deviation of a wire's apparent displacement by light, as a share of its diameter."""
ALIKE = 8.0
"""Neighbouring sightings of one image share their error: so many count as one."""
CORE_PX = 1.0
LEAST_SEEN = 0.3
"""Share of a wire's samples that some image must show."""
LEAST_VIEWS = 3
MOST_RMS_PX = 1.5
UNFIXED_PX = 3.0
"""A wire less certain than so many pixels wide is not fixed by the views."""


@dataclass(frozen=True, eq=False)
class Refined:
    """One wire after refinement."""

    q: Float[np.ndarray, "5"]
    """As it was where `refused` says why."""
    covariance: Float[np.ndarray, "5 5"]
    """In the scene's unit squared; of the refined wire also where it is refused."""
    rms_px: float
    """Of its sightings."""
    rms: float
    """The same as lengths across the wire."""
    sightings: int
    views: int
    """Images with sightings of it."""
    seen: Float[np.ndarray, " k"]
    """At each of SAMPLES places along the wire, sightings within a pixel of it."""
    tried: Float[np.ndarray, " k"]
    """Images in which it was looked for there."""
    moved: float
    """Greatest distance between before and after."""
    refused: str | None


def refine(
    scene: Scene,
    base: Base,
    wires: Sequence[Float[np.ndarray, "5"]],
    reach: Sequence[float],
    diameter: float,
    tell: Callable[[int, int], object] = lambda done, of: None,
) -> list[Refined]:
    """Refits wires of the scene frame to its training images.

    diameter: of the wires, about.  reach: how far each may be from where it is; one that goes further is refused, and stays.
    """
    views = list(scene.train)
    cameras = [_double(scene.cameras[[i]]) for i in views]
    grey = [cv2.cvtColor(scene.images.image(i), cv2.COLOR_RGB2GRAY).astype(np.float32) for i in views]
    masked = scene.images.has_masks
    s = np.linspace(0, base.length_m, SAMPLES)
    bias = LIGHT_SHARE * diameter
    q = [np.array(wire, np.float64) for wire in wires]
    shifts = np.zeros((len(views), 2))
    found: list[list[Sightings]] = []
    covariance = np.zeros((5 * len(q), 5 * len(q)))
    for step, window in enumerate(WINDOWS_PX):

        def look(n: int, window: float = window) -> list[Sightings]:
            tracks = [_moved(track(cameras[n], base, one, s), shifts[n]) for one in q]
            valid = scene.images.valid(views[n]) if masked else None
            return [
                sight(grey[n], valid, tracks[w], tracks[:w] + tracks[w + 1 :], window) for w in range(len(q))
            ]

        with ThreadPoolExecutor() as pool:
            found = list(pool.map(look, range(len(views))))
        change, turn, covariance = _solve(base, q, shifts, found, bias)
        q = [np.append(one[:4], max(one[4], LEAST_BEND_M)) for one in np.array(q) + change]
        shifts = shifts + turn
        tell(step + 1, len(WINDOWS_PX))
    results = []
    for w, before in enumerate(wires):
        mine = [row[w] for row in found]
        own = covariance[5 * w : 5 * w + 5, 5 * w : 5 * w + 5]
        results.append(_judged(base, np.asarray(before), q[w], own, mine, cameras, reach[w], s))
    return results


def _double(camera: Cameras) -> Cameras:
    names = ("R_scene_camera", "centre", "focal_px", "principal_px", "distortion")
    return Cameras(*(getattr(camera, name).double() for name in names), camera.size_px)


def _moved(seen: Track, shift: Float[np.ndarray, "2"]) -> Track:
    return Track(seen.s, seen.pixel + shift, seen.normal, seen.g, seen.good)


def _solve(
    base: Base,
    q: Sequence[Float[np.ndarray, "5"]],
    shifts: Float[np.ndarray, "n 2"],
    found: Sequence[Sequence[Sightings]],
    bias: float,
) -> tuple[Float[np.ndarray, "w 5"], Float[np.ndarray, "n 2"], Float[np.ndarray, "m m"]]:
    """The change of every wire and of every image's shift, and the covariance of the wires' numbers."""
    W, N = len(q), len(shifts)
    first_shift, first_light = 5 * W, 5 * W + 2 * N
    size = first_light + W * DIRECTIONS
    A, b = np.zeros((size, size)), np.zeros(size)
    free = np.arange(size)
    A[free, free] = np.repeat([0.0, 1 / SHIFT_PX**2, 1 / bias**2], [5 * W, 2 * N, W * DIRECTIONS])
    b[first_shift:first_light] = -shifts.ravel() / SHIFT_PX**2
    for w in range(W):
        e = np.concatenate([row[w].e for row in found])
        if not len(e):
            continue
        spread = max(1.4826 * float(np.median(np.abs(e - np.median(e)))), SIGMA_PX)
        for n, one in enumerate(row[w] for row in found):
            if not len(one):
                continue
            # Cauchy: what is far off is another's ridge.
            weight = one.weight / (1 + (one.e / (2.5 * spread)) ** 2) / (spread**2 * ALIKE)
            rows = np.concatenate([_by_q(base, q[w], one), one.normal, _by_light(one)], 1)
            at = np.concatenate([
                5 * w + np.arange(5),
                first_shift + 2 * n + np.arange(2),
                first_light + DIRECTIONS * w + np.arange(DIRECTIONS),
            ])
            A[np.ix_(at, at)] += (rows * weight[:, None]).T @ rows
            b[at] += (rows * weight[:, None]).T @ one.e
    # A wire that no image fixes stays where it is.
    A[free[:first_shift], free[:first_shift]] += 1e-6 * max(float(np.diag(A)[:first_shift].max()), 1e-12)
    covariance = np.linalg.inv(A)
    change = covariance @ b
    return (
        change[:first_shift].reshape(W, 5),
        change[first_shift:first_light].reshape(N, 2),
        covariance[:first_shift, :first_shift],
    )


def _by_light(one: Sightings) -> Float[np.ndarray, "k d"]:
    """|g| in the column of the direction from which the wire is seen, 0 in the others."""
    angle = np.arctan2(one.g[:, 1], one.g[:, 0]) % np.pi
    column = np.minimum((angle / np.pi * DIRECTIONS).astype(int), DIRECTIONS - 1)
    by = np.zeros((len(one), DIRECTIONS))
    by[np.arange(len(one)), column] = np.linalg.norm(one.g, axis=1)
    return by


def _by_q(base: Base, q: Float[np.ndarray, "5"], one: Sightings) -> Float[np.ndarray, "k 5"]:
    """Derivatives of the projected place along the normal by the wire's numbers."""
    place = jacobian(lambda p: base.at(p, one.s).ravel(), q).reshape(-1, 2, 5)
    by: Float[np.ndarray, "k 5"] = np.einsum("ki,kij->kj", one.g, place)
    return by


def _judged(
    base: Base,
    before: Float[np.ndarray, "5"],
    q: Float[np.ndarray, "5"],
    covariance: Float[np.ndarray, "5 5"],
    mine: Sequence[Sightings],
    cameras: Sequence[Cameras],
    reach: float,
    s: Float[np.ndarray, " k"],
) -> Refined:
    """Whether a wire's refinement is to be believed."""
    e, w = (np.concatenate([getattr(one, name) for one in mine]) for name in ("e", "weight"))
    seen, tried = np.zeros(len(s)), np.zeros(len(s))
    for one in mine:
        seen[np.searchsorted(s, one.s[np.abs(one.e) <= CORE_PX] - 1e-12)] += 1
        tried[np.searchsorted(s, one.tried - 1e-12)] += 1
    views = sum(len(one) > 0 for one in mine)
    core = np.abs(e) <= CORE_PX
    rms = float(np.sqrt((w[core] * e[core] ** 2).sum() / w[core].sum())) if core.any() else np.inf
    length = np.concatenate([np.linalg.norm(one.g, axis=1) for one in mine])
    across = float(np.sqrt((w * (e / length) ** 2)[core].sum() / w[core].sum())) if core.any() else np.inf
    moved = float(np.linalg.norm(base.at(q, s) - base.at(before, s), axis=1).max())
    J = jacobian(lambda p: base.at(p, s).ravel(), q).reshape(len(s), 2, 5)
    sigma = float(np.sqrt(np.linalg.eigvalsh(J @ covariance @ J.transpose(0, 2, 1))[:, -1].max()))
    footprint = _footprint(base, q, cameras, s)
    refused = None
    if views < LEAST_VIEWS or (seen > 0).mean() < LEAST_SEEN:
        refused = f"{views} images show {(seen > 0).mean():.0%} of it"
    elif sigma > UNFIXED_PX * footprint:
        refused = f"the views do not fix it: {sigma / footprint:.1f} px across"
    elif moved > reach:
        refused = f"it went {moved / reach:.1f} times as far as it may be off"
    elif rms > MOST_RMS_PX:
        refused = f"its ridges scatter by {rms:.1f} px"
    return Refined(before if refused else q, covariance, rms, across, len(e), views, seen, tried, moved, refused)


def _footprint(
    base: Base, q: Float[np.ndarray, "5"], cameras: Sequence[Cameras], s: Float[np.ndarray, " k"]
) -> float:
    """Width of a pixel on the wire: median over places of the views that magnify it most."""
    most = np.zeros(len(s))
    for camera in cameras:
        seen = track(camera, base, q, s)
        most = np.maximum(most, np.where(seen.good, np.linalg.norm(seen.g, axis=1), 0))
    return float(1 / max(np.median(most), 1e-12))
