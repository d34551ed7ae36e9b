"""How wires are fitted and judged, and what holds them.  Without NumPy: the command line shows it at once."""

from dataclasses import dataclass, field
from typing import Literal

from plnerf.detect.config_lines import EvidenceConfig
from plnerf.errors import ConfigError
from plnerf.survey.config_end_sweep import EndSweepConfig
from plnerf.survey.config_spans import KinkConfig

UNKNOWNS = 6
"""Numbers of theta."""


@dataclass(frozen=True)
class FitConfig:
    """How a wire is fitted to points."""

    min_points: int = 6
    """Fewest points that a wire is fitted to."""
    sigma_m: float = 0.02
    """Least standard deviation of a point across the wire, in metres; the points' own scatter counts where it
    is larger."""
    robust_sigmas: float = 2.5
    """Residuals beyond so many standard deviations count less (Cauchy)."""
    outlier_sigmas: float = 5.0
    """Points beyond so many standard deviations are outliers."""
    swing_deg: float = 10.0
    """Standard deviation of a wire's swing, before its points are seen: in the 10 m/s up to which one flies,
    heavy conductors swing by 7 degrees and light ones by 16, and calm air is as common."""
    max_swing_deg: float = 60.0
    """No wire swings further."""
    max_rounds: int = 30
    """Most rounds of estimating the scatter and fitting: a deep wire is no parabola, and reaches its points
    by steps."""
    settled: float = 1e-7
    """Relative change of theta at which the rounds end."""

    def __post_init__(self) -> None:
        for name in (
            "sigma_m", "robust_sigmas", "outlier_sigmas", "swing_deg", "max_swing_deg", "max_rounds"
        ):  # fmt: skip
            if not getattr(self, name) > 0:
                raise ConfigError(
                    f"fit: {name} must be greater than 0, got {getattr(self, name)}. Give a positive value."
                )
        if self.min_points < UNKNOWNS:
            raise ConfigError(
                f"fit: min_points must be {UNKNOWNS} or more, since a wire has {UNKNOWNS} unknowns, got "
                f"{self.min_points}."
            )


Kind = Literal["phase", "shield", "neutral", "communication"]


@dataclass(frozen=True)
class KindsConfig:
    """How shields, neutrals and communication cables are told from phases."""

    level_m: float = 1.5
    """Wires so little below the highest, in their middles, are level with it (metres)."""
    below_m: float = 1.5
    """Least height of shields above all other wires, in metres."""
    max_shields: int = 2
    """Most shields of a span."""
    min_below: int = 3
    """Fewest wires below them: the phases of one circuit."""
    bundle_m: float = 0.65
    """Wires so near to each other are one bundle (metres)."""
    flatter: float = 0.93
    """Share of the others' median hang, 8 sag / span^2, below which a wire sags less."""
    thinner: float = 0.6
    """Share of the others' median number of points per metre below which a wire is thinner."""
    same_m: float = 1.0
    """Wires of two spans that a structure holds so near to each other, seen along the line, are one (metres):
    nearer than two phases ever are, and as far as strain insulators of a bend pull one aside."""
    min_share: float = 0.5
    """Share of a wire's length, over all spans that it goes through, in which it must look like a shield to
    be one.  Where nothing tells it from the phases it may still be one: of equal shares the one with a reason
    counts.  The same holds of neutrals and communication cables."""
    crossarm_m: float = 0.6
    """Three phases whose heights differ by less are on one crossarm (metres): what hangs alone below them is
    none of theirs."""
    neutral_m: tuple[float, float] = (0.8, 2.6)
    """How far below such a crossarm a neutral may hang, in metres."""
    communication_m: float = 5.0
    """How far below such a crossarm communication cables may hang, in metres, below the neutral."""
    phase: tuple[int, ...] = ()
    """Numbers of wires that are known to be phases, whatever they look like."""
    shield: tuple[int, ...] = ()
    """Numbers of wires that are known to be shields."""
    neutral: tuple[int, ...] = ()
    """Numbers of wires that are known to be neutrals: nothing is required of their clearances."""
    communication: tuple[int, ...] = ()
    """Numbers of wires that are known to be communication cables: likewise."""

    @property
    def stated(self) -> dict[int, Kind]:
        """The kinds that are known, by the wires' numbers."""
        every: tuple[tuple[Kind, tuple[int, ...]], ...] = (
            ("phase", self.phase), ("shield", self.shield), ("neutral", self.neutral),
            ("communication", self.communication),
        )  # fmt: skip
        return {number: kind for kind, numbers in every for number in numbers}

    def __post_init__(self) -> None:
        every = (*self.phase, *self.shield, *self.neutral, *self.communication)
        if len(set(every)) < len(every) or min(every, default=1) < 1:
            raise ConfigError(f"Wires of known kinds are numbered from 1, each once, but got {every}.")
        if not 0 < self.neutral_m[0] < self.neutral_m[1]:
            raise ConfigError(
                f"A neutral hangs between two heights below the phases, the first of them less, but got "
                f"neutral_m={self.neutral_m}."
            )


