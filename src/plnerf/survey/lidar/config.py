"""Every number that decides what is found in a point cloud.

Lengths in metres (_m), angles in degrees (_deg).  Airborne and drone LiDAR of power lines set the defaults:
a wire has a point every 0.1 to 4 m, and points lie 2 to 6 cm from it.
"""

from dataclasses import dataclass, field

from plnerf.errors import ConfigError
from plnerf.survey.config_ground import GroundConfig
from plnerf.survey.config_wires import FitConfig, KindsConfig
from plnerf.survey.lidar.config_things import ThingsConfig


def require_positive(owner: object, *names: str) -> None:
    """Raises ConfigError for the first of the named fields that is not greater than 0."""
    for name in names:
        value = getattr(owner, name)
        if not value > 0:
            raise ConfigError(f"lidar: {name} must be greater than 0, got {value}. Give a positive value.")


def require_share(owner: object, *names: str) -> None:
    """Raises ConfigError for the first of the named fields that is not between 0 and 1."""
    for name in names:
        value = getattr(owner, name)
        if not 0 <= value <= 1:
            raise ConfigError(f"lidar: {name} must lie between 0 and 1, got {value}. Give a share.")


@dataclass(frozen=True)
class CloudConfig:
    """What a cloud must be to be searched, and which of its points are left out as astray."""

    max_points: int = 60_000_000
    """Larger files are refused: they do not fit into the memory of an ordinary computer."""
    min_extent_m: float = 1.0
    """Least extent of a cloud in plan; less is a cloud in degrees, or none at all."""
    middle_share: float = 0.98
    """Share of the points, in the middle of each coordinate, that measures how far the cloud extends."""
    far_times: float = 10.0
    """A point is astray if it is farther from this middle part than so many times the part's extent and
    `far_m`: points left at 0, 0 in a cloud of national coordinates."""
    far_m: float = 1000.0
    """Distance that is added to `far_times` times the extent."""

    def __post_init__(self) -> None:
        require_positive(self, "max_points", "min_extent_m", "far_times")
        require_share(self, "middle_share")


@dataclass(frozen=True)
class LinearConfig:
    """Which points of a cloud lie on lines that run level or climb gently."""

    cell_m: float = 0.2
    """Edge of the cubic cells that are replaced by the mean of their points: more points in one say no more
    about a line of several metres."""
    max_distance_m: float = 8.0
    """Points farther away are no neighbours."""
    max_neighbours: int = 48
    """Most neighbours of a point, itself included."""
    min_neighbours: int = 6
    """Fewest neighbours that make a line."""
    radii_m: tuple[float, float] = (1.0, 2.5)
    """Radii of the neighbourhoods in which lines are sought, besides the `nearest` points: single wires side
    by side need the smaller, bundles the larger, and wires with a point every other metre the nearest."""
    nearest: int = 8
    """Neighbours of the neighbourhood that is defined by their number."""
    max_spread_ratio: float = 0.25
    """Largest spread across a line as a share of the spread along it: leaves have 1/3 and more, twin
    conductors 0.45 m apart 0.15."""
    tried_from: int = 12
    """In crowded places lines are tried towards every `tried_every`th neighbour in the order of distance,
    from this one on: nearer ones define a direction too coarsely."""
    tried_every: int = 3
    """See `tried_from`."""
    max_half_thickness_m: float = 0.12
    """Largest half thickness of a line in a crowded place."""
    max_half_thickness_share: float = 0.1
    """The same as a share of the neighbourhood's radius; the smaller of the two counts."""
    min_on_line: int = 8
    """Fewest neighbours on a line in a crowded place."""
    min_on_line_share: float = 0.3
    """Least share of the neighbours on it; a fifth of those on a surface lie on some line by chance."""
    min_sigma_along_m: float = 0.4
    """Least standard deviation of the neighbours along the line."""
    max_slope: float = 0.7
    """Greatest slope of a wire, as of a span up a mountain."""
    max_angle_deg: float = 15.0
    """Greatest angle between neighbours of one line."""
    max_gap_m: float = 5.0
    """Greatest distance between neighbours of one line."""
    max_beside_m: float = 0.6
    """Greatest distance of a neighbour beside the direction of the other."""

    def __post_init__(self) -> None:
        require_positive(
            self, "cell_m", "max_distance_m", "min_neighbours", "nearest", "tried_from", "tried_every",
            "max_gap_m",
        )  # fmt: skip
        if not min(self.radii_m) > 0 or self.radii_m[0] > self.radii_m[1]:
            raise ConfigError(f"lidar: radii_m must be positive and ascending, got {self.radii_m}.")
        if self.max_neighbours <= max(self.nearest, self.tried_from):
            raise ConfigError(
                f"lidar: max_neighbours must be more than nearest ({self.nearest}) and tried_from "
                f"({self.tried_from}), got {self.max_neighbours}. Raise it."
            )


