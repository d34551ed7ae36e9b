"""The similarity between a reconstruction and the positions its cameras are said to have.

    y = s R x + t        x (n 3) in the reconstruction, y (n 3) in metres

Positions on one straight line leave the turn about that line free, its roll: nothing in them speaks of it.
The fit says how well it is known; with a direction of gravity in the reconstruction it is known again.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from plnerf.errors import CaptureError

ROUNDS = 500
"""Random triples that are tried: with half of the positions wrong, all of an even half of them hold a wrong
one once in 10^14 times."""
INLIER_SIGMAS = 4.0
"""A position further off than so many of its standard deviations is wrong."""


@dataclass(frozen=True, eq=False)
class Similarity:
    """y = scale R x + shift."""

    scale: float
    R: Float[np.ndarray, "3 3"]
    shift: Float[np.ndarray, "3"]

    def __call__(self, x: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Points of the reconstruction in metres."""
        moved: Float[np.ndarray, "*n 3"] = self.scale * (x @ self.R.T) + self.shift
        return moved


@dataclass(frozen=True, eq=False)
class RobustFit:
    """A similarity, and how far it may be trusted."""

    similarity: Similarity
    inlier: Bool[np.ndarray, " n"]
    residual: Float[np.ndarray, "n 3"]
    """s R x + t - y, of outliers too."""
    roll_sigma_deg: float
    """Standard deviation of the turn about the track's direction as positions alone have it; infinite on an
    exact line."""
    scale_sigma: float
    """Relative standard deviation of the scale."""


def fit_similarity(
    x: Float[np.ndarray, "n 3"], y: Float[np.ndarray, "n 3"], w: Float[np.ndarray, " n"] | None = None
) -> Similarity:
    """The similarity of least weighted squares, without mirroring.  Umeyama 1991, eq. 40-43.

    On a line of points it is one of many.
    """
    w = np.full(len(x), 1.0 / len(x)) if w is None else w / w.sum()
    from_x, from_y = w @ x, w @ y
    dx, dy = x - from_x, y - from_y
    u, d, vt = np.linalg.svd((w[:, None] * dy).T @ dx)
    sign = np.array([1.0, 1.0, np.linalg.det(u) * np.linalg.det(vt)])
    R = u @ (sign[:, None] * vt)
    scale = float((d * sign).sum() / max((w * (dx**2).sum(1)).sum(), 1e-300))
    return Similarity(scale, R, from_y - scale * R @ from_x)


def fit_upright(
    x: Float[np.ndarray, "n 3"], y: Float[np.ndarray, "n 3"], up: Float[np.ndarray, "3"],
    w: Float[np.ndarray, " n"] | None = None,
) -> Similarity:  # fmt: skip
    """Likewise, among those that turn `up` of the reconstruction into z: of the rotation only a heading."""
    w = np.full(len(x), 1.0 / len(x)) if w is None else w / w.sum()
    level = upright_rotation(up)
    from_x, from_y = w @ x, w @ y
    dx, dy = (x - from_x) @ level.T, y - from_y
    flat = (w * (dx[:, 0] + 1j * dx[:, 1]).conj() * (dy[:, 0] + 1j * dy[:, 1])).sum()
    c, s = (flat / max(abs(flat), 1e-300)).real, (flat / max(abs(flat), 1e-300)).imag
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ level
    turned = (x - from_x) @ R.T
    scale = float((w[:, None] * turned * dy).sum() / max((w[:, None] * turned**2).sum(), 1e-300))
    return Similarity(scale, R, from_y - scale * R @ from_x)


