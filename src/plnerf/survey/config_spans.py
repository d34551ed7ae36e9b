"""How wires become spans and spans lines, of images.  Without NumPy: the command line shows it at once."""

from dataclasses import dataclass

from plnerf.errors import ConfigError
from plnerf.survey.config_end_sweep import HALF_TURN_DEG


@dataclass(frozen=True)
class ChainConfig:
    """Which wires hang side by side in one span, and which spans go on in one another."""

    max_angle_deg: float = 5.0
    """Greatest angle in plan between wires of one span: their attachments may be further apart at one end."""
    min_overlap: float = 0.6
    """Least share of the shorter wire beside which the other must run; more than half, so that a piece that
    spans a structure belongs to one of the two spans only."""
    close_m: float = 8.0
    """Wires so near to each other, in plan, belong to one span."""
    wide_m: float = 20.0
    """Wires up to so far apart do if their ends are level: parallel lines have structures of their own."""
    level_m: float = 15.0
    """Ends that differ by at most so much along the line are level."""
    level_share: float = 0.15
    """The same as a share of the wire's length; the larger of the two counts."""
    max_bend_deg: float = 60.0
    """Greatest angle by which a line turns at a structure."""
    reach_m: float = 12.0
    """The curves of adjacent spans meet at most so far before or beyond the ends of what the images show."""
    reach_share: float = 0.3
    """The same as a share of the shorter span; the smaller of the two counts,"""
    least_reach_m: float = 1.5
    """but at least this: of a span that the images show hardly more than its tension strings of, as short a
    reach as the share's would end between these."""
    gap_m: float = 0.5
    """Curves of one conductor in adjacent spans come at least so near to each other.  Both are known to
    decimetres there: they end a few metres from it, or go on beyond."""
    step_m: float = 0.25
    """Between the places at which spans are compared."""

    def __post_init__(self) -> None:
        if min(self.close_m, self.reach_m, self.least_reach_m, self.gap_m, self.step_m) <= 0:
            raise ConfigError(
                "Spans need close_m, reach_m, least_reach_m, gap_m and step_m above 0, but got "
                f"{self.close_m}, {self.reach_m}, {self.least_reach_m}, {self.gap_m} and {self.step_m}."
            )
        if not 0.5 < self.min_overlap <= 1 or not 0 <= self.max_bend_deg < 90:
            raise ConfigError(
                "Spans need 0.5 < min_overlap <= 1 and 0 <= max_bend_deg < 90, but got "
                f"{self.min_overlap} and {self.max_bend_deg}."
            )


@dataclass(frozen=True)
class KinkConfig:
    """When two curves show, by the kink in which they meet, where a structure holds them."""

    misfit_m: float = 0.005
    """Standard deviation of what a wire departs from its catenary near a clamp, and of what the covariances
    of its curve leave out."""
    strings_m: float = 0.1
    """The same of heights, where tension strings may hold the wire: by so much do strings of a few metres
    hang otherwise than the wire would go on."""
    plan_share: float = 1.5
    """Where the line bends so much that a kink, with heights as uncertain as this, has at most so many times
    the deviation that it has with exact ones, they count for no more."""
    least_turn: float = 0.02
    """Least change of direction, as a slope: curves of a wire that goes on unheld differ by their errors."""
    least_turn_sigmas: float = 4.0
    """The same in its standard deviations."""
    uplift_sigmas: float = 3.0
    """A wire that turns upwards by so many standard deviations is not held up there."""
    gap_sigmas: float = 3.0
    """Curves that miss each other by more standard deviations than this have larger ones than they state."""
    around_m: float = 2.5
    """A conductor's kink lies at most so far from where most of the span's meet."""
    arms_m: float = 0.1
    """Standard deviation of a conductor's attachment along the line from that of its structure: strings lean,
    and crossarms are not at right angles to the line."""
    outlier_sigmas: float = 4.0
    """A kink further than this from the others' does not count, and its conductor is held where they are."""
    most_sigma_m: float = 0.5
    """Standard deviation along the line beyond which kinks show no place."""
    least_sigma_m: float = 0.02
    """Least standard deviation of a structure's place: the errors of a span's wires are not independent."""
    alone_unseen_m: float = 2.5
    """A kink with which no other agrees counts if images show one of its wires so near to it."""

    def __post_init__(self) -> None:
        if min(self.misfit_m, self.strings_m, self.arms_m, self.least_sigma_m) <= 0:
            raise ConfigError(
                "Kinks need misfit_m, strings_m, arms_m and least_sigma_m above 0, but got "
                f"{self.misfit_m}, {self.strings_m}, {self.arms_m} and {self.least_sigma_m}."
            )


@dataclass(frozen=True)
class StructureKindConfig:
    """When curves tell what kind of structure holds them."""

    strain_deg: float = 30.0
    """A line that turns by more is held by strain structures: strings of suspension would lean too far."""
    strain_ratio: float = 0.05
    """Least logarithm of the ratio of H/w before and after a structure that only a strain structure holds."""
    even_ratio: float = 0.02
    """Greatest such logarithm, and its greatest standard deviation, at a suspension structure."""
    straight_deg: float = 5.0
    """Greatest angle of the line at a suspension structure."""
    sigmas: float = 4.0
    """Ratios differ from 1 by at least so many of their standard deviations."""
    beyond_m: tuple[float, float] = (5.0, 10.0)
    """So far beyond the last structure wires are missed, if they went on."""
    beyond_deg: float = 45.0
    """Straight on, and by so much to either side."""
    beyond_share: float = 0.5
    """Images that must show each of these places, as a share of those that show the wires as far before."""
    near: float = 2.0
    """An image shows a place as well as the nearest shows the wires if it is at most so many times as far."""


