"""What decides which wires are detected in images.

Letters and frames as in `parabola.py`: a window's frame, whose unit is half its length.  Log odds are in
nats.
"""

import math
from dataclasses import dataclass, field, replace

from plnerf.detect.config_lines import (
    ChainConfig,
    DirectionConfig,
    EvidenceConfig,
    LineMapConfig,
    RidgeConfig,
    SegmentConfig,
    SurroundingsConfig,
    check,
)
from plnerf.detect.config_windows import OnwardConfig, WindowConfig

FARTHEST_PX = 32
"""The greatest distance from a ridge that is kept (`nearest.py`)."""


@dataclass(frozen=True)
class OddsConfig:
    """Log odds of a wire from a ridge or its absence (`odds.py`)."""

    min_response: float = 0.25
    """Response below which a pixel is no ridge."""
    shown: float = 0.4
    """P: probability that a view shows the ridge of a wire."""
    radii_px: tuple[float, ...] = (0.75, 1.5, 3.0, 6.0, 12.0)
    """Radii for which the density of ridges is tabulated, increasing."""
    sharp_px: float = 1.5
    """Radius within which a ridge is a wire's, until the first wire has shown how accurate poses are."""
    around_px: float = 12.0
    """Standard deviation of the neighbourhood whose density of ridges counts, beyond the radius itself."""
    min_density: float = 0.02
    """Least density of ridges: however empty a sky, one ridge says no more than this."""
    coarsest: float = 0.25
    """Resolution below which a view does not count, as a share of that of the view that resolves best: from
    so much farther away a wire is too thin, and one that is not seen there is no less likely."""
    enough_px: float = 4.0
    """No view needs to resolve better than so many pixels to the reach within which a wire is looked for."""
    turn_deg: float = 5.0
    """A wire's ridge runs as the wire does, to within this angle,"""
    turn_shown: float = 0.95
    """with this probability,"""
    turn_chance: float = 0.35
    """and another one with this: 0.2 to 0.35 of the ridges beside wires do."""
    muffled_px: int = 4
    """Within this distance of other wires' ridges a weaker ridge is hidden: its absence is no evidence."""

    def __post_init__(self) -> None:
        check(
            0 < self.shown < 1 and min(self.min_density, self.min_response, self.coarsest) > 0
            and max(self.min_density, self.min_response, self.coarsest) <= 1,
            "detect.odds needs shown, min_density, min_response and coarsest between 0 and 1",
            self,
        )
        check(
            self.turn_deg > 0 and 0 < self.turn_chance <= self.turn_shown < 1,
            "detect.odds needs turn_deg above 0, and turn_chance not above turn_shown, both between 0 and 1",
            self,
        )
        radii, positive = self.radii_px, (*self.radii_px, self.sharp_px, self.around_px, self.enough_px)
        check(
            bool(radii) and min(positive) > 0 and list(radii) == sorted(radii) and self.muffled_px >= 0,
            "detect.odds needs positive radii, radii_px in increasing order, and muffled_px of 0 or more",
            self,
        )
        check(
            max(*radii, self.sharp_px) <= FARTHEST_PX,
            f"detect.odds needs radii_px and sharp_px of {FARTHEST_PX} or less",
            self,
        )