@dataclass(frozen=True)
class TrackConfig:
    """How wires and bundles are followed along the places on lines, as parabolas."""

    seed_length_m: float = 20.0
    """Connected pieces are cut to this length: a structure within one would bend it."""
    min_length_m: float = 10.0
    """Least length of a track, and of a piece that one begins with."""
    min_places: int = 8
    """Fewest places of a track."""
    min_gate_m: float = 0.25
    """Least half width and half height of the gate around the curve in which places belong to it."""
    max_gate_m: float = 0.6
    """Greatest half width and half height: a bundle needs half its width, and a single wire must not take
    its neighbour's places."""
    gate_sigmas: float = 3.0
    """Half width and half height within these limits, in standard deviations of the track's own places."""
    step_m: float = 5.0
    """Least distance beyond the ends of a track within which each step seeks further places."""
    step_share: float = 0.3
    """The same distance as a share of the track's length; the larger of the two counts."""
    max_gap_m: float = 20.0
    """Greatest distance within which a step seeks places: the longest gap that a track continues over."""
    max_angle_deg: float = 15.0
    """Greatest angle in plan between a track and the lines that join it."""
    max_sag_share: float = 0.15
    """Greatest sag as a share of the length: nothing hangs deeper on poles or towers."""
    bow_from_m: float = 60.0
    """Least length of a track that may bow sideways."""
    max_bow_share: float = 0.6
    """Greatest sideways bow as a share of the hang (wind that swings a wire by 30 degrees)."""
    max_misfit_m: float = 0.35
    """Greatest root mean square distance of a seed's places from its curve."""
    beyond_m: float = 1.0
    """Places so far beyond a track's ends are still its own."""
    max_used_share: float = 0.5
    """A piece with a larger share of places on earlier tracks begins none."""
    max_join_beside_m: float = 2.4
    """Two tracks whose ends are farther beside each other are not joined: four times `max_gate_m`."""
    max_worse_m: float = 0.05
    """By how much two tracks may spread more about one common curve than each about its own, if they are
    pieces of one wire."""
    max_rounds: int = 60
    """Most steps of growing."""
    min_cauchy_scale_m: float = 0.1
    """Residuals beyond twice this, or twice their own standard deviation, count less (Cauchy)."""

    def __post_init__(self) -> None:
        require_positive(
            self, "seed_length_m", "min_length_m", "min_places", "max_gate_m", "max_rounds",
            "min_cauchy_scale_m",
        )  # fmt: skip
        if self.min_gate_m > self.max_gate_m:
            raise ConfigError(
                f"lidar: min_gate_m must be at most max_gate_m ({self.max_gate_m}), got {self.min_gate_m}."
            )


@dataclass(frozen=True)
class SpanConfig:
    """Which tracks hang side by side in one span, and which spans meet at a structure."""

    max_angle_deg: float = 5.0
    """Greatest angle in plan between tracks of one span."""
    min_overlap: float = 0.5
    """Least share of the shorter track beside which the other must run."""
    close_m: float = 8.0
    """Tracks so near side by side belong to one span."""
    wide_m: float = 20.0
    """Tracks up to so far apart do if their ends are side by side as well: parallel lines have structures of
    their own."""
    even_m: float = 15.0
    """Ends that differ by at most so many metres along the line are side by side."""
    even_share: float = 0.15
    """The same as a share of the track's length; the larger of the two counts."""
    min_length_m: float = 30.0
    """Least length of a span that meets no other: booms and crossarms are shorter."""
    min_open_m: float = 30.0
    """Wires that all end with the cloud after less than this beyond a structure make no span."""
    max_meeting_m: float = 15.0
    """Ends of spans so near to each other hang on one structure."""
    max_bend_deg: float = 60.0
    """Greatest bend of a line at a structure: what leaves at more is a crossarm."""
    cell_m: float = 0.6
    """Edge of the cells of a span's cross-section in which wires that were not followed are sought."""
    beside_m: float = 8.0
    """How far beside a span's outer tracks they are sought."""
    beyond_m: float = 3.0
    """Places so far beyond the ends of the tracks are theirs, and of no such wire."""
    margin_m: float = 1.0
    """How far beyond the ends of the span such wires may reach."""
    min_places: int = 8
    """Fewest places of such a wire."""
    min_tenths_share: float = 0.4
    """Least share of the tenths of the span that hold one of its places."""

    def __post_init__(self) -> None:
        require_positive(self, "min_length_m", "min_open_m", "cell_m", "min_places")
        require_share(self, "min_overlap", "min_tenths_share")


