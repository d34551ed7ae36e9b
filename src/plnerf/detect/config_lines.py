"""What decides which thin lines images show, and which way they run.

Letters and frames as in `config.py`.
"""

import math
from dataclasses import dataclass, field, replace

from plnerf.errors import ConfigError


def check(holds: bool, rule: str, config: object) -> None:
    """Raises ConfigError with the rule and what came unless it holds."""
    if not holds:
        raise ConfigError(f"{rule}, but got {config}.")


@dataclass(frozen=True)
class RidgeConfig:
    """Wire maps of single photos, without poses (`ridges.py`); chosen on photos (docs/wire-maps.md)."""

    scales_px: tuple[float, ...] = (0.9, 1.8)
    """Standard deviations of the Gaussians; s serves lines up to 3.5 s wide."""
    half_length_px: float = 60.0
    """Half the length over which responses are averaged."""
    directions: int = 64
    """Directions in half a turn, a multiple of 4."""
    edge_weight: float = 1.0
    """Weight of the first derivative across the line, which is subtracted."""
    max_response: float = 4.0
    """Largest response of one pixel, in units of the contrast nearby."""
    around_px: float = 8.0
    """Standard deviation of the neighbourhood whose contrast responses are compared with."""
    floor: float = 0.025
    """Least contrast, of the standard deviation of the picture's brightness."""
    min_contrast: float = 1e-4
    """The same, of the full brightness: a picture without contrast has no ridges, and round-off is none."""
    half_response: float = 0.75
    """Average response that the map shows as 0.5."""

    def __post_init__(self) -> None:
        lengths = (*self.scales_px, self.half_length_px, self.around_px)
        responses = (self.max_response, self.min_contrast, self.half_response)
        check(
            bool(self.scales_px) and min(*lengths, *responses) > 0 and min(self.edge_weight, self.floor) >= 0,
            "detect.ridges needs a scale, positive lengths and responses, and no negative weight",
            self,
        )
        check(
            self.directions >= 4 and self.directions % 4 == 0,
            "detect.ridges needs a multiple of 4 directions",
            self,
        )


@dataclass(frozen=True)
class LineMapConfig:
    """Thin lines of any direction in each image (`line_maps.py`)."""

    ridges: RidgeConfig = field(default_factory=lambda: RidgeConfig(half_length_px=25.0))
    """Averages over shorter lines than maps of single photos: near wires bend in the image."""
    min_response: float = 0.25
    """Response below which a pixel is on no line."""
    beside_px: int = 2
    """The middle of a line is the strongest pixel within this distance to both sides."""
    echo_px: int = 5
    """Within this distance no response of the other polarity may be stronger."""

    def __post_init__(self) -> None:
        check(0 < self.min_response <= 1, "detect.lines needs a min_response above 0 and at most 1", self)
        check(0 <= self.beside_px <= self.echo_px, "detect.lines needs 0 <= beside_px <= echo_px", self)