@dataclass(frozen=True)
class WireEvidenceConfig:
    """How points of a field are counted for a wire."""

    near_m: float = 0.25
    """A point this near to the wire, horizontally across it and in height, is on it."""
    step_m: float = 0.25
    """Length of the pieces of a wire that are with a point or without."""

    def __post_init__(self) -> None:
        if self.near_m <= 0 or self.step_m <= 0:
            raise ConfigError(
                f"Evidence needs near_m and step_m above 0, but got {self.near_m} and {self.step_m}."
            )


@dataclass(frozen=True)
class CollinearConfig:
    """When points make a wire."""

    min_views: int = 3
    """Views whose points a line must have."""
    min_points: int = 8
    """Points of a neighbourhood, and of the line in it."""
    elongation: float = 3.0
    """How many times as far a neighbourhood reaches along the span as across."""
    max_spread: float = 0.5
    """Spread across a neighbourhood, as a share of that along it, below which it may hold lines: twin
    conductors have up to 0.4, and a ball of leaves, which the neighbourhood cuts to its own shape, has 1/3
    and more."""
    core: float = 0.35
    """Distance from the line through a point, as a share of the radius, within which others are on it."""
    min_core_share: float = 0.1
    """Share of the neighbourhood that must lie on the line: the wires of a bundle are seen unequally well."""
    min_dense_share: float = 0.7
    """Share of those that must lie within half as far: of a wire all do, of a surface half, of leaves
    fewer."""
    min_extent: float = 0.5
    """Spread of those along the line, in radii: an endless line has 1.7, its end 0.9, a clump of leaves
    less."""
    max_turn_deg: float = 30.0
    """Angle to the span's axis within which a line may be a conductor."""
    min_length: float = 8.0
    """Length along the span, in radii, of the shortest piece of a conductor: the members of a lattice tower
    are lines too, but end sooner."""
    cell: float = 0.125
    """Side, in radii, of the cells that stand for their points when pieces are joined."""
    max_gap: float = 0.5
    """Distance between cells of one piece, in radii."""

    def __post_init__(self) -> None:
        if min(self.min_views, self.min_points) < 1 or min(self.elongation, self.cell, self.core) <= 0:
            raise ConfigError(
                "Points make a line only with min_views and min_points of 1 or more and elongation, cell and "
                f"core greater than 0, but got {self.min_views}, {self.min_points}, {self.elongation}, "
                f"{self.cell} and {self.core}."
            )


@dataclass(frozen=True)
class WirePointsConfig:
    """How points on wires are taken from a trained field."""

    max_per_view: int = 4000
    """Wire pixels of an image, the strongest first."""
    min_response: float = 0.2
    """Response of a pixel that may show a wire."""
    min_share: float = 0.25
    """Share of a ray's light that a thing must give to be there: a wire thinner than a pixel gives that part
    of it."""
    depth_window_px: float = 8.0
    """Half the range of depths within which that light must come, in widths of a pixel at that depth."""
    radius_px: float = 40.0
    """Radius of a neighbourhood across the span, in widths of a pixel at the typical distance."""
    same_deg: float = 4.0
    """Wires whose directions differ by less are looked for together, along that of the longest."""
    margin: float = 0.1
    """Points further outside of the scene's box are dropped; scene units, about half of the box's length."""
    evidence: EvidenceConfig = field(default_factory=EvidenceConfig)
    """Responses of pixels; the same for every preset, whatever its own detection uses."""
    collinear: CollinearConfig = field(default_factory=CollinearConfig)

    def __post_init__(self) -> None:
        if self.max_per_view < 1 or not 0 < self.min_share <= 1 or self.radius_px <= 0:
            raise ConfigError(
                "Points on wires need max_per_view >= 1, 0 < min_share <= 1 and radius_px > 0, but got "
                f"{self.max_per_view}, {self.min_share} and {self.radius_px}."
            )


@dataclass(frozen=True)
class AttachmentConfig:
    """What above a wire may hold it."""

    above_m: tuple[float, float] = (0.25, 1.6)
    """Heights above the wire: nearer points may be the wire's own, higher ones the next wire's."""
    aside_m: float = 0.5
    """Horizontal distance from the wire."""
    depth_m: float = 0.5
    """Along the line, of an arm and what hangs from it."""
    least_points: int = 12
    """At one place above one wire."""
    around_m: float = 1.0
    """To either side of a place, points above the wire are counted: a crown's are everywhere."""
    least_share: float = 0.8
    """Share of those that must be at the place."""
    step_m: float = 0.05
    """Between the places that are tried."""


