"""Settings of stereo: how images are paired, matched, and checked against one another."""

from dataclasses import dataclass, field
from itertools import pairwise

from plnerf.errors import ConfigError


@dataclass(frozen=True)
class StereoPairConfig:
    """Which images make stereo pairs.  b: baseline, d: typical distance of what a view shows."""

    max_turn_deg: float = 20.0
    """Angle between the two directions of view beyond which surfaces look too different to be matched."""
    min_baseline: float = 0.05
    """b / d below which a depth is too uncertain."""
    max_baseline: float = 0.25
    """b / d beyond which the images differ too much, and near things have no match."""
    least_paired: float = 0.5
    """Where fewer than this share of the views have two partners within `max_baseline`, as on mapping flights
    with 60 % of overlap,"""
    wide_baseline: float = 0.4
    """this b / d is allowed: less is matched than of nearer images, but not nothing."""
    best_baseline: float = 0.12
    """The b / d that is preferred."""
    partners: int = 3
    """Partners of a view at one typical distance, at most."""
    max_zoom: float = 1.5
    """Ratio of the focal lengths in pixels beyond which two images are not compared."""

    def __post_init__(self) -> None:
        if not 0 < self.min_baseline <= self.best_baseline <= self.max_baseline:
            raise ConfigError(
                "Stereo needs 0 < min_baseline <= best_baseline <= max_baseline, but got "
                f"{self.min_baseline}, {self.best_baseline} and {self.max_baseline}."
            )
        if self.wide_baseline < self.max_baseline or not 0 <= self.least_paired <= 1:
            raise ConfigError(
                "Stereo needs wide_baseline >= max_baseline and least_paired from 0 to 1, but got "
                f"{self.wide_baseline}, {self.max_baseline} and {self.least_paired}."
            )
        if self.partners < 2 or self.max_zoom < 1:
            raise ConfigError(
                "Stereo needs 2 or more partners, since a depth needs two pairs that agree, and max_zoom >= "
                f"1, but got {self.partners} and {self.max_zoom}."
            )


@dataclass(frozen=True)
class MatchConfig:
    """How a pair is matched, and which matches are kept."""

    nearest: float = 1 / 3
    """Least depth that is searched, as a share of the distance that is given as near: it sets the range of
    disparities, which costs time and memory."""
    max_parallax: float = 0.5
    """Baseline over depth beyond which nothing is searched, since the images show other sides of a thing.  On
    the bundled span and two random scenes 0.75 found no more of what is near, for a tenth to a fifth more
    work."""
    block_px: int = 5
    """Side of the square blocks that are compared; odd."""
    small_step_penalty: float = 8.0
    """Cost of a change of disparity by one between neighbours, per pixel of a block (OpenCV's P1)."""
    large_step_penalty: float = 32.0
    """Cost of a larger change (OpenCV's P2)."""
    max_left_right_px: int = 1
    """Difference of the disparities from left to right and back beyond which a match is dropped."""
    prefilter_cap: int = 31
    """Gradients are cut off at this value before they are compared, so that shadows' edges do not rule."""
    unique_percent: int = 10
    """Margin by which the best match must beat the second best."""
    speckle_px: int = 60
    """Connected regions of even disparity with fewer pixels are dropped."""
    speckle_step_px: int = 1
    """Change of disparity between neighbours up to which they belong to one region."""
    sigma_px: float = 0.4
    """Standard deviation of a disparity."""
    agree_px: float = 1.0
    """Two pairs agree if their depths differ by no more than what this disparity means in the less exact
    pair."""
    min_contrast: float = 2.5
    """Standard deviation of the grey values (0 to 255) in a block below which, as in the sky, matches are
    chance."""
    max_relative_sigma: float = 0.1
    """Standard deviation of a depth, as a share of it, beyond which it is dropped."""
    max_jump_px: float = 2.0
    """Neighbours whose disparities differ by more belong to different things."""
    min_sine: float = 0.3
    """Sine of the angle between baseline and ray below which a pixel is too near to the epipole."""

    def __post_init__(self) -> None:
        if self.block_px < 1 or self.block_px % 2 == 0:
            raise ConfigError(f"Stereo needs an odd block_px, but got {self.block_px}.")
        if min(self.nearest, self.max_parallax, self.sigma_px, self.min_sine) <= 0:
            raise ConfigError(
                "Stereo needs nearest, max_parallax, sigma_px and min_sine greater than 0, but got "
                f"{self.nearest}, {self.max_parallax}, {self.sigma_px} and {self.min_sine}."
            )