@dataclass(frozen=True)
class StructureConfig:
    """What is a structure: where spans meet, or something upright that reaches the wires where one ends."""

    around_m: float = 10.0
    """How far along the line from the wires' ends a structure is sought."""
    beside_m: float = 3.0
    """How far beyond the outer wires it may reach across the line."""
    top_m: float = 1.5
    """It reaches to its highest wire but for this; and what is above its lowest wire but for this is taller
    than trees may be there."""
    body_m: float = 4.0
    """Half its width below the wires, and half its depth along the line."""
    min_body_share: float = 0.4
    """Least share of the metres between `body_from_m` and its lowest wire in which it must show points, where
    only one span ends."""
    edge_body_share: float = 0.8
    """The same where the cloud ends behind it: there the wires may end with the cloud."""
    edge_arms_share: float = 0.5
    """Least width of what is as high as the wires, as a share of theirs, where the cloud ends behind it."""
    body_from_m: float = 2.0
    """Height above the ground below which points may be plants."""
    min_points: int = 4
    """Fewest points near the wires' ends that show it."""
    ahead_m: tuple[float, float, float] = (5.0, 10.0, 15.0)
    """Distances beyond its tracks' ends at which points show that the cloud continues."""
    void_m: float = 2.0
    """Places without a point within this distance in plan are outside the cloud."""
    cell_m: float = 1.0
    """Edge of the cells of which adjacent ones belong to one body."""
    sigma_m: float = 0.14
    """Standard deviation, along the line, of an attachment to a structure whose points are seen: a wire ends
    at the middle of the structure's body, which its points show to 7 cm, and clamps hang off it by as much as
    strings lean, 12 cm by 4 degrees of 1.7 m."""
    clamped_sigma_m: float = 0.07
    """The same of a shield wire, which no string holds."""
    inferred_sigma_m: float = 1.0
    """The same for a structure that is inferred from spans that meet: assumed, since only the ends of their
    points say where it stands."""

    def __post_init__(self) -> None:
        require_positive(
            self, "around_m", "body_m", "min_points", "void_m", "cell_m", "sigma_m", "clamped_sigma_m",
            "inferred_sigma_m",
        )


@dataclass(frozen=True)
class BundleConfig:
    """How the wires of a bundle are separated in the cross-section of its track."""

    cell_m: float = 0.04
    """Edge of the cells of the cross-section."""
    blur_m: float = 0.06
    """Standard deviation by which it is smoothed: as the noise of a good cloud, so that wires four times as
    far apart are two."""
    min_peak: float = 0.2
    """Least height of a wire's peak as a share of the highest."""
    max_valley: float = 0.6
    """Two peaks are two wires if the section between them falls below this share of the lower one."""
    min_apart_m: float = 0.15
    """Least distance between wires; their clamps are farther apart."""
    max_distance_m: float = 0.25
    """Points farther from every wire belong to none."""
    rounds: int = 4
    """Rounds of assigning points to wires and refitting the wires."""
    piece_m: float = 5.0
    """Length of the pieces in which a wire's presence is counted."""
    min_share: float = 0.4
    """Least share of the pieces with points of the best seen wire in which another must have points."""
    min_points: int = 8
    """Fewest points of a wire of a bundle."""

    def __post_init__(self) -> None:
        require_positive(self, "cell_m", "blur_m", "piece_m", "min_points")