@dataclass(frozen=True)
class BodyConfig:
    """What fills the wires' corridor is a structure."""

    step_m: float = 0.5
    """Pieces of the corridor, along it and in height."""
    beside_m: float = 1.0
    """How much wider than the wires the corridor is, on either side."""
    filled: float = 0.6
    """Share of the heights below the lowest wire, down to half of its height, that must hold points."""
    foot_m: float = 1.0
    """Points nearer to the ground are taken for the ground."""
    around_m: float = 20.0
    """The ground at a place is the lowest point within this distance along the corridor."""
    outer: float = 0.3
    """Share of the line, at either end, in which a structure is looked for."""
    short_m: float = 1.5
    """What a structure may lack of the height of its highest wire; what ends further below holds up none."""
    half_depth_m: float = 2.5
    """Of a structure's body along the line, from its axis."""
    confirmed: float = 0.3
    """Share of those heights that stereo must fill as well at a body that the field shows: a field of a few
    hundred steps shows bodies where nothing is.  Stereo sees the near side of a lattice only."""
    confirmed_within_m: float = 1.0
    """Stereo must show that at most so far along the line from where the field does."""


@dataclass(frozen=True)
class PoleConfig:
    """What is slender enough to be a pole, and how well points show its axis."""

    about_m: float = 0.6
    """Its points lie so near to what holds the wires, along the line and across it,"""
    foot_m: float = 1.5
    """so high above the ground,"""
    below_wires_m: float = 0.5
    """and so far below the lowest wire: above are crossarms."""
    step_m: float = 0.5
    """Pieces of its height that hold points"""
    least_tall_m: float = 1.5
    """must be as long together: photos may show its upper part only."""
    least_points: int = 60
    edges: tuple[float, float] = (5.0, 95.0)
    """Percentiles of its points along the line that count as its two sides;"""
    widest_m: float = 0.6
    """no pole is wider, a lattice is."""
    carries_m: float = 0.25
    """So far from its axis, and by the deviation of where they are held, crossarms carry wires (those of even
    seeds 74, 106, 126 and 136 by 0.04 to 0.15 m); a leg of a lattice stands farther."""
    sigma_m: float = 0.07
    """Standard deviation of its axis along the line: of six poles of random scenes (seeds 102, 106, 126, 136,
    and 177 and 195, which had been looked at before) it is 0 to 0.08 m off."""

    def __post_init__(self) -> None:
        if not 0 <= self.edges[0] < self.edges[1] <= 100:
            raise ConfigError(f"The edges of poles must be rising percentiles, but are {self.edges}.")


@dataclass(frozen=True)
class SupportConfig:
    """How the structures that hold wires are found.  The deviations are those measured on rendered ones."""

    kink: KinkConfig = field(default_factory=KinkConfig)
    body: BodyConfig = field(default_factory=BodyConfig)
    pole: PoleConfig = field(default_factory=PoleConfig)
    attachment: AttachmentConfig = field(default_factory=AttachmentConfig)
    sweep: EndSweepConfig = field(default_factory=EndSweepConfig)
    by_stereo_m: float = 0.05
    """Standard deviation along the line of an attachment that stereo shows."""
    by_field_m: float = 0.15
    """The same of one that the field shows."""
    by_sweep_m: float = 0.15
    """The same of one on which single photos agree, beside what a tension string's length adds: pins may
    stand so far before the pole."""
    by_pin_m: float = 0.08
    """The same of a wire that photos show to stand there, from the structure's own place."""
    pin_m: float = 0.1
    """And of a wire that nothing is seen to hold, which may stand on a pin before the pole or behind it."""
    by_body_m: float = 0.3
    """The same of a body, which kinks are compared with: by itself it makes no attachment."""
    by_tee_m: float = 1.5
    """The same where a line ends at another line's structure and nothing else shows where on it."""
    least_wires: int = 2
    """Wires above which something must be seen that holds them, of spans that have so many; a single one
    suffices beside a body."""
    agree_sigmas: float = 3.0
    """Kinks and what is seen agree if their places differ by at most so many standard deviations."""
    around_m: float = 2.5
    """What holds the wires is looked for so far from a structure's body, or from the wires' kinks."""
    about_end_m: float = 6.0
    """And without either so far from where the images stop showing the wires: they may show the next span's,
    or the structure but not the wires before it."""
    surroundings_m: float = 30.0
    """Points so far around the end of a span, along the line and beside its wires, are considered."""
    least_span: float = 0.25
    """Structures at both ends of a span are one if they are nearer to each other than this share of what the
    images show of it."""
    polyline_places: int = 120
    """Places at which wires are compared with points."""
    tee_m: float = 4.0
    """A line that ends so near to a structure of another line, beyond the wires that this one holds, ends
    there."""