@dataclass(frozen=True)
class ConsistencyConfig:
    """Which points the depth maps of other images support."""

    neighbours: int = 24
    """Nearest points that are asked."""
    min_support: int = 4
    """Images that those must come from, the point's own included: fewer make the same mistake together."""
    rounds: int = 4
    """Rounds of the filter at most: points that it drops support no others."""
    expected_points: float = 10.0
    """The radius of support holds so many points of another image of the same thing, were all of its pixels
    matched."""

    def __post_init__(self) -> None:
        if not 1 <= self.min_support <= self.neighbours:
            raise ConfigError(
                "The consistency filter needs 1 <= min_support <= neighbours, but got "
                f"{self.min_support} and {self.neighbours}."
            )


@dataclass(frozen=True)
class WitnessConfig:
    """Which images see a thing where a point is, and which see past it."""

    window_cells: int = 2
    """Cells of the kept depth map, two pixels wide each, on every side of the point that are asked: together
    about as wide as two of the blocks that are matched."""
    sigmas: float = 3.0
    """An image sees a thing at the point where the depths differ by no more than so many standard
    deviations, and what the window is wide."""
    alike: int = 24
    """Nearest points, within `sigmas` of a point's standard deviation, that are judged together with it."""
    min_known: float = 0.25
    """Share of the window that must have depths; with fewer the image is silent there."""
    min_share: float = 0.1
    """Share of the window's depths that must lie at the point for it to be seen; to be seen past, as many at
    most may lie elsewhere than behind it."""
    least_deg: float = 8.0
    """Images whose directions differ by less make the same mistakes and count as one."""

    def __post_init__(self) -> None:
        if self.window_cells < 0 or not self.sigmas > 0 or self.alike < 1:
            raise ConfigError(
                "Witnesses need window_cells >= 0, sigmas > 0 and alike >= 1, but got "
                f"{self.window_cells}, {self.sigmas} and {self.alike}."
            )
        if not (0 < self.min_known <= 1 and 0 < self.min_share < 0.5):
            raise ConfigError(
                "Witnesses need 0 < min_known <= 1 and 0 < min_share < 0.5, but got "
                f"{self.min_known} and {self.min_share}."
            )


@dataclass(frozen=True)
class BackdropConfig:
    """When a photo shows something before a background whose distance is known."""

    radius_m: float = 0.5
    """Half the width of the windows that are compared; they are half as high."""
    samples: int = 11
    """Places across a window at which pixels are read; half as many along the axis."""
    others: int = 6
    """Photos that predict what one shows, at most: those taken nearest to it,"""
    least_others: int = 2
    """and at least at a pixel."""
    sigmas: float = 3.0
    """Distances that differ by no more than so many standard deviations are alike,"""
    same_share: float = 0.05
    """and by so much of them: depths are interpolated."""
    least_step: float = 10.0
    """Grey levels (0 to 255), in one colour, beyond the median of what the others show within a pixel that
    make a difference."""
    least_known: float = 0.5
    """Share of a window's pixels that must be known."""
    least_excess: float = 0.03
    """Something is there where the share of the pixels that differ exceeds that of every window beside it by
    this."""

    def __post_init__(self) -> None:
        if min(self.radius_m, self.least_step) <= 0 or self.samples < 2:
            raise ConfigError(
                "Backdrops need radius_m and least_step greater than 0 and samples of 2 or more, but got "
                f"{self.radius_m}, {self.least_step} and {self.samples}."
            )
        if not 1 <= self.least_others <= self.others or not 0 < self.least_known <= 1:
            raise ConfigError(
                "Backdrops need 1 <= least_others <= others and 0 < least_known <= 1, but got "
                f"{self.least_others}, {self.others} and {self.least_known}."
            )