@dataclass(frozen=True)
class CrossarmConfig:
    """When a curve is a structure's arm rather than a wire."""

    across_deg: float = 45.0
    """Least angle to the line."""
    beyond_m: float = 2.0
    """Arms reach at most so far beyond the outermost wire that they hold; where the wires of one side alone
    are found, their inner ends lie beyond all of them, at the structure's axis.  Of 80 random surveys no
    wire ends within 6 m of a structure at both ends, across the others, but two such arms."""

    def __post_init__(self) -> None:
        if not 0 < self.across_deg < 90 or self.beyond_m < 0:
            raise ConfigError(
                "Crossarms need across_deg between 0 and 90 and beyond_m of 0 or more, but got "
                f"{self.across_deg} and {self.beyond_m}."
            )


@dataclass(frozen=True)
class TensionStringConfig:
    """When images show that tension strings hold the wires, and how long these are."""

    step_m: float = 0.1
    """Between the places along a wire, counted from its structure."""
    sample_m: float = 0.01
    """Between the samples across it."""
    core_m: float = 0.021
    """Samples so near to the wire's axis show the wire itself."""
    near_m: tuple[float, float] = (0.045, 0.085)
    """Samples between these distances from its axis show a string, but no wire."""
    far_m: tuple[float, float] = (0.18, 0.28)
    """Samples between these show what is behind: the other conductors of a bundle are farther."""
    noise: float = 3.0
    """Difference of grey values (0 to 255) that noise alone makes."""
    end_on: float = 0.3
    """Least sine of the angle between a wire and the ray that it is seen by."""
    least_px_per_m: float = 25.0
    """Pixels that a metre across the wire must have."""
    window_m: tuple[float, float] = (0.1, 0.4)
    """Where strings are distinguished from wires: no tension string is shorter."""
    beyond_m: float = 2.0
    """The wire is compared with itself over so much beyond the longest string."""
    min_samples: int = 40
    """Places, of all images and conductors, that each of both must have."""
    string_ratio: float = 2.0
    """From this ratio of q there and beyond on, strings hold the wires."""
    bare_ratio: float = 1.25
    """Up to this ratio the wire goes on up to the structure."""
    sigmas: float = 2.0
    """And by so many standard deviations it must exceed `bare_ratio`: of a few images, some show a tower's
    edge behind a wire.  One that is below `string_ratio` by as many is a wire's."""
    string_q: float = 0.4
    """Least q of strings, whatever it is beyond: of a wire that stands out well there it is less."""
    bare_q: float = 0.3
    """Up to this q it is a wire."""
    seen_to: float = 0.6
    """The wire itself is looked for as far as this share of the longest string;"""
    seen_ratio: float = 0.6
    """it is seen from this ratio of p there and beyond on.  At structures of random scenes of even seeds
    that is 0.88 and more where wires go on, and 0.41 and less where strings hold them."""
    damper_from_m: float = 0.3
    """No damper hangs nearer to the end of a string,"""
    damper_m: float = 0.8
    """and none is seen over more of the wire; 0: there are none."""
    sigma_m: float = 0.15
    """Standard deviation of the length of a string that images show."""
    half_turn_deg: float = HALF_TURN_DEG
    """Standard deviation of the angle by which arms are turned, at a line's last structure."""
    alike_m: float = 0.1
    """Standard deviation of the strings of one line from each other."""
    alike_misfit: float = 1.15
    """A structure's strings are taken to be as long as the line's others if that length fits what images show
    at most so many times as badly as the best one."""
    placed_m: float = 0.2
    """Structures whose place has a greater standard deviation are placed by their strings."""
    spacing_share: float = 0.8
    """Greatest length of a string as a share of the least distance between phases: strings as long hang at
    other structures, above the next arm."""
    bundle_m: float = 0.65
    """Wires so near to each other are one phase."""
    alone_m: float = 0.6
    """Wires that hang so far above all others may be shields, and are judged without these."""
    longest_m: float = 5.0
    """Greatest length of a string of any voltage."""
    turned_deg: float = 5.0
    """Of point clouds: a line that turns by more may be held by tension strings."""

    def __post_init__(self) -> None:
        offsets = (0.0, self.core_m, *self.near_m, *self.far_m)
        if list(offsets) != sorted(set(offsets)) or not 0 < self.step_m < self.window_m[1]:
            raise ConfigError(
                "Tension strings need 0 < core_m < near_m < far_m, rising, and 0 < step_m < window_m, "
                f"but got {self.core_m}, {self.near_m}, {self.far_m}, {self.step_m} and {self.window_m}."
            )
        if not 0 < self.seen_to <= 1 or not 0 <= self.seen_ratio <= 1:
            raise ConfigError(
                "Tension strings need a seen_to above 0 and at most 1 and a seen_ratio from 0 to 1, but got "
                f"{self.seen_to} and {self.seen_ratio}."
            )
        if min(self.damper_from_m, self.damper_m) < 0 or not 0 <= self.half_turn_deg < 90:
            raise ConfigError(
                "Tension strings need damper_from_m and damper_m of 0 or more and a half_turn_deg from 0 to "
                f"below 90, but got {self.damper_from_m}, {self.damper_m} and {self.half_turn_deg}."
            )
        if self.alike_misfit < 1:
            raise ConfigError(f"Tension strings need alike_misfit of 1 or more, but got {self.alike_misfit}.")
        if not 1 <= self.bare_ratio <= self.string_ratio or self.min_samples < 1:
            raise ConfigError(
                "Tension strings need 1 <= bare_ratio <= string_ratio and min_samples of 1 or more, but got "
                f"{self.bare_ratio}, {self.string_ratio} and {self.min_samples}."
            )
