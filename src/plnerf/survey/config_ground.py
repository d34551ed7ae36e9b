"""Ground, vegetation, surfaces, clearances.  Without NumPy: the command line shows it at once."""

from dataclasses import dataclass, field
from pathlib import Path

from plnerf.errors import ConfigError
from plnerf.survey.config_obstacles import ObstacleConfig
from plnerf.survey.stereo.config import WitnessConfig


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


PLANE = 3
"""Numbers of a plane: so many of the cells' degrees of freedom it takes."""


@dataclass(frozen=True)
class GroundSectionConfig:
    """How the height of the ground under a wire is interpolated, and how uncertain it is."""

    side_m: float = 10.0
    """Ground within this horizontal distance of the wire takes part."""
    cell_m: float = 0.5
    """Points within a square of this side are replaced by their mean: that of points of a plane lies on
    it."""
    scatter_radius_m: float = 1.5
    """Radius about a station within which the scatter of the ground about a plane adds to its uncertainty:
    stems and bushes that were taken for ground show in it."""
    scatter_cells: int = 12
    """Where fewer cells lie within `scatter_radius_m`, the scatter is that of the nearest so many, and counts
    in full: what is seen alone there may be one plant, whose cells are all wrong together."""
    unseen_slope: float = 0.1
    """Where the ground is not seen, its standard deviation grows by this share of the distance to where it
    is."""
    max_gap_m: float = 10.0
    """Where the nearest ground is farther than this, horizontally, the ground is not known."""
    below_plants_m: float = 1.0
    """In images, points with plants so much above them may be leaves, and are ground only where they continue
    the ground beside."""

    def __post_init__(self) -> None:
        if not 0 < self.cell_m <= self.side_m:
            raise ConfigError(
                "The ground's section needs 0 < cell_m <= side_m, but got "
                f"cell_m={self.cell_m}, side_m={self.side_m}."
            )
        if self.scatter_cells <= PLANE:
            raise ConfigError(
                f"The ground's section needs scatter_cells of {PLANE + 1} or more, since fewer have no "
                f"scatter about a plane, but got {self.scatter_cells}."
            )
        if min(self.scatter_radius_m, self.unseen_slope, self.max_gap_m, self.below_plants_m) < 0:
            raise ConfigError(
                "The ground's section needs scatter_radius_m, unseen_slope, max_gap_m and below_plants_m "
                f"of 0 or more, but got {self.scatter_radius_m}, {self.unseen_slope}, {self.max_gap_m} and "
                f"{self.below_plants_m}."
            )


@dataclass(frozen=True)
class SamplingConfig:
    """How uncertain the place of an obstacle is for lying between points: of plants, and of everything in
    clouds that state no standard deviations."""

    point_m: float = 0.03
    """Standard deviation of a point: range, beam and the matching of strips."""
    neighbours: int = 8
    """Nearest points of the obstacle that show how far apart its points are."""
    share: float = 0.45
    """Standard deviation of where a crown ends, as a share of their spacing, or anything of which there are
    few points.  Chosen on simulated flights over spans of even seeds."""
    surface_share: float = 0.18
    """The same of a surface such as a roof, whose points show its shape.  Chosen on the same."""
    bar_share: float = 0.4
    """The same of a bar, which ends with its last point or goes on to where the next is missing.  Around its
    end half of the neighbours are missing, which doubles the spacing found: of gaps between points at random,
    95 % would be within 0.75.  A scanner's are more even; chosen on the same."""
    leaves_m: float = 0.18
    """Standard deviation of where the outer leaves of high vegetation end beyond what images match of it.
    Chosen on trees of random scenes of even seeds."""
    max_spacing_m: float = 1.5
    """Greatest spacing; also that of points that have too few neighbours within `reach_m`."""
    reach_m: float = 3.0
    """Distance along each axis within which neighbours are sought."""

    def __post_init__(self) -> None:
        shares = (self.share, self.surface_share, self.bar_share)
        lengths = (self.point_m, *shares, self.leaves_m, self.max_spacing_m, self.reach_m)
        if min(lengths) <= 0 or self.neighbours < 3:
            raise ConfigError(
                "The sampling of obstacles needs lengths and shares above 0 and 3 neighbours or more, but "
                f"got {self}."
            )


