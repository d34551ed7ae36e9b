"""The depth of photos by a plane sweep, dense enough to say what hides a wire.

R. Collins, "A space-sweep approach to true multi-image matching", CVPR 1996: a plane before the camera is
moved from near to far, the other photos are seen through it, and a pixel's depth is where they agree.

Letters: h x w pixels of the reduced, undistorted photo; d the depth of a plane z = d of its camera.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from plnerf.errors import SceneError
from plnerf.scene.decode import read_rgb
from plnerf.synth.hang_config import HangDepthConfig
from plnerf.synth.hang_views import PhotoView

EVEN = 4.0
"""Variance of grey values (0 to 255) that is added, so that even squares, as of the sky, do not match."""


@dataclass(frozen=True, eq=False)
class Small:
    """A reduced photo without lens distortion."""

    grey: Float[np.ndarray, "h w"]
    valid: Float[np.ndarray, "h w"]
    """1 where the photo shows something."""
    K: Float[np.ndarray, "3 3"]
    """Pixels of the plane z = 1; the first pixel's centre is (0, 0), as in OpenCV."""


@dataclass(frozen=True, eq=False)
class Depth:
    """Depth along the camera's z axis of one photo."""

    z: Float[np.ndarray, "h w"]
    """Known or filled."""
    known: Bool[np.ndarray, "h w"]
    K: Float[np.ndarray, "3 3"]

    @cached_property
    def typical(self) -> float:
        """Median of what is known."""
        return float(np.median(self.z[self.known] if self.known.any() else self.z))

    def at(self, plane: Float[np.ndarray, "p 2"]) -> Float[np.ndarray, " p"]:
        """Depths where rays meet the plane z = 1; beyond the photo those of its edge."""
        at = (plane @ self.K[:2, :2].T + self.K[:2, 2]).astype(np.float32)
        h, w = self.z.shape
        x, y = np.clip(at[:, 0], 0, w - 1), np.clip(at[:, 1], 0, h - 1)
        column, row = np.minimum(x.astype(int), w - 2), np.minimum(y.astype(int), h - 2)
        fx, fy = x - column, y - row
        z = self.z
        above = z[row, column] * (1 - fx) + z[row, column + 1] * fx
        below = z[row + 1, column] * (1 - fx) + z[row + 1, column + 1] * fx
        found: Float[np.ndarray, " p"] = (above * (1 - fy) + below * fy).astype(np.float64)
        return found