@dataclass(frozen=True)
class WireConfig:
    """Which curves are wires, where they end, and what is reported of them."""

    end_m: float = 8.0
    """A wire whose points end so near to its structure's axis hangs there; the gap is the insulator string,
    or a shadow."""
    clamp_m: float = 2.0
    """Points so near to a structure's axis may be clamps and crossarms: the curve is not fitted to them."""
    min_length_m: float = 8.0
    """Least length of a wire."""
    min_points: int = 10
    """Fewest points of a wire."""
    uncovered_gap_m: float = 5.0
    """Longer stretches without a point are not covered (the longest sampling gap that ArcGIS Pro allows)."""
    min_coverage: float = 0.25
    """Least share of a wire's length that is covered."""
    outlier_sigmas: float = 4.0
    """Points farther from a wire, in standard deviations of its own, do not belong to it."""
    min_sigma_m: float = 0.02
    """Least value of this standard deviation."""
    max_spread_m: float = 0.15
    """Greatest root mean square distance of a wire's points, sideways and in height."""
    beside_m: float = 1.0
    """Distance from a wire within which points of other things are counted."""
    piece_m: float = 2.0
    """Length of the pieces in which they are counted, and compared with the wire's own points."""
    max_cluttered_share: float = 0.5
    """Greatest share of the pieces with more than half as many other points as own ones: the edge of a roof
    or of a tree is no wire."""
    same_m: float = 0.12
    """Two curves with a smaller mean distance are one wire."""
    max_p_m: float = 6000.0
    """Greatest p of a wire.  What surely hangs less is a beam or a rail, or held in between; conductors have
    300 to 2500."""
    taut_sigmas: float = 3.0
    """"Surely" of `max_p_m`: its drop below the chord and so many standard deviations are less."""
    min_drop_sigmas: float = 4.0
    """In a span of at least the `min_length_m` of spans, the drop of one wire below its chord must be so many
    standard deviations."""
    stretches: int = 12
    """Number of stretches whose mean heights are compared with the catenary."""
    reported_misfit_m: float = 0.05
    """Root mean square of these mean heights from which on the misfit is reported."""
    reported_bow_m: float = 0.1
    """Sideways bow of a wire's points from its curve from which on it is reported."""
    min_break_m: float = 20.0
    """A wire ends at a gap in its points that is longer than this and than `break_spacings` spacings."""
    break_spacings: float = 12.0
    """The same gap in units of the mean spacing of the wire's points; the larger of the two counts."""
    min_span_share: float = 0.5
    """Least length of a wire as a share of its span's, unless it has the `min_length_m` of spans."""

    def __post_init__(self) -> None:
        require_positive(self, "min_length_m", "min_points", "piece_m", "max_p_m", "stretches", "min_break_m")


@dataclass(frozen=True)
class LidarConfig:
    """All that decides what is found in a point cloud."""

    min_height_m: float = 4.0
    """Least height of wires above the ground; fences are lower."""
    low_m: float = 2.0
    """Points higher above the ground than this may be of a structure, or lie beside a wire."""
    stray_m: float = 0.75
    """Points so near to a wire are plants only if other plants are near (`stray_apart_m`); else they are
    noise, spacers or dampers, which as plants would violate every clearance."""
    stray_apart_m: float = 1.0
    """Distance within which such a point must have plants that are farther than `stray_m` from the wire."""
    explained_m: float = 1.5
    """A place on a line is explained by a point of a wire or structure within this distance."""
    max_unexplained_share: float = 0.15
    """Share of unexplained places from which on they are reported."""
    cloud: CloudConfig = field(default_factory=CloudConfig)
    ground: GroundConfig = field(default_factory=GroundConfig)
    linear: LinearConfig = field(default_factory=LinearConfig)
    track: TrackConfig = field(default_factory=TrackConfig)
    span: SpanConfig = field(default_factory=SpanConfig)
    structure: StructureConfig = field(default_factory=StructureConfig)
    bundle: BundleConfig = field(default_factory=BundleConfig)
    wire: WireConfig = field(default_factory=WireConfig)
    things: ThingsConfig = field(default_factory=ThingsConfig)
    fit: FitConfig = field(default_factory=FitConfig)
    kinds: KindsConfig = field(default_factory=KindsConfig)

    def __post_init__(self) -> None:
        require_positive(self, "stray_m", "explained_m")
        if self.low_m > self.min_height_m:
            raise ConfigError(
                f"lidar: low_m must be at most min_height_m ({self.min_height_m:g} m), got {self.low_m:g}. "
                "Wires are sought among the points above low_m."
            )