@dataclass(frozen=True)
class OnWiresConfig:
    """How near to a wire a point lies on it."""

    near_m: float = 0.25
    """Points within this distance of a wire lie on it."""
    reach_sigmas: float = 3.0
    """A point may lie this many of its standard deviations away along its line of sight."""
    max_reach_m: float = 10.0
    """No line of sight is followed farther than this from its point."""

    def __post_init__(self) -> None:
        if not self.near_m > 0 or self.reach_sigmas < 0 or self.max_reach_m < 0:
            raise ConfigError(
                "Points on wires need near_m > 0, reach_sigmas >= 0 and max_reach_m >= 0, but got "
                f"near_m={self.near_m}, reach_sigmas={self.reach_sigmas}, max_reach_m={self.max_reach_m}."
            )


@dataclass(frozen=True)
class ClassifyConfig:
    """How the points of a surface from images are classified."""

    ground: GroundConfig = field(default_factory=GroundConfig)
    on_wires: OnWiresConfig = field(default_factory=OnWiresConfig)
    max_sigma_m: float = 1.0
    """Points whose height has a greater standard deviation neither define the ground nor belong to it."""
    near_sigmas: float = 2.0
    """A point belongs to the ground within `ground.near_m` of it, or within this many standard deviations of
    the point's height where that is more."""
    crown_cells: int = 5
    """Width, in cells of the ground's grid, of the square in which crowns are recognised."""
    crown_height_m: float = 1.25
    """Points within this height of the lowest in the square are low; the ground may rise so much in it."""
    min_low_share: float = 0.3
    """Where a smaller share of the points in the square is low, they belong to a crown that hides the ground,
    seen from the side."""
    grounded_m: float = 1.0
    """A curve of which half is less than this above the ground, or below it, is no wire,"""
    grounded_beside_m: float = 2.0
    """where ground is seen within this horizontal distance of it."""
    clear_m: float = 2.0
    """Nothing is ground that is less than this below a wire, or above it,"""
    clear_beside_m: float = 4.0
    """within this horizontal distance of it: arms reach so far beyond the ends of tension strings,"""
    clear_beyond_m: float = 10.0
    """and of its curve, continued so far beyond its ends: there may be a structure that is not found."""

    def __post_init__(self) -> None:
        beside = min(self.clear_m, self.clear_beside_m, self.clear_beyond_m, self.grounded_beside_m)
        least = min(self.near_sigmas, beside)
        if not self.max_sigma_m > 0 or least < 0 or self.crown_cells < 1:
            raise ConfigError(
                "Classes need max_sigma_m > 0, crown_cells >= 1 and near_sigmas, grounded_beside_m, clear_m, "
                f"clear_beside_m and clear_beyond_m of 0 or more, but got max_sigma_m={self.max_sigma_m}, "
                f"near_sigmas={self.near_sigmas}, grounded_beside_m={self.grounded_beside_m}, "
                f"clear_m={self.clear_m}, clear_beside_m={self.clear_beside_m}, "
                f"clear_beyond_m={self.clear_beyond_m}, crown_cells={self.crown_cells}."
            )


@dataclass(frozen=True)
class FieldConfig:
    """How points are taken from a trained field."""

    rays: int = 400_000
    """Pixels that are rendered, evenly from the training images."""
    most_sharing: int = 200
    """Of more images than these each gives as many pixels as if there were so many: the images of a long line
    each show other things.  Half of stereo's pixels do, since rendering costs more than matching."""
    min_accumulation: float = 0.5
    """Share of a ray's light that must be absorbed on its way."""
    farthest: float = 1.6
    """Points further from the middle of the scene's box than so many of its half sides are background."""
    neighbours: int = 8
    """Nearest points by which a point is judged."""
    max_isolation: float = 4.0
    """A point whose neighbours are so many times as far as those of most, for its distance from the cameras,
    floats in the air."""
    max_relative_sigma: float = 0.25
    """Standard deviation along the ray, as a share of the distance, beyond which a depth is dropped."""

    def __post_init__(self) -> None:
        if min(self.rays, self.most_sharing, self.neighbours) < 1:
            raise ConfigError(
                "Points of a field need rays, most_sharing and neighbours of 1 or more, but got "
                f"{self.rays}, {self.most_sharing} and {self.neighbours}."
            )