@dataclass(frozen=True)
class RefitConfig:
    """The least-squares fit of a curve to ridges (`refit.py`)."""

    windows_px: tuple[int, ...] = (4, 3, 2, 2, 2)
    """Distance to both sides of the curve within which a ridge is its own, iteration by iteration."""
    turn_deg: float = 10.0
    """A ridge is the curve's own only if it runs as the curve does, to within this angle."""
    end_on: float = 0.15
    """Sine of the angle between curve and line of sight below which a view says nothing."""
    sigma_px: float = 0.5
    """Least standard deviation of a ridge's place."""
    min_rows: int = 20
    """Observations without which there is no fit."""
    prior: float = 0.05
    """Standard deviation of a curve's numbers before any view, in scene units: where views fix nothing, as
    from a track that runs along the wire, the fit stays where it began and its covariance says so."""
    swing_rad: float = math.radians(7.0)
    """Standard deviation of the angle by which wind swings a wire's plane, before any view: in the 10 m/s up
    to which one flies heavy conductors swing by 7 degrees and light ones by 16, and calm air is as common."""
    planes_alike: float = 4.0
    """Observations of one view in neighbouring planes share their error: so many count as one."""
    bias_px: float = 0.2
    """Standard deviation of what light from one side moves a ridge by in one view and not in another: the
    less they differ in direction, the farther off a wire may be for it."""
    view_px: tuple[float, ...] = (0.05, 0.1, 0.2, 0.4, 0.8)
    """Standard deviations, of which the likeliest is taken, of what a view's pose moves all its ridges by:
    its shift, and its turn at the ends of what it shows."""

    def __post_init__(self) -> None:
        check(
            bool(self.windows_px) and min(self.windows_px) >= 1,
            "detect.refit needs windows_px of 1 or more",
            self,
        )
        check(
            min(self.sigma_px, self.prior, self.swing_rad, self.planes_alike, self.min_rows) > 0
            and min(self.bias_px, self.turn_deg) > 0,
            "detect.refit needs sigma_px, prior, swing_rad, planes_alike, min_rows, bias_px and turn_deg "
            "above 0",
            self,
        )
        check(
            bool(self.view_px) and min(self.view_px) > 0 and list(self.view_px) == sorted(self.view_px),
            "detect.refit needs positive view_px in increasing order",
            self,
        )


@dataclass(frozen=True)
class SearchConfig:
    """One line after the other, each from the ridges that the others leave (`search.py`, `detect.py`)."""

    coarse: int = 3
    """Curves are compared in one plane of so many before they are fitted."""
    reach: float = 0.0007
    """Curves are known to so much before they are fitted, in units of half a window's length."""
    apart: float = 0.002
    """Where curves lie nearer to each other than this, in the same unit, only the best is tried."""
    most_pending: int = 400
    """Curves that are tried, at most."""
    fruitless: int = 80
    """Curves without a line after which no others are tried."""
    mask_px: int = 2
    """Ridges within this distance of a line are its own."""
    mask_rms: float = 4.5
    """The same in units of the root mean square distance of the first line's ridges, because poses that are
    wrong scatter them."""
    sharpness_px: tuple[float, ...] = (0.75, 1.5, 3.0)
    """Radii within which a ridge may be a wire's; the one that suits the first line best is used from then
    on."""
    min_mean: float = 0.35
    """Nats for each time that a view sees the line in a plane.  Beside other wires' ridges hardly a view
    speaks against a curve, and chance ridges add up there."""
    doubt: float = 0.3
    """Nats taken off in each plane, so that a line ends where views no longer show it."""
    rounds: int = 5
    """Searches for lines that hang as the best do, at most."""
    gap_px: float = 6.0
    """A line is the background between twin conductors only if it is so near to both of them,"""
    faint_gap_px: float = 24.0
    """or so near if it is faint beside them, since views that graze a pair see it narrow,"""
    faint: float = 0.33
    """with less than this part of the odds that each of them has in a plane,"""
    middle_px: float = 1.0
    """and so near to their middle."""
    stretches: int = 6
    """Fits of a line, at most: each to the stretch in which the one before was seen, since a window may hold
    several spans."""
    coarse_step: int = 3
    """These fits use one plane in so many; the last fit uses all."""
    promising: float = 0.75
    """A line that has less than this part of the odds it needs after two fits or more is given up,"""
    growing: float = 1.25
    """unless the last fit raised its odds by this factor or more."""
    least_planes: int = 8
    """Shortest stretch that a line is fitted to alone."""
    around: float = 0.15
    """A wire may end so far from the structure at which another goes on, to both sides,"""
    onward: float = 0.006
    """and that runs past it by no more than this, both in units of half a window's length."""
    refits: int = 2
    """How often all lines are fitted again once the others are known."""
    side_by_side: float = 0.05
    """Two lines are fitted together that lie within this of each other, in the same unit,"""
    parallel: float = 0.9
    """and whose least distance is less than this part of their largest one: twins run beside each other."""
    starts_together: int = 4
    """Pairs of curves that two lines are fitted to together, at most."""
    sides_deg: float = 5.0
    """Views look from two sides if the angle between these is at least what either spans, and this."""
    meeting: float = 0.35
    """Of two lines whose least distance is less than this part of their largest one, one may be a mixture,"""
    merged_odds: float = 0.9
    """and gives way to the other if that, alone, has so large a part of what both have."""
    max_lines: int = 40
    """Lines at most, edges of roads included."""

    def __post_init__(self) -> None:
        check(
            min(self.coarse, self.most_pending, self.fruitless, self.max_lines) >= 1
            and min(self.stretches, self.coarse_step) >= 1
            and self.least_planes > self.coarse_step,
            "detect.search needs coarse, most_pending, fruitless, max_lines, stretches and coarse_step of 1 "
            "or more, and more least_planes than coarse_step",
            self,
        )
        check(
            bool(self.sharpness_px) and min(*self.sharpness_px, self.mask_rms, self.reach, self.apart) > 0,
            "detect.search needs positive sharpness_px, mask_rms, reach and apart",
            self,
        )
        check(
            min(self.mask_px, self.rounds, self.refits, self.doubt) >= 0
            and min(self.around, self.onward, self.side_by_side, self.sides_deg) > 0
            and max(self.parallel, self.meeting, self.merged_odds) <= 1,
            "detect.search needs mask_px, rounds, refits and doubt of 0 or more, around, onward, "
            "side_by_side and sides_deg above 0, and parallel, meeting and merged_odds of 1 or less",
            self,
        )


