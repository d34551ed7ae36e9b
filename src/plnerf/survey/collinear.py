"""Which points lie on wires: what makes a line along the span, seen from several views, and goes on for long.

Letters: n points in a frame whose x axis runs along the span; the radius of a neighbourhood in its units.
"""

import math
from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from plnerf.ops.kernel_cache import inlined, njit
from plnerf.ops.threads import share
from plnerf.survey.config_wires import CollinearConfig


class _Limits(NamedTuple):
    """The numbers that the kernel uses."""

    min_views: int
    min_points: int
    elongation: float
    spread_squared: float
    core_squared: float
    inner_squared: float
    min_core_share: float
    min_dense_share: float
    extent_squared: float
    min_cosine: float


def on_lines(
    points: Float[np.ndarray, "n 3"], view: Int[np.ndarray, " n"], radius: float, config: CollinearConfig
) -> Bool[np.ndarray, " n"]:
    """Which points have neighbours of several views on a line along the span, and few beside it."""
    if not len(points):
        return np.zeros(0, dtype=bool)
    squeezed = points / [config.elongation * radius, radius, radius]
    cells = np.floor(squeezed - squeezed.min(0)).astype(np.int64) + 1
    _, width, height = cells.max(0) + 2
    key = (cells[:, 0] * width + cells[:, 1]) * height + cells[:, 2]
    order = np.argsort(key, kind="stable")
    filled, starts = np.unique(key[order], return_index=True)
    # Neighbours lie in nine columns of three cells each: stretches of the order.
    beside = np.array([[(i * width + j) * height for j in (-1, 0, 1)] for i in (-1, 0, 1)]).ravel()
    stretches = np.stack(
        [
            np.searchsorted(key[order], filled[:, None] + beside - 1, side="left"),
            np.searchsorted(key[order], filled[:, None] + beside + 1, side="right"),
        ],
        -1,
    )
    keep = np.zeros(len(points), dtype=bool)
    kept = np.zeros(len(points), dtype=bool)
    share(
        _on_lines,
        np.ascontiguousarray(points[order] / radius),
        np.ascontiguousarray(np.unique(view, return_inverse=True)[1][order]),
        np.append(starts, len(points)),
        stretches,
        _limits(config),
        kept,
        of=len(filled),
    )
    keep[order] = kept
    return keep


def _limits(config: CollinearConfig) -> _Limits:
    return _Limits(
        config.min_views, config.min_points, float(config.elongation), float(config.max_spread**2),
        float(config.core**2), float((config.core / 2) ** 2), float(config.min_core_share),
        float(config.min_dense_share), float(config.min_extent**2),
        math.cos(math.radians(config.max_turn_deg)),
    )  # fmt: skip


@no_type_check
@njit(cache=True)
def _on_lines(points, view, starts, stretches, limits, keep, start, stop):
    """Into keep (n,): `on_lines` of points in radii, sorted by the cells that begin at `starts`.

    stretches (cells, 9, 2): where in the order the neighbours of a cell's points are.
    """
    views = view.max() + 1
    for cell in range(start, stop):
        seen = np.full(views, -1)
        most = (stretches[cell, :, 1] - stretches[cell, :, 0]).sum()
        near, whose = np.empty((most, 3)), np.empty(most, np.int64)
        for n in range(starts[cell], starts[cell + 1]):
            count = _gather(points, view, stretches[cell], n, limits.elongation, near, whose)
            if count < limits.min_points:
                continue
            x, y, z, straight = _axis(near[:count], limits.spread_squared)
            if not straight or abs(x) <= limits.min_cosine:
                continue
            # The line through the middle of what lies near the point: the point itself may be off.
            core, mx, my, mz = 0, 0.0, 0.0, 0.0
            for m in range(count):
                if _across(near[m, 0], near[m, 1], near[m, 2], x, y, z) < limits.core_squared:
                    core += 1
                    mx, my, mz = mx + near[m, 0], my + near[m, 1], mz + near[m, 2]
            mx, my, mz = mx / core, my / core, mz / core
            core, inner, different, length = 0, 0, 0, 0.0
            for m in range(count):
                u, v, w = near[m, 0] - mx, near[m, 1] - my, near[m, 2] - mz
                across = _across(u, v, w, x, y, z)
                if across < limits.core_squared:
                    core += 1
                    inner += across < limits.inner_squared
                    length += (u * x + v * y + w * z) ** 2
                    different += seen[whose[m]] != n
                    seen[whose[m]] = n
            enough = core >= max(limits.min_points, limits.min_core_share * count)
            enough = enough and different >= limits.min_views and inner >= limits.min_dense_share * core
            keep[n] = enough and length >= limits.extent_squared * core


@no_type_check
@njit(cache=True)
def _gather(points, view, stretches, n, elongation, near, whose):
    """Into near and whose: offsets and views of the points around point n; returns how many there are."""
    count = 0
    for k in range(len(stretches)):
        for m in range(stretches[k, 0], stretches[k, 1]):
            x, y, z = points[m, 0] - points[n, 0], points[m, 1] - points[n, 1], points[m, 2] - points[n, 2]
            if (x / elongation) ** 2 + y * y + z * z <= 1:
                near[count, 0], near[count, 1], near[count, 2] = x, y, z
                whose[count] = view[m]
                count += 1
    return count


@no_type_check
@njit(cache=True)
def _axis(near, spread_squared):
    """Direction of the largest spread of some offsets, and whether they spread much less across it."""
    middle, spread = np.zeros(3), np.zeros((3, 3))
    for m in range(len(near)):
        for i in range(3):
            middle[i] += near[m, i]
            for j in range(3):
                spread[i, j] += near[m, i] * near[m, j]
    values, axes = np.linalg.eigh(spread - np.outer(middle, middle) / len(near))
    return axes[0, 2], axes[1, 2], axes[2, 2], values[1] < spread_squared * values[2]


@no_type_check
@inlined()
def _across(u, v, w, x, y, z):
    """Squared distance of an offset from the axis (x, y, z)."""
    along = u * x + v * y + w * z
    return u * u + v * v + w * w - along * along


def in_long_pieces(
    points: Float[np.ndarray, "n 3"], radius: float, config: CollinearConfig
) -> Bool[np.ndarray, " n"]:
    """Which points belong to connected pieces that are long enough for a conductor."""
    if not len(points):
        return np.zeros(0, dtype=bool)
    cells, of_point = np.unique(
        np.floor(points / [config.elongation, 1, 1] / (config.cell * radius)).astype(np.int64),
        axis=0,
        return_inverse=True,
    )
    pairs = cKDTree(cells).query_pairs(config.max_gap / config.cell, output_type="ndarray")
    linked = coo_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(len(cells), len(cells)))
    count, piece = connected_components(linked, directed=False)
    piece = piece[of_point]
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, piece, points[:, 0])
    np.maximum.at(high, piece, points[:, 0])
    long: Bool[np.ndarray, " n"] = (high - low)[piece] >= config.min_length * radius
    return long