def upright_rotation(up: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """The smallest rotation that turns `up` into z."""
    found: Float[np.ndarray, "3 3"] = Rotation.align_vectors([[0, 0, 1.0]], up[None])[0].as_matrix()
    return found


def robust_similarity(
    x: Float[np.ndarray, "n 3"],
    y: Float[np.ndarray, "n 3"],
    sigma: Float[np.ndarray, "n 3"],
    up: Float[np.ndarray, "3"] | None = None,
    seed: int = 0,
) -> RobustFit:
    """The similarity that most positions agree on, whatever the others say.

    sigma: standard deviations of y in metres.  up: gravity's opposite in the reconstruction, which must then
    become z.  Samples of three (two with `up`) are tried, and the best one is refined over those that agree
    with it, until these stay the same.  Raises CaptureError for fewer than three positions, and where no
    more than three (two) agree.
    """
    need = 3 if up is None else 2
    if len(x) < 3:
        raise CaptureError(
            f"{len(x)} images have both a pose and a position, but georeferencing needs three or more. Give "
            "positions of more images (EXIF GPS, or geo.txt), or control points."
        )

    def fit(chosen: np.ndarray, w: Float[np.ndarray, " n"] | None = None) -> Similarity:
        if up is None:
            return fit_similarity(x[chosen], y[chosen], w)
        return fit_upright(x[chosen], y[chosen], up, w)

    random = np.random.default_rng(seed)
    best, least = None, np.inf
    # Half of the samples prefer what is known best: a few control points among many poor positions.
    preferred = (1 / sigma.mean(1)) / (1 / sigma.mean(1)).sum()
    for k in range(ROUNDS):
        chosen = random.choice(len(x), need, replace=False, p=preferred if k % 2 else None)
        found = fit(chosen)
        if found.scale <= 0:
            continue
        off = _off(found, x, y, sigma)
        cost = float(np.minimum(off, INLIER_SIGMAS).sum())
        if cost < least:
            best, least = found, cost
    inlier = np.zeros(len(x), bool)
    for _ in range(20):
        now = inlier if best is None else _off(best, x, y, sigma) <= INLIER_SIGMAS
        if best is None or (now == inlier).all() or now.sum() < need:
            break
        inlier = now
        best = _refined(fit(np.nonzero(inlier)[0]), x[inlier], y[inlier], sigma[inlier], up)
    if best is None or inlier.sum() < min(need + 1, len(x)):
        raise CaptureError(
            f"Of {len(x)} positions not {need + 1} agree with the reconstruction within {INLIER_SIGMAS:g} "
            f"standard deviations (median {np.median(sigma):.2g} m). Are they those of these images, in the "
            "stated coordinate reference system, and are their stated accuracies true?"
        )
    residual = best(x) - y
    roll, scale = _sigmas(best(x[inlier]), sigma[inlier])
    return RobustFit(best, inlier, residual, roll, scale)


def _off(
    found: Similarity,
    x: Float[np.ndarray, "n 3"],
    y: Float[np.ndarray, "n 3"],
    sigma: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, " n"]:
    """How far positions are off, in standard deviations."""
    off: Float[np.ndarray, " n"] = np.sqrt((((found(x) - y) / sigma) ** 2).mean(1))
    return off


def _refined(
    start: Similarity,
    x: Float[np.ndarray, "n 3"],
    y: Float[np.ndarray, "n 3"],
    sigma: Float[np.ndarray, "n 3"],
    up: Float[np.ndarray, "3"] | None,
) -> Similarity:
    """Least squares in standard deviations, which heights and sides may have their own of."""
    middle, size = x.mean(0), max(float(np.abs(x - x.mean(0)).max()), 1e-300)
    centre = start(middle)

    def similarity(p: Float[np.ndarray, " k"]) -> Similarity:
        turn = p[4:7] if up is None else np.array([0.0, 0.0, p[4]])
        scale = start.scale * float(np.exp(p[3]))
        R = Rotation.from_rotvec(turn).as_matrix() @ start.R
        return Similarity(scale, R, centre + start.scale * size * p[:3] - scale * R @ middle)

    def errors(p: Float[np.ndarray, " k"]) -> Float[np.ndarray, " m"]:
        off: Float[np.ndarray, " m"] = ((similarity(p)(x) - y) / sigma).ravel()
        return off

    # On a line, the turn about it changes nothing: damped steps leave it as it is.
    return similarity(least_squares(errors, np.zeros(7 if up is None else 5), method="trf").x)


def _sigmas(y: Float[np.ndarray, "n 3"], sigma: Float[np.ndarray, "n 3"]) -> tuple[float, float]:
    """How well the turn about the main axis is held, in degrees, and the scale, relatively.

    1 / sqrt(sum of (lever / sigma)^2): the levers are the distances from the axis, and from the middle.
    """
    w = 1 / sigma.mean(1) ** 2
    off = y - (w @ y) / w.sum()
    along, *beside = np.linalg.svd(np.sqrt(w)[:, None] * off, compute_uv=False)
    lever = float(np.hypot(*beside)) if len(beside) == 2 else 0.0
    roll = np.degrees(1 / lever) if lever > 1e-9 * along else np.inf
    return float(roll), float(1 / max(np.hypot(along, lever), 1e-300))
