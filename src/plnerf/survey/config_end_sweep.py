"""Settings of the search for structures in single photos.  Without NumPy: the command line shows them at
once."""

from dataclasses import dataclass

from plnerf.errors import ConfigError

HALF_TURN_DEG = 10.0
"""Standard deviation of half the angle by which a line turns at a structure without suspension strings: its
arms halve it.  Of the 13 such structures of random spans of even seeds to 40 it is 10."""


@dataclass(frozen=True)
class EndSweepConfig:
    """When photos show that a structure stands in an upright plane across the line."""

    photos: int = 16
    """At most so many are compared, the nearest."""
    least_px_per_m: float = 10.0
    """Photos taken from farther away show an arm two pixels wide or less."""
    most_off_deg: float = 65.0
    """Angle between a photo's ray and the line: from aside, one sees along the planes."""
    aside_m: float = 0.6
    """A patch reaches so far to both sides of a wire."""
    height_m: tuple[float, float] = (-1.0, 1.6)
    """And between these heights above it: what holds a wire stands below it or hangs above it."""
    clear_m: float = 0.4
    """Windows around samples nearer to a wire show what is fixed to it: spacers and dampers."""
    sample_m: float = 0.05
    """Between the samples of a patch."""
    step_m: float = 0.1
    """Between planes."""
    window_m: float = 0.4
    """Side of the windows that are compared."""
    noise: float = 3.0
    """Standard deviation of grey values, of 255, that shows nothing."""
    parallax: tuple[float, float] = (0.08, 0.8)
    """By how many metres the pictures of two photos part on a plane that is moved by one: where they part
    less they agree on all planes, where they part more they look from too different sides."""
    min_pairs: int = 6
    """Pairs of photos that must be compared at a sample: of fewer, some agree by chance."""
    least_seen: float = 0.4
    """Share of a patch that they must show on a plane."""
    usual: float = 0.3
    """Correlation that chance and smooth backgrounds reach, at least; the median along the line is taken for
    it where that is more."""
    above_usual: float = 0.2
    """A correlation that exceeds it by less counts for nothing."""
    least_score: float = 0.001
    """Least score of a plane in which a wire is held: the mean over the patch of what exceeds that."""
    distinct: float = 2.0
    """It must be so many times the greatest elsewhere."""
    beside_m: float = 0.65
    """Elsewhere is so far along the line: strings and their fittings are seen beside an arm."""
    string_share: float = 0.8
    """Greatest length of a tension string as a share of the least distance between phases: such a string's
    end may be what is seen, and the structure as far beyond it."""
    longest_string_m: float = 5.0
    """The same of any line."""
    half_turn_deg: float = HALF_TURN_DEG
    """Standard deviation of the angle by which arms are turned out of the plane across the line, at a line's
    last structure: what is seen on such a plane is on one of them."""
    own_m: float = 0.5
    """So far from a structure's middle along the line may pins and arms hold a wire."""
    body_m: float = 0.35
    """So near to a body's axis samples show the body rather than what holds a wire."""
    agree_m: float = 0.25
    """So near to each other along the line must wires be held."""
    apart_m: float = 0.7
    """Wires nearer to each other than this see the same thing and count as one."""

    def __post_init__(self) -> None:
        positive = (self.sample_m, self.step_m, self.window_m, self.aside_m, self.least_score, self.agree_m)
        if min(positive) <= 0 or self.photos < 2 or self.min_pairs < 1:
            raise ConfigError(
                "A sweep needs lengths and least_score above 0, 2 photos and 1 pair at least, but got "
                f"{self}."
            )
        if not 0 <= self.half_turn_deg < 90:
            raise ConfigError(
                f"A sweep needs a half_turn_deg from 0 to below 90, but got {self.half_turn_deg}."
            )
        if not self.height_m[0] < self.height_m[1] or not 0 < self.parallax[0] < self.parallax[1]:
            raise ConfigError(
                "A sweep's height_m and parallax are two numbers each, the first of them less, but got "
                f"{self.height_m} and {self.parallax}."
            )