@dataclass(frozen=True)
class EvidenceConfig:
    """Response of a pixel to a line that runs along the span (`evidence.py`)."""

    scales_px: tuple[float, ...] = (0.7, 1.4, 2.8)
    """Standard deviations of the Gaussians: wires 1 to 8 px wide."""
    gamma: float = 1.0
    """Power of the scale by which a second derivative is multiplied.  With 2 (scale invariance) the widest
    scale, which sees texture as lines, outvotes wires of a pixel or two; Lindeberg recommends 3/2 for
    ridges."""
    edge_weight: float = 0.75
    """Weight of the first derivative across the line, which is subtracted: the middle of a line is even, an
    edge is not."""
    max_bend: float = 3.0
    """Largest response of one pixel, in units of the neighbourhood's root mean square: no single pixel makes
    a line."""
    along_px: float = 20.0
    """Half the length over which responses are averaged along the line: texture is not straight.  With 28,
    which costs the same, as much is detected."""
    sag_deg: float = 14.0
    """A wire's slope differs by so much from that of the direction in which it is looked for, up and down:
    wires sag, and hang between supports of unequal heights,"""
    askew_deg: float = 3.5
    """and its azimuth by so much."""
    lens_deg: float = 3.5
    """In the image it may be turned by so much more: by the lens, say."""
    most_deg: float = 28.0
    """What slopes and azimuths turn a wire by in the image, at most: where a view runs along it, that is many
    times as much as they differ in space."""
    apart_deg: float = 2.5
    """Of the directions that remain at a pixel so many are tried that they are no farther apart.  Detected of
    40 random scenes of even seeds are 1,016 of 1,057 m, with 3.5 degrees 1,012."""
    beside_px: int = 2
    """A ridge is the strongest pixel within this distance to both sides of the line."""
    echo_px: int = 5
    """Within this distance no response of the other sign may be stronger, because a second derivative echoes
    beside a line with the other sign.  Twin conductors have the same sign."""
    contrast_px: float = 12.0
    """Standard deviation of the neighbourhood that a pixel's response is compared with."""
    full_response: float = 3.0
    """Average response, in units of the neighbourhood's, from which on a pixel's response is 1."""
    min_bend: float = 0.004
    """Least contrast of a neighbourhood, of the full brightness; noise and compression bend that much in a
    clear sky."""
    most_px: int = 1280
    """Longest side of the maps that are searched.  Larger photos are looked at pixel by pixel, and of each
    block of pixels the strongest response is kept."""

    @property
    def margin_px(self) -> int:
        """Around a part of an image, the pixels that its responses depend on."""
        return math.ceil(4 * (max(self.scales_px) + self.contrast_px))

    def __post_init__(self) -> None:
        lengths = (*self.scales_px, self.along_px, self.contrast_px)
        bends = (self.max_bend, self.full_response, self.min_bend)
        check(
            bool(self.scales_px) and min(*lengths, *bends) > 0,
            "detect.evidence needs a scale, and positive lengths and bends",
            self,
        )
        angles = (self.sag_deg, self.askew_deg, self.lens_deg, self.most_deg)
        check(
            min(angles) >= 0 and self.most_deg < 90 and self.apart_deg > 0,
            "detect.evidence needs angles of 0 or more, a most_deg below 90, and apart_deg above 0",
            self,
        )
        check(self.most_px >= 32, "detect.evidence needs most_px of 32 or more", self)
        check(0 <= self.beside_px <= self.echo_px, "detect.evidence needs 0 <= beside_px <= echo_px", self)


@dataclass(frozen=True)
class ChainConfig:
    """Long thin lines of each image (`chains.py`), and where those of two views meet (`meets.py`).

    Lengths are in units of half a window's length.
    """

    least_px: float = 25.0
    """Shortest chain."""
    most: int = 60
    """Chains of an image, at most: the longest."""
    rms_px: float = 1.0
    """A chain is one curve if its pixels lie within this distance of it."""
    partners: int = 8
    """Views whose chains each view's meet, at most."""
    good_angle: float = 0.15
    """Sine of the angle, as seen along the window, at which two views see a place that they show together."""
    places: tuple[int, int, int] = (24, 16, 12)
    """Places along a window, across and upwards that views may have in common: a long lens shows few metres
    at a time."""
    often: int = 4
    """So many partners of a view are to show a place."""
    least_angle: float = 0.07
    """Sine of the angle between a line of sight and the surface that it meets, at least."""
    spare: float = 0.1
    """A chain may be longer than it is seen, to either side, by this fraction;"""
    spare_alike: float = 0.5
    """and where it is known how wires hang, or where they begin, by this one: clutter cuts chains short."""
    least_length: float = 0.07
    """Shortest stretch along the window in which two chains meet."""
    max_askew: float = 0.1
    """Largest slope of a curve across the window's direction,"""
    max_slope: float = 0.3
    """upwards,"""
    max_sag: float = 0.06
    """and its largest sag, as a fraction of the window's length."""
    bend_prior: float = 1e-4
    """A place known to a hundredth of what the bend may be, to the second power: how strongly the bend of a
    short piece is drawn to 0."""

    def __post_init__(self) -> None:
        counts = (self.most, self.partners, self.often, *self.places)
        lengths = (self.least_px, self.rms_px, self.least_length, self.bend_prior)
        check(
            min(*lengths, *counts, self.max_askew, self.max_slope, self.max_sag) > 0
            and min(self.spare, self.spare_alike) >= 0,
            "detect.chains needs positive lengths, counts and limits, and spare and spare_alike of 0 or more",
            self,
        )
        check(
            0 < self.least_angle < 1 and 0 < self.good_angle < 1,
            "detect.chains needs least_angle and good_angle between 0 and 1",
            self,
        )

    def finer(self, times: float, spare: float) -> "ChainConfig":
        """The same with another `spare`, for a window whose planes are so many times closer together."""
        along, across, up = (round(count * times) for count in self.places)
        return replace(self, places=(along, across, up), least_length=self.least_length / times, spare=spare)