@dataclass(frozen=True)
class SelectConfig:
    """Which of the lines are wires (`candidate.py`): those that hang."""

    min_odds: float = 250.0
    """Nats.  Neighbouring planes and views share their evidence: this is less than it looks."""
    min_odds_similar: float = 200.0
    """The same for one that hangs like a leader, the strongest line of its span,"""
    min_odds_repeated: float = 100.0
    """for one that hangs beside such a line as two others hang beside each other,"""
    min_odds_continued: float = 60.0
    """and for one that begins where another wire ends."""
    min_planes: int = 19
    """Planes that must show a wire which hangs unlike the best."""
    min_sag: float = 0.001
    """Least sag as a fraction of the length.  A wire hangs; edges of roads do not."""
    sag_sigmas: float = 4.0
    """Standard deviations by which the sag must differ from 0,"""
    sag_sigmas_free: float = 3.0
    """or only so many where what is seen beside the line lies behind it."""
    free: float = 0.2
    """It does where views correlate by no more than this beside the line, as they do beside wires;"""
    lies: float = 0.4
    """and where they correlate by more than this the line lies on something, as edges of roads do;"""
    lies_alike: float = 0.55
    """by more than this if it hangs clearly, and as a leader does: of 22 random scenes no line that lies on
    something hangs so."""
    steep: float = 2.0
    """A line that hangs alone is a wire if it is above another one, aside by so many times the height between
    them at most."""
    max_slope_difference: float = 0.03
    """Two wires hang alike whose chords' slopes differ by no more, across and upwards,"""
    max_sag_ratio: float = 1.6
    """and whose sags differ by no more than this factor."""

    def __post_init__(self) -> None:
        check(
            self.max_sag_ratio >= 1
            and min(self.min_sag, self.sag_sigmas, self.sag_sigmas_free) >= 0
            and min(self.max_slope_difference, self.steep) >= 0
            and self.free <= self.lies <= self.lies_alike,
            "detect.select needs max_sag_ratio of 1 or more, min_sag, sag_sigmas, sag_sigmas_free, "
            "max_slope_difference and steep of 0 or more, and free not above lies, nor that above lies_alike",
            self,
        )


@dataclass(frozen=True)
class JoinConfig:
    """Pieces of one wire in neighbouring windows (`join.py`)."""

    min_overlap: float = 0.3
    """Two pieces are of one wire of one span only if they overlap by this fraction of the shorter one."""
    same_reach: float = 0.25
    """Two of one window are one curve if where they overlap they are no farther apart than this part of the
    smaller reach: a standard deviation, or less than a pixel,"""
    max_misfit: float = 4.0
    """and if the chi-square of their difference is no more than this by parameter."""

    def __post_init__(self) -> None:
        check(
            0 < self.min_overlap <= 1 and min(self.same_reach, self.max_misfit) >= 0,
            "detect.join needs a min_overlap above 0 and at most 1, same_reach and max_misfit of 0 or more",
            self,
        )


