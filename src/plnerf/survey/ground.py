"""The ground under a point cloud, heights above it, and vegetation told by height.

A progressive morphological filter: K. Zhang, S.-C. Chen, D. Whitman, M.-L. Shyu, J. Yan, C. Zhang, "A
progressive morphological filter for removing nonground measurements from airborne LIDAR data", IEEE TGRS
41(4), 2003.  The lowest points of a grid's cells are opened with ever larger windows; a cell that an opening
lowers by more than its threshold is no ground.

Letters: n points; r x c cells (rows along y, columns along x), z heights at their middles; metres, z up.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy import ndimage
from scipy.interpolate import LinearNDInterpolator

from plnerf.survey.model import HIGH_VEGETATION, LOW_VEGETATION, VEGETATION

CELL_M = 1.0
MOST_CELLS = 10_000_000
"""Cells grow where there would be more: memory is bounded by the grid."""
WINDOWS = (3, 5, 9, 17, 33)
"""Of the openings, in cells: 2^k + 1, as in the paper.  What is wider than the last (a hall) stays ground."""
STEEP = 0.3
"""Slope of the terrain beyond its mean slope, which is taken out first."""
LEAST_STEP_M, MOST_STEP_M = 0.3, 2.5
"""dh_0 and dh_max of the paper's eq. 7, the threshold s (w_k - w_(k-1)) c + dh_0."""
PIT_M, PIT_AROUND, PIT_RANK = 1.5, 7, 3
"""A cell this much below the fourth lowest of those around is an error of measurement, not ground."""
WHOLE_SHARE = 0.2
"""Of the cells with points, how many must have points all around (8 of 9 at least): ground is a surface,
while wires and towers alone are lines."""
NEAR_M = 0.3
"""Points this near to the ground's surface, above or below, are ground."""
LOW_M, HIGH_M = 0.5, 2.0
"""Vegetation is low below the one, high from the other on: LAS names the bands and leaves the bounds open."""


@dataclass(frozen=True, eq=False)
class Ground:
    """Heights of the ground on a grid, its holes filled."""

    corner: Float[np.ndarray, "2"]
    """World x and y of the first cell's middle."""
    cell_m: float
    z: Float[np.ndarray, "r c"]

    def below(self, points: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
        """Height of the ground at the points' x and y, bilinear; beyond the grid that of its border."""
        at = (points[:, 1::-1] - self.corner[::-1]) / self.cell_m
        z: Float[np.ndarray, " n"] = ndimage.map_coordinates(self.z, at.T, order=1, mode="nearest")
        return z

    def above(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Heights of points above the ground; negative beneath it."""
        return points[:, 2] - self.below(points)


def find_ground(points: Float[np.ndarray, "n 3"], cell_m: float = CELL_M) -> Ground | None:
    """The ground of a cloud of finite points; None where they nowhere make a surface.

    cell_m should be wider than the points' spacing on the ground.  Cells without points (water, shadow) are
    filled linearly from those around.
    """
    corner = points[:, :2].min(0)
    extent = np.ptp(points[:, :2], axis=0)
    cell_m = max(cell_m, float(np.sqrt(extent.prod() / MOST_CELLS)))
    lowest = _lowest(points, corner, cell_m)
    seen = np.isfinite(lowest)
    whole = seen & (ndimage.uniform_filter(seen.astype(np.float64), 3, mode="constant") > 7.5 / 9)
    if whole.sum() < WHOLE_SHARE * seen.sum():
        return None
    around = ndimage.rank_filter(lowest, PIT_RANK, size=PIT_AROUND, mode="constant", cval=np.inf)
    with np.errstate(invalid="ignore"):  # inf - inf, where nothing is seen
        seen &= ~(around - lowest > PIT_M)
    middles = corner + cell_m / 2
    trend = _trend(lowest, seen)
    flat = np.where(seen, lowest - trend, np.inf)
    ground = _opened(flat, cell_m)
    return Ground(middles, cell_m, _filled(flat, ground) + trend)


def is_ground(points: Float[np.ndarray, "n 3"], ground: Ground) -> Bool[np.ndarray, " n"]:
    """Which points lie on the ground."""
    return np.abs(ground.above(points)) <= NEAR_M


def vegetation(above: Float[np.ndarray, " n"]) -> UInt8[np.ndarray, " n"]:
    """LAS class of plants by their height above the ground: 3 below 0.5 m, 4 below 2 m, else 5."""
    bands = np.array([LOW_VEGETATION, VEGETATION, HIGH_VEGETATION], np.uint8)
    return bands[np.digitize(above, [LOW_M, HIGH_M])]


def _lowest(
    points: Float[np.ndarray, "n 3"], corner: Float[np.ndarray, "2"], cell_m: float
) -> Float[np.ndarray, "r c"]:
    """Height of the lowest point of each cell; infinite without points."""
    cell = ((points[:, :2] - corner) // cell_m).astype(np.int64)
    column, row = cell[:, 0], cell[:, 1]
    lowest = np.full((row.max() + 1, column.max() + 1), np.inf)
    np.minimum.at(lowest, (row, column), points[:, 2])
    return lowest


def _trend(lowest: Float[np.ndarray, "r c"], seen: Bool[np.ndarray, "r c"]) -> Float[np.ndarray, "r c"]:
    """The plane through the lowest cells: at the grid's borders openings would lower a slope."""
    cells = np.argwhere(seen)
    A = np.column_stack([np.ones(len(cells)), cells])
    plane = np.linalg.lstsq(A, lowest[seen], rcond=None)[0]
    rows, columns = np.ogrid[: lowest.shape[0], : lowest.shape[1]]
    trend: Float[np.ndarray, "r c"] = plane[0] + plane[1] * rows + plane[2] * columns
    return trend


def _filled_with_nearest(
    z: Float[np.ndarray, "r c"], known: Bool[np.ndarray, "r c"]
) -> Float[np.ndarray, "r c"]:
    nearest: Int[np.ndarray, "2 r c"] = ndimage.distance_transform_edt(
        ~known, return_distances=False, return_indices=True
    )
    return z[tuple(nearest)]


def _opened(z: Float[np.ndarray, "r c"], cell_m: float) -> Bool[np.ndarray, "r c"]:
    """Cells that no opening lowers by more than its threshold; unseen ones, infinite, do not count."""
    seen = np.isfinite(z)
    ground, before = seen.copy(), 1
    for window in WINDOWS:
        eroded = ndimage.minimum_filter(z, window, mode="constant", cval=np.inf)
        lower = ndimage.maximum_filter(
            np.where(seen, eroded, -np.inf), window, mode="constant", cval=-np.inf
        )
        threshold = min(STEEP * (window - before) * cell_m + LEAST_STEP_M, MOST_STEP_M)
        ground[seen] &= (z[seen] - lower[seen]) <= threshold
        z, before = np.where(seen, lower, np.inf), window
    return ground


def _filled(z: Float[np.ndarray, "r c"], known: Bool[np.ndarray, "r c"]) -> Float[np.ndarray, "r c"]:
    """Holes filled linearly from their rims, and beyond the last known cells with the nearest."""
    filled = _filled_with_nearest(z, known)
    rim = known & ndimage.binary_dilation(~known)
    if np.ptp(np.nonzero(rim), axis=1).min(initial=0) > 0:  # else they span no triangle
        holes = np.argwhere(~known)
        inside = LinearNDInterpolator(np.argwhere(rim), z[rim])(holes)
        good = np.isfinite(inside)
        filled[tuple(holes[good].T)] = inside[good]
    return filled
