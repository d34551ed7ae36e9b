"""The long thin lines of each image as curves, in the plane at depth 1 of its camera without its lens.

A chain is what hangs together of a ridge map: a wire between two places where something hides it or where it
is lost in texture, or the edge of a road, or a row of grass.

Letters: c chains of all views together; along each, t runs in its own direction u, and v = p0 + p1 t + p2 t^2
across.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Int

from plnerf.detect.config_lines import ChainConfig
from plnerf.detect.views import Views


class Chains(NamedTuple):
    """The chains of some views, those of one view after another's."""

    owner: Int[np.ndarray, " c"]
    along: Float[np.ndarray, "c 2"]
    """u: unit vector in the plane at depth 1."""
    bend: Float[np.ndarray, "c 3"]
    """p0, p1, p2."""
    ends: Float[np.ndarray, "c 2"]
    """Least and greatest t."""
    first: Int[np.ndarray, " n+1"]
    """Index of the first chain of each view, and at last how many chains there are."""


def chains_of(
    responses: Float[np.ndarray, " p"], views: Views, min_response: float, config: ChainConfig
) -> Chains:
    """The longest chains of each view that are one curve; responses: 0 where there is no ridge."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        found = list(
            pool.map(lambda n: _of_view(responses, views, n, min_response, config), range(len(views.sizes)))
        )
    counts = [len(part) for part in found]
    rows = np.concatenate([np.zeros((0, 7)), *found])
    owner = np.repeat(np.arange(len(found)), counts)
    along, bend, ends = (np.ascontiguousarray(part) for part in np.split(rows, (2, 5), axis=1))
    return Chains(owner, along, bend, ends, np.concatenate([[0], np.cumsum(counts)]))


def _of_view(
    responses: Float[np.ndarray, " p"], views: Views, n: int, min_response: float, config: ChainConfig
) -> Float[np.ndarray, "c 7"]:
    """Rows (u, p, first t, last t)."""
    w, h = views.sizes[n]
    ridge = responses[views.starts[n] : views.starts[n] + w * h].reshape(h, w) >= min_response
    _, label, stats, _ = cv2.connectedComponentsWithStats(ridge.astype(np.uint8), connectivity=8)
    extent = np.hypot(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT])
    extent[0] = 0.0  # what is no ridge
    longest = np.argsort(-extent, kind="stable")[: config.most]
    longest = longest[extent[longest] >= config.least_px]
    if not len(longest):
        return np.zeros((0, 7))
    number = np.full(len(extent), -1)
    number[longest] = np.arange(len(longest))
    rows, columns = np.nonzero(ridge)
    chain = number[label[rows, columns]]
    at = np.stack([columns, rows], 1)[chain >= 0] + 0.5
    curves, rms = curves_through(without_lens(at, views, n), chain[chain >= 0], len(longest))
    return curves[rms * views.focal[n, 0] <= config.rms_px]


def without_lens(at: Float[np.ndarray, "m 2"], views: Views, n: int) -> Float[np.ndarray, "m 2"]:
    """Pixels in the plane at depth 1."""
    if not views.distortion[n].any() or not len(at):
        return (at - views.principal[n]) / views.focal[n]
    K = np.diag([*views.focal[n], 1.0])
    K[:2, 2] = views.principal[n]
    return cv2.undistortPoints(at[:, None], K, views.distortion[n])[:, 0]


def curves_through(
    uv: Float[np.ndarray, "m 2"], chain: Int[np.ndarray, " m"], count: int
) -> tuple[Float[np.ndarray, "c 7"], Float[np.ndarray, " c"]]:
    """Rows (u, p, first t, last t) of the curve nearest to the points of each chain, and its rms distance.

    Least squares by moments, for all chains at once.
    """

    def sums(values: Float[np.ndarray, " m"]) -> Float[np.ndarray, " c"]:
        return np.bincount(chain, values, count)

    pixels = np.maximum(sums(np.ones(len(uv))), 1)
    middle = np.stack([sums(uv[:, k]) / pixels for k in (0, 1)], 1)
    d = uv - middle[chain]
    turn = np.arctan2(2 * sums(d[:, 0] * d[:, 1]), sums(d[:, 0] ** 2) - sums(d[:, 1] ** 2)) / 2
    u, v = np.cos(turn), np.sin(turn)
    t, across = d[:, 0] * u[chain] + d[:, 1] * v[chain], d[:, 1] * u[chain] - d[:, 0] * v[chain]
    ends = np.zeros((count, 2))
    np.minimum.at(ends[:, 0], chain, t)
    np.maximum.at(ends[:, 1], chain, t)
    half = np.maximum(np.abs(ends).max(1, initial=0), 1e-12)
    powers = (t / half[chain]) ** np.arange(3)[:, None]
    A = np.array([[sums(one * other) for other in powers] for one in powers]).transpose(2, 0, 1)
    right = np.array([sums(one * across) for one in powers]).T
    q = np.linalg.solve(A + 1e-9 * pixels[:, None, None] * np.eye(3), right[..., None])[..., 0]
    rms = np.sqrt(sums((across - (q[chain].T * powers).sum(0)) ** 2) / pixels)
    # About the camera's axis rather than the chain's middle.
    p = q / half[:, None] ** np.arange(3)
    along, aside = middle[:, 0] * u + middle[:, 1] * v, middle[:, 1] * u - middle[:, 0] * v
    p0, p1 = p[:, 0] - p[:, 1] * along + p[:, 2] * along**2 + aside, p[:, 1] - 2 * p[:, 2] * along
    return np.stack([u, v, p0, p1, p[:, 2], *(ends + along[:, None]).T], 1), rms