@dataclass(frozen=True)
class SegmentConfig:
    """Straight pieces of the thin lines of each image (`segments.py`)."""

    min_response: float = 0.5
    """Response from which on a pixel counts: texture responds less."""
    turn_rad: float = math.radians(15.0)
    """Neighbouring pixels are of one line where their tangents differ by no more."""
    least_px: float = 25.0
    """Shortest segment."""
    rms_px: float = 1.0
    """Pixels lie within this distance of a segment's curve."""
    most: int = 120
    """Segments of an image, at most: the longest."""

    def __post_init__(self) -> None:
        check(
            min(self.turn_rad, self.least_px, self.rms_px, self.most) > 0 and self.turn_rad < math.pi / 2
            and 0 < self.min_response <= 1,
            "detect.segments needs positive lengths, most of 1 or more, turn_rad between 0 and pi / 2, and a "
            "min_response above 0 and at most 1",
            self,
        )


@dataclass(frozen=True)
class DirectionConfig:
    """The vote for directions (`directions.py`)."""

    step_rad: float = math.radians(1.0)
    """Width of a bin."""
    max_slope_rad: float = math.radians(30.0)
    """Steepest lines that are looked for."""
    smooth_rad: float = math.radians(1.5)
    """Standard deviation of the azimuths over which votes are averaged."""
    sag_rad: float = math.radians(5.0)
    """A wire's slope differs by so much from its chord's, up and down."""
    partners: int = 64
    """Views that each chooses to be compared with, at most."""
    least_angle: float = 0.1
    """Sine of the angle between two planes from which on a pair votes,"""
    full_angle: float = 0.5
    """and from which on it votes in full."""
    least_overlap: float = 0.2
    """Least overlap of the stretches that a pair shows, over their union."""
    azimuth_deg: float | None = None
    """Azimuth of the line, clockwise from the world's +y (north); None: found in the images.  Where it is
    known no other is searched."""
    most: int = 6
    """Directions that are searched, at most."""
    apart_rad: float = math.radians(3.0)
    """A direction is searched only if no other was within this angle: what that showed votes no longer."""
    peak_rad: float = math.radians(2.0)
    """A direction is the middle of the votes within this angle of the strongest azimuth."""
    min_excess: float = 1.0
    """Votes of a direction over those of the median azimuth, as a multiple of these and of `few_px`, that it
    needs for a look,"""
    min_share: float = 0.1
    """and as a fraction of what the first direction had; one with less is faint,"""
    min_faint: float = 1.5
    """and needs so many, since looks take time."""
    least_excess: float = 0.5
    """Until a wire is found, so many are enough for a look."""
    clear: float = 20.0
    """With so many a direction is searched without a look."""
    least_in_air: float = 150.0
    """Nats that a line needs with which thin lines alone show that a direction is one of wires; of a faint
    one as many as any first line."""
    aside_rad: float = math.radians(2.0)
    """Where such lines run farther than this beside it, clutter has drawn the votes aside."""
    around_rad: float = math.radians(12.0)
    """Of several windows those are searched whose own views have `min_excess` too, and votes within
    `peak_rad`"""
    least_near: float = 0.5
    """that are at least this part of the most within `around_rad`: others show the wires of another
    direction.  Windows of `long` with wires have all of them, those with none at most 0.34."""
    few_px: float = 100.0
    """Votes that a few pairs of different lines collect by chance."""
    elongated: float = 1.5
    """Cameras flew along a direction if their ways from image to image have so many times as much along it
    as across, in the root of the mean square."""

    def __post_init__(self) -> None:
        angles = (
            self.step_rad, self.smooth_rad, self.sag_rad, self.apart_rad, self.peak_rad, self.aside_rad,
        )  # fmt: skip
        check(
            min(angles) > 0 and self.step_rad < 0.2 and self.step_rad <= self.max_slope_rad < math.pi / 2,
            "detect.directions needs angles above 0, a step_rad below 0.2 and a max_slope_rad below pi / 2",
            self,
        )
        check(
            self.peak_rad <= self.around_rad and 0 <= self.least_near <= 1,
            "detect.directions needs peak_rad <= around_rad and a least_near from 0 to 1",
            self,
        )
        check(
            self.azimuth_deg is None or math.isfinite(self.azimuth_deg),
            "detect.directions needs an azimuth_deg in degrees",
            self,
        )
        check(
            0 < self.least_angle <= self.full_angle <= 1 and 0 < self.least_overlap < 1,
            "detect.directions needs 0 < least_angle <= full_angle <= 1 and a least_overlap between 0 and 1",
            self,
        )
        check(
            min(self.most, self.partners) >= 1
            and min(self.min_excess, self.few_px, self.min_share) > 0
            and min(self.min_faint, self.least_excess, self.clear, self.least_in_air) > 0
            and self.elongated >= 1,
            "detect.directions needs most, partners and elongated of 1 or more, and min_excess, few_px, "
            "min_share, min_faint, least_excess, clear and least_in_air above 0",
            self,
        )


