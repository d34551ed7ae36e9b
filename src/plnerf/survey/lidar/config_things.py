"""What is no plant.  Without NumPy: the command line shows it at once."""

from dataclasses import dataclass

from plnerf.errors import ConfigError


@dataclass(frozen=True)
class ThingsConfig:
    """How buildings and straight things are told from plants in a cloud without classes."""

    straight_m: float = 4.0
    """What is straight and rather level over this length is no plant, if it is no wire either."""
    beside_m: float = 0.5
    """Points so near to such a piece are on it."""
    around_m: float = 3.0
    """Points so near to such a piece may be of the same thing,"""
    touching_m: float = 0.8
    """if they are joined to it by steps of at most this length,"""
    min_straight_share: float = 0.3
    """and if at least this share of what is joined lies on straight pieces."""
    axis_m: float = 0.25
    """Points so near to the axis of such a piece are on it, under roofs and beyond its ends too: plants
    beside a boom hide that it is straight."""
    axis_lengths: float = 2.0
    """Beyond its ends at most so many times as far as the piece is long, without a gap above `touching_m`."""
    min_aloft: int = 3
    """Where fewer points lie within `aloft_m` in plan, all of them high above the ground, they are noise:
    birds, and strays of wires that were not followed.  Three may be a thin boom."""
    aloft_m: float = 3.0
    """See `min_aloft`."""
    roof_from_m: float = 2.5
    """Least height of roofs above the ground."""
    cell_m: float = 0.5
    """Points within a cube of this side are replaced by their mean."""
    neighbours: int = 24
    """Nearest places, at most, through which a plane is laid,"""
    radius_m: float = 1.5
    """within this distance,"""
    min_neighbours: int = 8
    """and at least."""
    max_rms_m: float = 0.07
    """Greatest root mean square distance of a roof's places from their plane: crowns are rougher."""
    min_spread_m: float = 0.35
    """Least standard deviation of the places along the narrow side of the plane: an edge has none."""
    max_slope_deg: float = 60.0
    """Greatest slope of roofs."""
    max_bend_deg: float = 12.0
    """Greatest angle between planes of neighbouring places of one roof."""
    min_roof_m2: float = 12.0
    """Least area of a roof in plan, of what is 3 m wide everywhere."""
    images_rms_m: float = 0.15
    """The same as `max_rms_m` in clouds from images, which know a surface less exactly,"""
    max_sigma_m: float = 0.4
    """of whose points those of a greater standard deviation show no roof."""
    over_roof_m: float = 1.3
    """Points up to so far above the highest part of a smooth roof within a metre or two belong to it, such as
    chimneys: they end 0.6 to 0.9 m above the ridge, and half a metre around a ridge is no smooth plane.  What
    is higher does not."""

    def __post_init__(self) -> None:
        lengths = (
            self.straight_m, self.beside_m, self.around_m, self.touching_m, self.axis_m, self.axis_lengths,
            self.cell_m, self.radius_m, self.max_rms_m, self.min_roof_m2, self.aloft_m, self.images_rms_m,
            self.max_sigma_m,
        )  # fmt: skip
        if min(lengths) <= 0 or not 3 <= self.min_neighbours <= self.neighbours:
            raise ConfigError(
                "What is no plant needs lengths above 0 and 3 <= min_neighbours <= neighbours, but got "
                f"{lengths}, min_neighbours={self.min_neighbours} and neighbours={self.neighbours}."
            )
