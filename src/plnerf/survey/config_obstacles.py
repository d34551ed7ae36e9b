"""What counts as an obstacle.  Without NumPy: the command line shows it at once."""

from dataclasses import dataclass, field

from plnerf.errors import ConfigError


@dataclass(frozen=True)
class FloatingConfig:
    """What is too thin to be a plant in the air."""

    gap_m: float = 1.0
    """Points that are nearer to each other hang together."""
    cell_m: float = 0.25
    """Of the points in a cell of this side, their middle stands for all."""
    above_ground_m: float = 1.5
    """A clump whose lowest point is higher stands on nothing that is seen."""
    thin_m: float = 0.33
    """Such a clump is a possible obstacle only that lies so near to a straight line,"""
    share: float = 0.95
    """this share of its points at least: of 68 and 294 points on wires of random scenes 32 and 30 that were
    not found, a few lie 0.34 and 0.40 m off."""
    upright_deg: float = 45.0
    """A line that is steeper is the tip of a conifer: no wire hangs so,"""
    bit_m: float = 2.0
    """and a clump that is no longer than it is thin, and so near to a plant, is a part of that."""

    def __post_init__(self) -> None:
        if not 0 < self.upright_deg < 90 or self.bit_m < 0:
            raise ConfigError(
                "What floats needs 0 < upright_deg < 90 and bit_m of 0 or more, but got "
                f"{self.upright_deg} and {self.bit_m}."
            )
        if not 0 < self.share <= 1:
            raise ConfigError(f"What floats needs a share above 0 and at most 1, but got {self.share}.")
        if not 0 < self.cell_m < self.gap_m:
            raise ConfigError(
                f"What floats needs 0 < cell_m < gap_m, but got {self.cell_m} and {self.gap_m}."
            )


@dataclass(frozen=True)
class GreenConfig:
    """What is green and goes on well below is a plant.  Of what few images see, or stands where wires are no
    longer seen, in random scenes of even seeds: plants have an excess of green of 0.14 and more and go on
    below, all else has 0.07 or less, or nothing below it."""

    cell_m: float = 0.25
    """Points in a cell of this side count once for what is below."""
    within_m: float = 1.0
    """Colours are those of all that is so near."""
    least: float = 0.1
    """Excess of green from which on it is green."""
    aside_m: float = 0.75
    """Below a place is what is so near to it in plan,"""
    below_m: float = 3.0
    """and no further down;"""
    least_below_m: float = 1.0
    """of these heights so many, in sum, must be seen."""

    def __post_init__(self) -> None:
        if not self.cell_m > 0 or not 0 <= self.least_below_m <= self.below_m:
            raise ConfigError(
                "Green plants need cell_m > 0 and 0 <= least_below_m <= below_m, but got "
                f"{self.cell_m}, {self.least_below_m} and {self.below_m}."
            )


@dataclass(frozen=True)
class ObstacleConfig:
    """Which points of a cloud count as obstacles."""

    support_m: float = 8.0
    """Buildings and other points within this horizontal distance of a structure's foot or a wire's end belong
    to the structure."""
    plant_support_m: float = 4.0
    """The same for vegetation in clouds that state standard deviations, those from images, unless it is
    green: in them a lattice is as scattered as a crown."""
    passes_m: float = 1.5
    """A wire that is seen so far beyond a place is held by no structure there: half of a body's width."""
    arm_m: float = 10.0
    """Vegetation beside a structure and so near to the end of a wire on it may be a crossarm, if it is so far
    along the wire as the body reaches (`passes_m`),"""
    arm_below_m: float = 3.0
    """and at most so far below that end."""
    bush_m: float = 1.0
    """Low or medium vegetation is no structure that was not found if nothing high is so near in plan."""
    max_sigma_m: float = 1.0
    """Points of a greater standard deviation are no obstacles: of thousands with errors of metres, the
    nearest to the wire is always a wrong one."""
    above_sigmas: float = 5.0
    """Low and medium vegetation less high above the ground than this many of its standard deviations is not
    told from it: of the thousands of points of bare ground around a wire some lie four above it."""
    own_m: float = 0.5
    """Other points this near to a wire belong to it: spacers, dampers, and what was not labelled as wire."""
    reach_m: float = 50.0
    """Horizontal distance from the wire within which obstacles are searched."""
    min_seen: int = 3
    """Images that must see a thing where a point of a cloud from images is, and more than see past it: two
    images of a pair make the same mistake.  Other points are possible obstacles, listed apart."""
    floating: FloatingConfig = field(default_factory=FloatingConfig)
    green: GreenConfig = field(default_factory=GreenConfig)
    max_possible: int = 8
    """Possible obstacles that are listed, the nearest to a wire first."""

    @property
    def _lengths(self) -> tuple[float, ...]:
        near = self.support_m, self.plant_support_m, self.own_m
        return *near, self.passes_m, self.arm_m, self.arm_below_m, self.bush_m

    def __post_init__(self) -> None:
        if not self.reach_m > 0 or min(self._lengths) < 0:
            raise ConfigError(
                "Obstacles need reach_m > 0, and support_m, plant_support_m, own_m, passes_m, arm_m, "
                f"arm_below_m and bush_m from 0, but got reach_m={self.reach_m} and, in this order, "
                f"{', '.join(f'{length:g}' for length in self._lengths)}."
            )
        if self.min_seen < 1 or self.max_possible < 0:
            raise ConfigError(
                "Obstacles need min_seen >= 1 and max_possible >= 0, but got "
                f"{self.min_seen} and {self.max_possible}."
            )
        if self.above_sigmas < 0:
            raise ConfigError(f"Obstacles need above_sigmas of 0 or more, but got {self.above_sigmas}.")
        if not self.max_sigma_m > 0:
            raise ConfigError(f"Obstacles need max_sigma_m > 0, but got {self.max_sigma_m}.")