@dataclass(frozen=True)
class CoarseConfig:
    """How typical distances are measured where no field gives them: by matching reduced images first."""

    longest_px: int = 256
    """Longer side of the reduced images."""
    distance_step: float = 2.0
    """Ratio of the distances at which partners are tried: pairs serve distances within a ratio of
    max_baseline / min_baseline, so that nothing falls between two of them."""
    most_distances: int = 10
    """Distances that are tried, at most, from the farthest that counts."""
    quantiles: tuple[float, ...] = (0.5, 0.05)
    """As `StereoConfig.quantiles`, of the depths that are matched.  Images show little of what is near, which
    clearances are measured to: with 0.15 in place of 0.05, a seventh fewer square metres of ground were found
    on the bundled span, and with both no more."""

    def __post_init__(self) -> None:
        check_quantiles(self.quantiles)
        if self.longest_px < 32 or self.distance_step <= 1 or self.most_distances < 1:
            raise ConfigError(
                "The coarse round of stereo needs longest_px >= 32, distance_step > 1 and most_distances >= "
                f"1, but got {self.longest_px}, {self.distance_step} and {self.most_distances}."
            )


@dataclass(frozen=True)
class StereoConfig:
    """How the surfaces of a survey are measured from its images."""

    points: int = 400_000
    """Pixels that are drawn, evenly from the training images; those with a depth become points."""
    most_sharing: int = 100
    """Of more images than these each gives as many pixels as if there were so many: the images of a long line
    each show other ground."""
    longest_px: int = 1024
    """Larger images are reduced by a whole number: what matching costs grows with the third power of the
    size."""
    farthest: float = 1.6
    """Points further from the middle of the scene's box than so many of its half sides are background."""
    min_seen: int = 20
    """Points of the field that a view must show for its typical distances to be known."""
    min_views_share: float = 0.5
    """Share of the views whose typical distances a field must show; with fewer, matched images show them."""
    quantiles: tuple[float, ...] = (0.5, 0.15)
    """Quantiles of the distances that a field shows in a view; each has partners of its own, the last rules
    how near depths are searched."""
    min_share: float = 0.02
    """Share of the drawn pixels that must have a depth: with fewer there is no stereo to speak of."""
    edge_px: float = 2.5
    """Standard deviation of where a thing ends in an image: half a block.  Leaves outside of a crown are
    smaller."""
    wire_px: int = 5
    """Pixels this near to a projected wire are left out, a block's side: one wire is matched with another."""
    wire_samples: int = 2000
    """Places along a wire that are projected for this."""
    pairs: StereoPairConfig = field(default_factory=StereoPairConfig)
    match: MatchConfig = field(default_factory=MatchConfig)
    consistency: ConsistencyConfig = field(default_factory=ConsistencyConfig)
    coarse: CoarseConfig = field(default_factory=CoarseConfig)
    witnesses: WitnessConfig = field(default_factory=WitnessConfig)

    def __post_init__(self) -> None:
        if min(self.points, self.most_sharing) < 1 or self.longest_px < 32 or self.wire_samples < 2:
            raise ConfigError(
                "Stereo needs points and most_sharing of 1 or more, longest_px >= 32 and wire_samples >= 2, "
                f"but got {self.points}, {self.most_sharing}, {self.longest_px} and {self.wire_samples}."
            )
        check_quantiles(self.quantiles)
        if not 0 < self.min_share < 1 or self.wire_px < 0:
            raise ConfigError(
                "Stereo needs 0 < min_share < 1 and wire_px >= 0, but got "
                f"{self.min_share} and {self.wire_px}."
            )


def check_quantiles(quantiles: tuple[float, ...]) -> None:
    """Raises ConfigError unless they fall, between 1 and 0."""
    falls = all(after < before for before, after in pairwise(quantiles))
    if not quantiles or not quantiles[0] < 1 or quantiles[-1] <= 0 or not falls:
        raise ConfigError(
            f"Stereo needs quantiles of distances between 1 and 0 that fall, but got {quantiles}."
        )