@dataclass(frozen=True)
class CoverageConfig:
    """How much of the ground and the air around a span was seen."""

    stretch_m: float = 5.0
    """Length of the stretches of which it is stated, about."""
    step_m: float = 2.0
    """Spacing of the columns, and of the places in their air."""
    side_m: float = 5.0
    """How far the corridor reaches outside of the outer wires."""
    min_images: int = 3
    """Images that must see a place in the air, or past it."""
    least_share: float = 0.5
    """A stretch of which a smaller share was seen counts as not seen."""
    max_sigma_m: float = 1.0
    """Points of a greater standard deviation show no ground."""
    unknown_drop_m: float = 10.0
    """Where no ground is known at all, air is counted so far below the lowest wire."""
    above_ground_m: float = 0.7
    """What is lower is no plant that a wire comes near to."""
    most_stations: int = 30
    """Stations along a wire at which the air about it is sampled, at most,"""
    directions: int = 13
    """and as many directions across it, from one side down to the other, and distances."""
    witnesses: WitnessConfig = field(default_factory=WitnessConfig)
    """Which images see a place."""

    def __post_init__(self) -> None:
        if min(self.most_stations, self.directions) < 1 or self.above_ground_m < 0:
            raise ConfigError(
                "Coverage needs most_stations and directions of 1 or more, and above_ground_m of 0 or more, "
                f"but got {self.most_stations}, {self.directions} and {self.above_ground_m}."
            )
        if not 0 < self.step_m <= self.stretch_m or self.side_m < 0 or self.min_images < 1:
            raise ConfigError(
                "Coverage needs 0 < step_m <= stretch_m, side_m >= 0 and min_images >= 1, but got "
                f"step_m={self.step_m}, stretch_m={self.stretch_m}, side_m={self.side_m}, "
                f"min_images={self.min_images}."
            )
        if not 0 <= self.least_share <= 1 or min(self.max_sigma_m, self.unknown_drop_m) <= 0:
            raise ConfigError(
                "Coverage needs least_share from 0 to 1, and max_sigma_m and unknown_drop_m greater than 0, "
                f"but got {self.least_share}, {self.max_sigma_m} and {self.unknown_drop_m}."
            )


@dataclass(frozen=True)
class ClearanceConfig:
    """Which clearance is required, and how the clearances are measured.

    Raises SurveyError for a voltage that the table does not have, a table that is none, and a required
    clearance that is not positive.
    """

    voltage_kv: float | None = None
    """Nominal voltage of the line; None: it is not known, and no table applies."""
    thresholds: Path | None = None
    """A table of required clearances, or the name of one of the package; None: the one in force."""
    clearance_m: float | None = None
    """A distance to be kept from everything, which precedes the table's."""
    station_m: float = 0.5
    """Spacing of the stations along a wire at which its profile is evaluated."""
    corridor_m: float = 5.0
    """Vegetation within this horizontal distance of the wire shows in its profile."""
    apart_m: float = 5.0
    """Places of one wire and group are farther apart along it than this, and each is the nearest within this
    distance."""
    max_places: int = 5
    """Places that are listed of one wire and group, at most."""
    obstacles: ObstacleConfig = field(default_factory=ObstacleConfig)
    sampling: SamplingConfig = field(default_factory=SamplingConfig)
    ground: GroundSectionConfig = field(default_factory=GroundSectionConfig)

    def __post_init__(self) -> None:
        if (self.voltage_kv, self.thresholds, self.clearance_m) != (None, None, None):
            from plnerf.survey.thresholds import check_required  # brings NumPy

            check_required(self.voltage_kv, self.thresholds, self.clearance_m)
        if not self.station_m > 0 or min(self.corridor_m, self.apart_m) < 0 or self.max_places < 1:
            raise ConfigError(
                "Clearances need station_m > 0, corridor_m and apart_m of 0 or more, and max_places >= 1, "
                f"but got station_m={self.station_m}, corridor_m={self.corridor_m}, apart_m={self.apart_m}, "
                f"max_places={self.max_places}."
            )
