"""What decides a score: tolerances, cells and what is left out of it."""

from dataclasses import dataclass, field

from plnerf.errors import ConfigError


@dataclass(frozen=True)
class PointScoreConfig:
    """How points of wires are scored (`points.py`).  Lengths in metres."""

    tolerances_m: tuple[float, ...] = (0.05, 0.10, 0.25)
    """Distances within which a point is right, and a place on a wire is found."""
    cell_m: float = 0.01
    """Longest piece that true wires are cut into."""
    tower_m: float = 1.0
    """Insulators, clamps, dampers and jumpers are within this distance of an attachment, or of a structure's
    body: nothing is scored there."""
    even_m: float = 0.05
    """A point weighs 1 / (the points within this distance of it): a line weighs by its length, however
    dense its points are."""
    cover_m: float = 0.25
    """Points this near to a wire cover it; gaps are counted between such points, along the wire."""
    join_m: float = 0.5
    """Longer gaps part a wire into fragments, and are not covered."""
    assign_m: float = 0.5
    """Points farther from their wire say nothing about its position (but count against precision)."""
    line_step_m: float = 0.01
    """Spacing of samples of polylines in files: a sample is then within 5 mm of every point of the line, so
    that at a tolerance of 5 cm a point beside the line is judged as if by the line itself to 0.3 mm."""

    def __post_init__(self) -> None:
        lengths = (*self.tolerances_m, self.cell_m, self.tower_m, self.even_m, self.cover_m, self.join_m,
                   self.assign_m, self.line_step_m)  # fmt: skip
        if not self.tolerances_m or min(lengths) <= 0:
            raise ConfigError(
                f"The score of points needs a tolerance and lengths above 0, but has {self}. Correct it."
            )
        if list(self.tolerances_m) != sorted({round(one, 2) for one in self.tolerances_m}):
            raise ConfigError(
                f"Tolerances must be whole centimetres that rise, but are {self.tolerances_m}: results are "
                "named after them. Correct them."
            )


@dataclass(frozen=True)
class WireScoreConfig:
    """How a survey's wires are compared with the true ones (`wire_matches.py`).  Lengths in metres."""

    place_m: float = 0.1
    """Longest distance between places that are compared."""
    end_m: float = 0.3
    """Cut off either end of the common stretch, where clamps and insulators are."""
    least_common_m: float = 2.0
    """Shortest stretch that a true and a found wire must share: along less, nothing can be concluded of
    either."""
    match_m: float = 0.5
    """Greatest root mean square distance along the common stretch of two wires that are one."""
    least_share: float = 0.5
    """Least part of the shorter of two wires that they must share: of a line of many spans, a wire that
    reaches a little into the next span is not that span's."""
    support_m: float = 3.0
    """Greatest horizontal distance of a true and a found structure that are one: about a tower's width."""
    found_m: float = 0.1
    """Distance from a wire of the survey within which a place of a true wire is found: a third of the gap of
    twin conductors."""

    def __post_init__(self) -> None:
        if min(self.place_m, self.least_common_m, self.match_m) <= 0 or self.end_m < 0:
            raise ConfigError(f"The score of wires needs lengths above 0, but has {self}. Correct it.")
        if not 0 < self.least_share <= 1 or min(self.support_m, self.found_m) <= 0:
            raise ConfigError(
                f"The score of wires needs a share up to 1 and distances above 0, but has {self}. Correct it."
            )
        if self.least_common_m <= 2 * self.end_m + self.place_m:
            raise ConfigError(
                f"The shortest common stretch ({self.least_common_m} m) must be longer than what is cut off "
                f"its ends ({2 * self.end_m} m) and a place ({self.place_m} m). Correct it."
            )


@dataclass(frozen=True)
class ScoreConfig:
    """All of it."""

    points: PointScoreConfig = field(default_factory=PointScoreConfig)
    wires: WireScoreConfig = field(default_factory=WireScoreConfig)
    truth_departs_m: float = 0.05
    """Most that a true wire's polyline may depart from a catenary, which stands for it: the finest tolerance
    that points are scored with."""

    def __post_init__(self) -> None:
        if self.truth_departs_m <= 0:
            raise ConfigError(f"truth_departs_m must be greater than 0, but is {self.truth_departs_m}.")


DEFAULT = ScoreConfig()
