"""The ground under a point cloud, heights above it, and vegetation classified by height.

A progressive morphological filter: K. Zhang, S.-C. Chen, D. Whitman, M.-L. Shyu, J. Yan, C. Zhang, "A
progressive morphological filter for removing nonground measurements from airborne LIDAR data", IEEE TGRS
41(4), 2003.  The lowest points of a grid's cells are opened with ever larger windows; a cell that an opening
lowers by more than its threshold is not ground.

Letters: n points; r x c cells (rows along y, columns along x), z heights at their middles; any frame with
z up, metres.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy import ndimage
from scipy.interpolate import LinearNDInterpolator

from plnerf.errors import ConfigError
from plnerf.line.cloud import HIGH_VEGETATION, LOW_VEGETATION, VEGETATION


@dataclass(frozen=True)
class GroundConfig:
    """How the ground is found under a cloud, and which points count as ground or as vegetation."""

    cell_m: float = 1.0
    """Side of the grid's cells; should be wider than the points' spacing on the ground."""
    max_cells: int = 10_000_000
    """Most cells of the grid, which bounds memory: the cells of a larger cloud are made wider."""
    windows: tuple[int, ...] = (3, 5, 9, 17, 33)
    """Widths of the openings in cells, 2^k + 1 as in the paper.  Whatever is wider than the last (a hall)
    stays ground."""
    max_slope: float = 0.3
    """Greatest slope of the terrain beyond its mean slope, which is taken out first."""
    min_step_m: float = 0.3
    """dh_0 of the paper's eq. 7, the threshold s (w_k - w_(k-1)) c + dh_0 of an opening."""
    max_step_m: float = 2.5
    """dh_max of the paper's eq. 7, the greatest threshold of an opening."""
    pit_depth_m: float = 1.5
    """A cell that is deeper than this below those around it is an error of measurement, not ground."""
    pit_window: int = 7
    """Width in cells of the square that counts as around a cell in the search for pits."""
    pit_rank: int = 3
    """A pit's depth counts from the cell around it that has so many lower ones: a few pits may be close
    together."""
    min_surface_share: float = 0.2
    """Least share of the occupied cells that have points on nearly all sides (8 of 9 cells).  Ground is a
    surface, while wires and towers alone are lines."""
    near_m: float = 0.3
    """Points within this height of the ground's surface, above or below it, are ground."""
    low_vegetation_m: float = 0.5
    """Vegetation is low below this height above the ground: LAS names the bands and leaves the bounds
    open."""
    high_vegetation_m: float = 2.0
    """Vegetation is high from this height above the ground on."""

    def __post_init__(self) -> None:
        if not self.cell_m > 0 or self.max_cells < 1 or self.pit_window < 1:
            raise ConfigError(
                "The ground's grid needs cell_m > 0, max_cells >= 1 and pit_window >= 1, but got "
                f"cell_m={self.cell_m}, max_cells={self.max_cells}, pit_window={self.pit_window}."
            )
        if not 0 <= self.pit_rank < self.pit_window**2:
            raise ConfigError(
                f"The ground's pit_rank must be from 0 to {self.pit_window**2 - 1}, the cells of a square of "
                f"pit_window={self.pit_window}, but is {self.pit_rank}."
            )
        if any(window < 1 for window in self.windows) or list(self.windows) != sorted(set(self.windows)):
            raise ConfigError(f"The ground's windows must be positive and rise, but are {self.windows}.")
        if not (self.near_m >= 0 and 0 <= self.low_vegetation_m <= self.high_vegetation_m):
            raise ConfigError(
                "Heights above the ground need near_m >= 0 and 0 <= low_vegetation_m <= high_vegetation_m, "
                f"but got near_m={self.near_m}, low_vegetation_m={self.low_vegetation_m}, "
                f"high_vegetation_m={self.high_vegetation_m}."
            )


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

    Cells without points (water, shadow) are filled linearly from those around.
    """
    corner = points[:, :2].min(0)
    extent = np.ptp(points[:, :2], axis=0)
    cell_m = max(config.cell_m, float(np.sqrt(extent.prod() / config.max_cells)))
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
    """Cells that no opening lowers by more than its threshold; cells without points are infinite."""
    seen = np.isfinite(z)
    ground, before = seen.copy(), 1
    for window in config.windows:
        eroded = ndimage.minimum_filter(z, window, mode="constant", cval=np.inf)
        lower = ndimage.maximum_filter(np.where(seen, eroded, -np.inf), window, mode="constant", cval=-np.inf)
        threshold = config.max_slope * (window - before) * cell_m + config.min_step_m
        ground[seen] &= (z[seen] - lower[seen]) <= min(threshold, config.max_step_m)
        z, before = np.where(seen, lower, np.inf), window
    return ground


def _filled(z: Float[np.ndarray, "r c"], known: Bool[np.ndarray, "r c"]) -> Float[np.ndarray, "r c"]:
    """Heights with holes filled linearly from their rims, and beyond the last known cells by the nearest."""
    filled = _filled_with_nearest(z, known)
    rim = known & ndimage.binary_dilation(~known)
    if np.ptp(np.nonzero(rim), axis=1).min(initial=0) > 0:  # otherwise the rim spans no triangle
        holes = np.argwhere(~known)
        inside = LinearNDInterpolator(np.argwhere(rim), z[rim])(holes)
        good = np.isfinite(inside)
        filled[tuple(holes[good].T)] = inside[good]
    return filled
