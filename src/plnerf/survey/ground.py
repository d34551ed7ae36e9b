"""The ground under a point cloud, heights above it, and vegetation classified by height.

A progressive morphological filter: K. Zhang, S.-C. Chen, D. Whitman, M.-L. Shyu, J. Yan, C. Zhang, "A
progressive morphological filter for removing nonground measurements from airborne LIDAR data", IEEE TGRS
41(4), 2003.  The lowest points of a grid's cells are opened with ever larger windows; a cell that an opening
lowers by more than its threshold is not ground.

Letters: n points; r x c cells (rows along y, columns along x), z heights at their middles; any frame with
z up, metres.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy import ndimage

from plnerf.line.cloud import HIGH_VEGETATION, LOW_VEGETATION, VEGETATION
from plnerf.survey.config_ground import GroundConfig


@dataclass(frozen=True, eq=False)
class Ground:
    """Heights of the ground on a grid whose holes are filled."""

    corner: Float[np.ndarray, "2"]
    """x and y of the first cell's middle."""
    cell_m: float
    z: Float[np.ndarray, "r c"]

    def below(self, points: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
        """Height of the ground at the points' x and y, bilinear; beyond the grid, that of its border."""
        at = (points[:, 1::-1] - self.corner[::-1]) / self.cell_m
        z: Float[np.ndarray, " n"] = ndimage.map_coordinates(self.z, at.T, order=1, mode="nearest")
        return z

    def above(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Heights of points above the ground; negative beneath it."""
        return points[:, 2] - self.below(points)


def find_ground(points: Float[np.ndarray, "n 3"], config: GroundConfig) -> Ground | None:
    """The ground of a cloud of n > 0 finite points; None where they form no surface.

    Cells without points (water, shadow) are filled linearly from those around, along rows and columns.
    """
    extent = np.ptp(points[:, :2], axis=0)
    cell_m = max(config.cell_m, float(np.sqrt(extent.prod() / config.max_cells)))
    # At multiples of the cell, so that a part of a cloud has the cells of the whole.
    corner = np.floor(points[:, :2].min(0) / cell_m) * cell_m
    lowest = _lowest(points, corner, cell_m)
    seen = np.isfinite(lowest)
    whole = seen & (ndimage.uniform_filter(seen.astype(np.float64), 3, mode="constant") > 7.5 / 9)
    if whole.sum() < config.min_surface_share * seen.sum():
        return None
    around = ndimage.rank_filter(
        lowest, config.pit_rank, size=config.pit_window, mode="constant", cval=np.inf
    )
    with np.errstate(invalid="ignore"):  # inf - inf, where nothing is seen
        seen &= ~(around - lowest > config.pit_depth_m)
    middles = corner + cell_m / 2
    trend = _trend(lowest, seen)
    flat = np.where(seen, lowest - trend, np.inf)
    ground = _opened(flat, cell_m, config)
    return Ground(middles, cell_m, _filled(flat, ground) + trend)


def settled(
    ground: Ground, points: Float[np.ndarray, "n 3"], near_m: Float[np.ndarray, " n"], rounds: int
) -> Ground:
    """The ground lifted to the median of the points near it, cell by cell.

    near_m: how far from the ground a point may be measured and yet show it.  Of many points with noise the
    lowest, which the filter goes by, lies some standard deviations below the ground.
    """
    rows, columns = ground.z.shape
    column, row = np.rint((points[:, :2] - ground.corner) / ground.cell_m).astype(np.int64).T
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    cell = row * columns + column
    for _ in range(rounds):
        above = ground.above(points)
        near = np.flatnonzero(inside & (np.abs(above) <= near_m))
        order = near[np.lexsort((above[near], cell[near]))]
        some, first, count = np.unique(cell[order], return_index=True, return_counts=True)
        lift = np.zeros(rows * columns)
        lift[some] = (above[order[first + (count - 1) // 2]] + above[order[first + count // 2]]) / 2
        known = np.zeros(rows * columns, np.bool_)
        known[some] = True
        if not known.any():
            break
        lifted = _filled(lift.reshape(rows, columns), known.reshape(rows, columns))
        ground = replace(ground, z=ground.z + lifted)
    return ground


def vegetation(above: Float[np.ndarray, " n"], config: GroundConfig) -> UInt8[np.ndarray, " n"]:
    """LAS class of plants by their height above the ground: 3 low, 4 medium, 5 high."""
    bands = np.array([LOW_VEGETATION, VEGETATION, HIGH_VEGETATION], np.uint8)
    return bands[np.digitize(above, [config.low_vegetation_m, config.high_vegetation_m])]


def _lowest(
    points: Float[np.ndarray, "n 3"], corner: Float[np.ndarray, "2"], cell_m: float
) -> Float[np.ndarray, "r c"]:
    """Height of the lowest point of each cell; infinite in cells without points."""
    cell = ((points[:, :2] - corner) // cell_m).astype(np.int64)
    column, row = cell[:, 0], cell[:, 1]
    lowest = np.full((row.max() + 1, column.max() + 1), np.inf)
    np.minimum.at(lowest, (row, column), points[:, 2])
    return lowest


def _trend(lowest: Float[np.ndarray, "r c"], seen: Bool[np.ndarray, "r c"]) -> Float[np.ndarray, "r c"]:
    """The plane that fits the lowest points: at the grid's borders openings would lower a slope."""
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


def _opened(z: Float[np.ndarray, "r c"], cell_m: float, config: GroundConfig) -> Bool[np.ndarray, "r c"]:
    """Cells that no opening lowers by more than its threshold, nor all together by more than a slope does.

    Cells without points are infinite.  The edge of a canopy that hides the ground beyond it is a staircase:
    no step is high, and the paper's threshold alone lets it through.
    """
    seen, first = np.isfinite(z), z
    ground, before = seen.copy(), 1
    for window in config.windows:
        eroded = ndimage.minimum_filter(z, window, mode="constant", cval=np.inf)
        lower = ndimage.maximum_filter(np.where(seen, eroded, -np.inf), window, mode="constant", cval=-np.inf)
        threshold = config.max_slope * (window - before) * cell_m + config.min_step_m
        ground[seen] &= (z[seen] - lower[seen]) <= min(threshold, config.max_step_m)
        most = config.max_slope * (window - 1) / 2 * cell_m + config.min_step_m
        ground[seen] &= (first[seen] - lower[seen]) <= most
        z, before = np.where(seen, lower, np.inf), window
    return ground


def _filled(z: Float[np.ndarray, "r c"], known: Bool[np.ndarray, "r c"]) -> Float[np.ndarray, "r c"]:
    """Heights with holes filled linearly, along rows and columns, and beyond the last known cells by the
    nearest.

    A hole takes nothing from beyond its rim: it is filled alike in a part of a cloud and in all of it.
    """
    along, weight = _between(z, known)
    across, other = (one.T for one in _between(z.T, known.T))
    sums = weight + other
    between = (weight * along + other * across) / np.where(sums > 0, sums, 1.0)
    return np.where(known, z, np.where(sums > 0, between, _filled_with_nearest(z, known)))


def _between(
    z: Float[np.ndarray, "r c"], known: Bool[np.ndarray, "r c"]
) -> tuple[Float[np.ndarray, "r c"], Float[np.ndarray, "r c"]]:
    """Heights on the lines between the known cells to both sides in the same row, and how near these are to
    each other: 0 where one is missing."""
    columns = known.shape[1]
    at = np.broadcast_to(np.arange(columns), known.shape)
    before = np.maximum.accumulate(np.where(known, at, -1), axis=1)
    after = np.minimum.accumulate(np.where(known, at, columns)[:, ::-1], axis=1)[:, ::-1]
    both = (before >= 0) & (after < columns)
    before, after = np.where(both, before, at), np.where(both, after, at)
    gap = np.maximum(after - before, 1)
    low, high = (np.where(both, np.take_along_axis(z, one, 1), 0.0) for one in (before, after))
    return low + (high - low) * (at - before) / gap, both / gap