@dataclass(frozen=True)
class MeetConfig:
    """Where wires of two spans meet, at the structure that holds both (`structures.py`)."""

    about: float = 0.15
    """Wires meet within this fraction of their length of their ends, before them or beyond."""
    sigmas: float = 3.0
    """They pass each other by so many standard deviations of both at most."""
    most_sigma: float = 0.005
    """Where the standard deviation of a wire, in units of its length, is larger, no meeting is looked for."""
    most_turn_rad: float = math.radians(65.0)
    """A line turns by this angle at most."""
    least_turn_rad: float = 0.02
    """Wires turn by this angle at least where a structure holds them, up or aside: with a sag of 0.3 % of the
    span to both sides they do."""
    step: float = 0.001
    """Spacing of the places that are compared, in the same unit."""

    def __post_init__(self) -> None:
        check(
            min(self.about, self.sigmas, self.most_sigma, self.least_turn_rad, self.step) > 0
            and self.about < 0.5 and self.least_turn_rad < self.most_turn_rad,
            "detect.meet needs positive numbers, about below 0.5, and least_turn_rad below most_turn_rad",
            self,
        )


@dataclass(frozen=True)
class CertaintyConfig:
    """When the place of a wire is certain, and how far from its curve it may lie (`candidate.py`)."""

    certain_px: float = 3.0
    """A wire is certain if its standard deviation across, over half of it or more, is no more pixels than
    this,"""
    certain_m: float = 0.05
    """or no more metres than this.  Others are what views do not fix, or no wires at all."""
    least_planes: int = 8
    """Shortest stretch to which a wire is cut so that it is certain."""
    reach_sigmas: float = 4.0
    """A wire lies within so many standard deviations of its curve,"""
    reach_px: float = 3.0
    """or within so many pixels, whichever is more."""
    nearest_views: float = 0.25
    """A pixel is as wide as in this fraction of the views, those that are nearest: they resolve the wire."""

    def __post_init__(self) -> None:
        check(
            0 < self.nearest_views <= 1
            and min(self.certain_px, self.certain_m, self.reach_sigmas, self.reach_px) > 0
            and self.least_planes >= 2,
            "detect.certainty needs certain_px, certain_m, reach_sigmas and reach_px above 0, least_planes "
            "of 2 or more, and nearest_views above 0 and at most 1",
            self,
        )


@dataclass(frozen=True)
class DetectConfig:
    """All settings of the detection of wires in images."""

    evidence: EvidenceConfig = field(default_factory=EvidenceConfig)
    lines: LineMapConfig = field(default_factory=LineMapConfig)
    segments: SegmentConfig = field(default_factory=SegmentConfig)
    directions: DirectionConfig = field(default_factory=DirectionConfig)
    windows: WindowConfig = field(default_factory=WindowConfig)
    onward: OnwardConfig = field(default_factory=OnwardConfig)
    chains: ChainConfig = field(default_factory=ChainConfig)
    odds: OddsConfig = field(default_factory=OddsConfig)
    refit: RefitConfig = field(default_factory=RefitConfig)
    search: SearchConfig = field(default_factory=SearchConfig)
    surroundings: SurroundingsConfig = field(default_factory=SurroundingsConfig)
    select: SelectConfig = field(default_factory=SelectConfig)
    join: JoinConfig = field(default_factory=JoinConfig)
    meet: MeetConfig = field(default_factory=MeetConfig)
    certainty: CertaintyConfig = field(default_factory=CertaintyConfig)
    ridges: RidgeConfig = field(default_factory=RidgeConfig)
    """Of the maps that choose detail pixels where `train.detail_map` is "ridge"."""

    def along(self, azimuth_deg: float | None) -> "DetectConfig":
        """The same for a line whose azimuth is known, in degrees clockwise from north; None: as it is."""
        if azimuth_deg is None:
            return self
        return replace(self, directions=replace(self.directions, azimuth_deg=azimuth_deg))


DEFAULT = DetectConfig()