@dataclass(frozen=True)
class SurroundingsConfig:
    """The comparison of what views see beside a line (`surroundings.py`)."""

    strips_px: tuple[float, ...] = (
        -12.0, -10.5, -9.0, -7.5, -6.0, -4.5, -3.0, 3.0, 4.5, 6.0, 7.5, 9.0, 10.5, 12.0,
    )  # fmt: skip
    """Distances from the line, in pixels of the views that see it best."""
    step_px: float = 1.5
    """From one place on the line to the next,"""
    places: int = 24
    """of which so many are compared at a time,"""
    most_segments: int = 20
    """at most so often."""
    coarsest: float = 2.0
    """Views are compared whose pixels are at most so many times as wide."""
    least_contrast: float = 2.0
    """Root mean square of the differences in grey, of 255, without which there is nothing to compare."""
    least_angle_rad: float = math.radians(5.0)
    """Between the directions from which two views look: at less, what lies behind a line hardly moves;"""
    greatest_angle_rad: float = math.radians(40.0)
    """at more, a surface may look different."""
    least_pairs: int = 40
    """Comparisons without which nothing is said,"""
    least_share: float = 0.25
    """or if fewer of a line's segments have any: the tower at a wire's end says nothing of the wire."""

    def __post_init__(self) -> None:
        check(
            min(self.step_px, self.places, self.most_segments, self.coarsest, self.least_pairs) > 0
            and bool(self.strips_px)
            and self.least_contrast >= 0,
            "detect.surroundings needs strips_px, and step_px, places, most_segments, coarsest and "
            "least_pairs above 0",
            self,
        )
        check(0 <= self.least_share <= 1, "detect.surroundings.least_share must be from 0 to 1", self)
        check(
            0 <= self.least_angle_rad < self.greatest_angle_rad < math.pi,
            "detect.surroundings needs angles of 0 or more and below pi, the least below the greatest",
            self,
        )