def photo_depths(
    views: Sequence[PhotoView], config: HangDepthConfig, progress: Callable[[int, int], object]
) -> list[Depth]:
    """The depth of every photo.  Raises SceneError where hardly any of them can be matched."""
    smalls = []
    for k, view in enumerate(views):
        smalls.append(reduced(view, config.longest_px))
        progress(k + 1, 3 * len(views))
    distances = []
    for k in range(len(views)):
        distances.append(_first_distance(views, smalls, k, config))
        progress(len(views) + k + 1, 3 * len(views))
    known = [d for d in distances if d is not None]
    if len(known) < max(2, len(views) // 4):
        raise SceneError(
            f"Of {len(views)} photos only {len(known)} could be matched with others, so that the scene's "
            "depth is not known and no wire can be hung in it. Take photos that overlap by two thirds, or "
            "check the poses."
        )
    middle, most = float(np.median(known)), config.most_off
    typical = [middle if d is None or not middle / most < d < most * middle else d for d in distances]
    raw, chosen = [], []
    for k in range(len(views)):
        partners = _partners(views, k, typical[k], config)
        raw.append(_swept(views, smalls, k, partners, typical[k], config))
        chosen.append(partners)
        progress(2 * len(views) + k + 1, 3 * len(views))
    own = [_cleaned(_agreed(views, smalls, raw, k, chosen[k], config), config) for k in range(len(views))]
    cloud = np.concatenate([_points(views[k], smalls[k], own[k]) for k in range(len(views))])
    return [
        _filled(np.fmin(own[k], _seen(cloud, views[k], smalls[k])), smalls[k].K, typical[k], config)
        for k in range(len(views))
    ]


def reduced(view: PhotoView, longest_px: int) -> Small:
    """A photo's grey values at a smaller size, its lens distortion taken out."""
    rgb = read_rgb(view.path)
    factor = longest_px / max(view.width, view.height)
    size = max(8, round(view.width * factor)), max(8, round(view.height * factor))
    small = cv2.cvtColor(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
    shrink = np.array(size) / (view.width, view.height)
    K = np.eye(3)
    K[[0, 1], [0, 1]] = view.focal_px * shrink
    K[:2, 2] = view.principal_px * shrink - 0.5
    x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    plane = (np.stack([x, y], -1) - K[:2, 2]) / K[[0, 1], [0, 1]]
    at = (view.pixels(plane) * shrink - 0.5).astype(np.float32)
    inside = ((at >= -0.5) & (at <= np.array(size) - 0.5)).all(-1)
    inside &= np.linalg.norm(plane, axis=-1) < view.reach
    grey = cv2.remap(
        small.astype(np.float32), at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return Small(grey, inside.astype(np.float32), K)


def _first_distance(
    views: Sequence[PhotoView], smalls: Sequence[Small], k: int, config: HangDepthConfig
) -> float | None:
    """Median depth of a photo from partners near to it, over a wide range; None where little matches."""
    turned = np.array([view.axis for view in views]) @ views[k].axis
    apart = np.linalg.norm([view.centre - views[k].centre for view in views], axis=1)
    may = np.flatnonzero((turned > np.cos(np.radians(config.max_turn_deg))) & (apart > 0))
    order = may[np.argsort(apart[may], kind="stable")]
    partners = [int(order[rank - 1]) for rank in config.ranks if rank <= len(order)]
    if not partners:
        return None
    # The nearest distance is the one that moves the middle partner by half of the photo.
    f, size = float(smalls[k].K[0, 0]), max(smalls[k].grey.shape)
    nearest = 2 * f * float(np.median(apart[partners])) / size / 4
    planes = nearest * config.range_ratio ** np.linspace(0, 1, config.range_steps)
    z, score = _best(views, smalls, k, partners, planes, config)
    good = score > config.min_score
    return float(np.median(z[good])) if good.mean() > 0.05 else None


def _partners(views: Sequence[PhotoView], k: int, typical: float, config: HangDepthConfig) -> list[int]:
    turned = np.array([view.axis for view in views]) @ views[k].axis
    b = np.linalg.norm([view.centre - views[k].centre for view in views], axis=1) / typical
    low, high = config.baselines
    may = np.flatnonzero((turned > np.cos(np.radians(config.max_turn_deg))) & (b >= low) & (b <= high))
    order = may[np.argsort(np.abs(np.log(b[may] / config.best_baseline)), kind="stable")]
    return [int(j) for j in order[: config.partners]]


def _swept(
    views: Sequence[PhotoView],
    smalls: Sequence[Small],
    k: int,
    partners: Sequence[int],
    typical: float,
    config: HangDepthConfig,
) -> Float[np.ndarray, "h w"]:
    """Depths where the partners agree on one alone; NaN elsewhere."""
    if not partners:
        return np.full(smalls[k].grey.shape, np.nan)
    b = float(np.median([np.linalg.norm(views[j].centre - views[k].centre) for j in partners]))
    near, far = 1 / (config.nearest * typical), 1 / (config.farthest * typical)
    shift_px = float(smalls[k].K[0, 0]) * b * (near - far)
    planes = 1 / np.linspace(near, far, max(8, round(shift_px / config.step_px)))
    z, score = _best(views, smalls, k, partners, planes, config, unique=True)
    return np.where((score > config.min_score) & (smalls[k].valid > 0), z, np.nan)


def _best(
    views: Sequence[PhotoView],
    smalls: Sequence[Small],
    k: int,
    partners: Sequence[int],
    planes: Float[np.ndarray, " m"],
    config: HangDepthConfig,
    *,
    unique: bool = False,
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """For every pixel the plane of the highest score, and that score; unique: 0 where another does as well.

    A plane's score is the mean correlation of the better half of the partners: to others it may be hidden.
    """
    shape = smalls[k].grey.shape
    scores = np.zeros((len(planes), *shape), np.float32)
    mine = _moments(smalls[k].grey, config.block_px)
    half = max(1, (len(partners) + 1) // 2)
    for m, d in enumerate(planes):
        each = np.stack([_correlation(views, smalls, k, j, d, mine, config.block_px) for j in partners])
        scores[m] = np.sort(each, 0)[-half:].mean(0)
    at = scores.argmax(0)
    score = np.take_along_axis(scores, at[None], 0)[0]
    if unique:
        second = np.zeros(shape, np.float32)
        best = planes[at]
        for m, d in enumerate(planes):
            other = np.abs(d / best - 1) > config.agree
            np.maximum(second, np.where(other, scores[m], 0), out=second)
        score = np.where(score - second > config.unique, score, 0)
    return planes[at], score


def _moments(grey: Float[np.ndarray, "h w"], block: int) -> tuple[np.ndarray, np.ndarray]:
    mean = cv2.boxFilter(grey, cv2.CV_32F, (block, block))
    return mean, cv2.boxFilter(grey * grey, cv2.CV_32F, (block, block)) - mean * mean


def _correlation(
    views: Sequence[PhotoView],
    smalls: Sequence[Small],
    k: int,
    j: int,
    d: float,
    mine: tuple[np.ndarray, np.ndarray],
    block: int,
) -> Float[np.ndarray, "h w"]:
    """Normalised cross-correlation of photo k with photo j seen through the plane z = d of k's camera."""
    R = views[j].R_world_camera.T @ views[k].R_world_camera
    t = views[j].R_world_camera.T @ (views[k].centre - views[j].centre)
    H = smalls[j].K @ (R + np.outer(t, [0.0, 0.0, 1.0]) / d) @ np.linalg.inv(smalls[k].K)
    h, w = smalls[k].grey.shape
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    grey = cv2.warpPerspective(smalls[j].grey, H, (w, h), flags=flags)
    valid = cv2.warpPerspective(smalls[j].valid, H, (w, h), flags=flags)
    mean, variance = mine
    other, other_variance = _moments(grey, block)
    both = cv2.boxFilter(smalls[k].grey * grey, cv2.CV_32F, (block, block)) - mean * other
    found: Float[np.ndarray, "h w"] = both / np.sqrt(
        (np.maximum(variance, 0) + EVEN) * (np.maximum(other_variance, 0) + EVEN)
    )
    return np.where(cv2.boxFilter(valid, cv2.CV_32F, (block, block)) > 0.99, found, 0.0)


def _agreed(
    views: Sequence[PhotoView],
    smalls: Sequence[Small],
    raw: Sequence[Float[np.ndarray, "h w"]],
    k: int,
    partners: Sequence[int],
    config: HangDepthConfig,
) -> Float[np.ndarray, "h w"]:
    """The depths of photo k with which those of enough partners agree; NaN elsewhere."""
    world = _points(views[k], smalls[k], raw[k])
    votes: Int[np.ndarray, " p"] = np.zeros(len(world), np.int64)
    for j in partners:
        at, z, inside = _onto(world, views[j], smalls[j])
        theirs = np.full(len(world), np.nan)
        theirs[inside] = raw[j][at[inside, 1], at[inside, 0]]
        votes += np.abs(theirs / z - 1) < config.agree
    out = raw[k].copy()
    out[np.isfinite(out)] = np.where(votes >= config.min_agreeing, out[np.isfinite(out)], np.nan)
    return out


def _points(view: PhotoView, small: Small, z: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "p 3"]:
    """World points of the pixels of known depth, row by row."""
    row, column = np.nonzero(np.isfinite(z))
    flat = (np.stack([column, row], 1) - small.K[:2, 2]) / small.K[[0, 1], [0, 1]]
    local = np.column_stack([flat, np.ones(len(flat))]) * z[row, column][:, None]
    world: Float[np.ndarray, "p 3"] = local @ view.R_world_camera.T + view.centre
    return world


def _onto(
    world: Float[np.ndarray, "p 3"], view: PhotoView, small: Small
) -> tuple[Int[np.ndarray, "p 2"], Float[np.ndarray, " p"], Bool[np.ndarray, " p"]]:
    """The pixels (column, row) of the reduced photo that show points, their depths, and which are in it."""
    local = view.local(world)
    inside = local[:, 2] > 0
    z = np.where(inside, local[:, 2], 1.0)
    at = np.rint(local[:, :2] / z[:, None] @ small.K[:2, :2].T + small.K[:2, 2])
    h, w = small.grey.shape
    inside &= (at >= 0).all(1) & (at < (w, h)).all(1)
    return np.where(inside[:, None], at, 0).astype(np.int64), z, inside


def _cleaned(z: Float[np.ndarray, "h w"], config: HangDepthConfig) -> Float[np.ndarray, "h w"]:
    """Without small regions of even depth: chance matches, as in the leaves of trees or on water."""
    if not np.isfinite(z).any():
        return z
    # In logarithms a step of 1000 agree is a relative difference of `agree`; 16 bits hold a factor of e^16.
    log = np.where(np.isfinite(z), 1000 * (np.log(z / np.nanmedian(z)) + 16), 0).astype(np.int16)
    cv2.filterSpeckles(log, 0, config.speckle_px, 1000 * config.agree)
    return np.where(log > 0, z, np.nan)


def _seen(world: Float[np.ndarray, "p 3"], view: PhotoView, small: Small) -> Float[np.ndarray, "h w"]:
    """Depths of the nearest points, as all photos know them, that fall on each pixel; NaN where none does."""
    at, z, inside = _onto(world, view, small)
    nearest = np.full(small.grey.shape, np.inf)
    np.minimum.at(nearest, (at[inside, 1], at[inside, 0]), z[inside])
    return np.where(np.isfinite(nearest), nearest, np.nan)


def _filled(
    z: Float[np.ndarray, "h w"], K: Float[np.ndarray, "3 3"], typical: float, config: HangDepthConfig
) -> Depth:
    """A pixel of unknown depth takes the least depth of the nearest known ones: a wire is drawn there only
    if it is nearer than all that is known around."""
    known = np.isfinite(z)
    if known.sum() < config.around:
        return Depth(np.full(z.shape, typical, np.float32), np.zeros(z.shape, np.bool_), K)
    at = np.argwhere(known)
    _, near = cKDTree(at).query(np.argwhere(~known), k=config.around)
    filled = z.copy()
    filled[~known] = z[known][near].min(1)
    return Depth(cv2.medianBlur(filled.astype(np.float32), 3), known, K)
