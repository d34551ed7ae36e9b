"""What decides how wires are refitted to images."""

from dataclasses import dataclass, field

from plnerf.errors import ConfigError


@dataclass(frozen=True)
class ProfileConfig:
    """How grey values across a projected wire are read."""

    step_px: float = 0.5
    """Spacing of the samples across the wire."""
    window_px: float = 6.0
    """Half width of a profile, to either side of the wire, at least."""
    beside_px: float = 4.0
    """Background beside a wire that a profile holds, at least."""
    least_width_px: float = 0.05
    """A thinner bar is as good as this one."""
    uneven_grey: float = 30.0
    """How far a wire's edges may differ from its middle in brightness by more than the light explains that is
    the same for all views, standard deviation in grey levels: what it mirrors, the shadow's edge, strands.
    Chosen on random scenes 4, 10 and 14."""
    least_samples: int = 5
    """Places along the wire that an image must show for it to be used."""
    most_others: int = 3
    """Wires that may cross a profile and are fitted along with it."""
    apart: float = 2.5
    """Wires nearer to each other than so many widths of the kernel cannot be separated: nothing is measured
    there."""
    quantum: float = 0.5
    """Least variance of a grey value: of its rounding, and of the noise that every image has."""
    end_on: float = 0.15
    """Sine of the angle between wire and line of sight below which a view says nothing of a wire's place."""
    least_crossing: float = 0.2
    """Sine of the angle between a profile and another wire below which that wire runs along the profile."""


@dataclass(frozen=True)
class AdjustConfig:
    """The weights and priors of the least-squares step."""

    visible: float = 4.25
    """A measurement counts where the wire stands out by so many standard deviations."""
    robust: float = 2.5
    """Standard deviations beyond which a measurement loses its weight (Cauchy): another thing is seen."""
    shading_grey: float = 30.0
    """Prior standard deviation of the lighting: how much brighter a lit edge of a wire is than its middle."""
    own_shading: float = 0.3
    """The part of it that may differ between wires, as a fraction: wires of one scene stand in one light."""
    uneven_grey: float = 20.0
    """Prior standard deviation of what else makes one edge of a wire brighter than its middle, alike for all
    measurements of one stretch from one direction: what it mirrors, its own shadow."""
    directions: int = 12
    """Directions of view around a wire."""
    stretches: int = 4
    """Stretches along a wire; each has a bias for each direction."""
    swing_deg: float = 10.0
    """Prior standard deviation of the swing that wires have in common: in the 10 m/s up to which one flies,
    heavy conductors swing by 7 degrees and light ones by 16, and calm air is as common."""
    own_swing_deg: float = 6.0
    """Standard deviation of what a wire swings more or less than that: in real clouds shields swing 2 to 3
    times as far as phases.  With 4 in its place, intervals of simulated swings held less often (91 of 100
    instead of 94); without a common swing, errors in wind are a third larger."""
    max_swing_deg: float = 60.0
    """No wire swings further: what a step would turn beyond is a wire too taut to show its swing."""
    prior_places: int = 10
    """Places at which a wire is held to where it was detected."""
    twins_m: float = 0.05
    """Standard deviation of the distance between the twins of a bundle from its mean along their span."""

    def __post_init__(self) -> None:
        if min(self.directions, self.stretches, self.prior_places) < 1:
            raise ConfigError(
                "The refit needs directions, stretches and prior_places of 1 or more, but got "
                f"{self.directions}, {self.stretches} and {self.prior_places}."
            )
        if min(self.swing_deg, self.own_swing_deg, self.max_swing_deg, self.twins_m) <= 0:
            raise ConfigError(
                "The refit needs swing_deg, own_swing_deg, max_swing_deg and twins_m above 0, but got "
                f"{self.swing_deg}, {self.own_swing_deg}, {self.max_swing_deg} and {self.twins_m}."
            )

    @property
    def views(self) -> int:
        """Biases of a wire."""
        return self.directions * self.stretches


@dataclass(frozen=True)
class CrossedConfig:
    """When images of two wires may be paired crosswise."""

    near_m: float = 1.0
    """Wires farther apart than this are not confused."""
    distinct: float = 1.0
    """Photos look from two directions if the angle between these is so many times what either of them
    spans,"""
    least_deg: float = 5.0
    """which counts as so much at least."""
    least_photos: int = 3
    """Fewer say nothing of directions."""
    parallel_m: float = 0.1
    """To which two wires side by side hang alike in the middle, where lines of sight do not tell."""
    least_more: float = 1.06
    """So many times as much must be seen of the one pair than of the other for it to be the right one."""
    least_unlike: float = 2.0
    """Where about as much is seen of both: how far the middles of its two wires are from hanging alike must
    be so many times as much of the wrong pair,"""
    alike_m: float = 0.01
    """and counts as so much at least."""
    same_m: float = 0.05
    """Places that are nearer to each other are the same."""
    least_alike: int = 3
    """If so many pairs of a span and half of all lie at one vector from twin to twin, those at another are
    tried at this one,"""
    as_much: float = 0.8
    """and stay there if so many times as much is seen of them, or more."""

    def __post_init__(self) -> None:
        metres = self.near_m, self.parallel_m, self.alike_m, self.same_m
        if min(*metres, self.distinct, self.least_deg) <= 0 or min(self.least_more, self.least_unlike) < 1:
            raise ConfigError(
                "Crossed pairs need near_m, distinct, least_deg, parallel_m, alike_m and same_m above 0 and "
                f"least_more and least_unlike of 1 or more, but got {self}."
            )
        if self.least_alike < 2 or self.as_much <= 0:
            raise ConfigError(
                "Crossed pairs need least_alike of 2 or more and as_much above 0, but got "
                f"{self.least_alike} and {self.as_much}."
            )


@dataclass(frozen=True)
class RefineConfig:
    """How wires that were detected are refitted to the images."""

    profile: ProfileConfig = field(default_factory=ProfileConfig)
    adjust: AdjustConfig = field(default_factory=AdjustConfig)
    crossed: CrossedConfig = field(default_factory=CrossedConfig)
    twin_m: float = 0.6
    """Wires that are each other's nearest and no farther apart are twins of a bundle: spacers hold these at
    0.3 to 0.5 m from each other."""
    diameter_m: float = 0.03
    """Diameter assumed at first, learnt where wires are wider than their blur; conductors have 1 to 5 cm."""
    thin_px: float = 8.0
    """Wires that the assumed diameter makes less wide than this in most images begin with a thinner bar."""
    thin_share: float = 0.5
    """Its diameter as a share of the assumed one; it is learnt from there.  A bar that is wider than the wire
    can settle beside it, with the wire at one edge: where the sunlit half is as bright as the ground, that
    describes what is seen as well, and the diameter grows to suit.  A narrower bar stays on the wire and
    grows to its edges.  Inside of a wide wire it would see no edge, so those begin as assumed."""
    diameter_log_sd: float = 0.4
    """Prior standard deviation of the logarithm of the wires' diameter."""
    own_log_sd: float = 0.25
    """The same of one wire's against the others': phases are alike, shields thinner."""
    unlike_bar: float = 0.2
    """By what share of its width a wire may look wider or thinner than a bar, standard deviation of one
    measurement."""
    least_leverage: float = 0.005
    """Photos that say less than this of every place, as a share of what all say of it (`leverage.py`), are
    not measured: of `long` a third of those that show a span, which together say 2 % at most of a place."""
    samples: int = 240
    """Places along a wire at which its images are measured."""
    first_blur_px: float = 1.2
    """Width of the kernel in the first round, for wires a pixel or two off."""
    blur_px: float = 0.6
    """The same in the second: what blurs a wire in an image, standard deviation; learnt afterwards."""
    blur_sd_px2: float = 0.3
    """Prior standard deviation of the blur's variance."""
    least_rounds: int = 4
    """Rounds that are always done."""
    most_rounds: int = 16
    """Rounds at most."""
    settled_px: float = 0.02
    """Rounds end where no wire moves by more."""
    pose_sd_px: float = 0.1
    """Standard deviation of the images' pose residuals at first; learnt from the images afterwards."""
    least_pose_sd_px: float = 0.05
    """The least that is learnt."""
    systematic_px: float = 0.2
    """What first order in the light leaves of a wire's displacement in each view of each stretch, standard
    deviation.  Measured on rendered wires under a sun: 0.1 to 0.3 px."""
    common_px: float = 0.1
    """The part of it that all views of a wire have in common."""
    undescribed: float = 0.3
    """Share of an image's pose residual that a turn and a move of it do not describe."""
    least_visible: float = 0.03
    """Share of its measurements at which a wire must stand out; of noise, a hundredth does."""
    least_views: int = 3
    """Images that must show a wire; a place on it that fewer show adds nothing to how well it is known,"""
    least_often: float = 0.15
    """nor does a piece of it that stands out at a smaller share of its measurements: as often does what lies
    beside a wire that the curve has left."""
    pieces_around: int = 2
    """With so many pieces on either side: of a few measurements many may be of something else."""
    piece_m: float = 0.5
    """Pieces of a wire of which each counts as seen or not."""
    near_px: float = 1.0
    """A measurement this near to the wire supports it."""
    least_near: float = 0.5
    """Share of the visible measurements that must support it."""
    beside_every: int = 3
    """Every such place along a wire is compared with what is beside the wire."""
    least_beside: float = 1.4
    """A wire is refitted if it stands out so many times as often as what is beside it; else it stays as it
    was detected."""
    least_seen: float = 0.1
    """A wire that does not stand out so is left out where enough images show less than this share of it."""
    thick_m: float = 0.1
    """What stands out and is thicker is seldom a conductor, the thickest of which have 5 cm: of true wires
    of 15 random scenes of even seeds one comes out thicker than 4 cm.  Edges of patches on the ground do,"""
    least_beside_thick: float = 6.0
    """and so it must stand out so many times as often as what is beside it."""
    stray_m: float = 0.3
    """A curve that is nearer to another one of its span than spacers hold twins,"""
    stray_ratio: float = 3.0
    """and elsewhere so many times as far from it, is no wire."""
    stray_indistinct_m: float = 1.0
    """The same of one that does not stand out.  Of the wires of 60 random scenes no two that are nearer to
    each other than this part so much; the greatest ratio is below 2."""
    doubtful_diameters: float = 8.0
    """One that may be farther off than so many assumed diameters as it was detected is left out where it does
    not stand out, however much is seen of it."""
    no_news: float = 0.7
    """The views do not fix a wire whose standard deviation stays above this share of what it was."""
    most_moved: float = 2.0
    """A wire that moves by more than so many times its detection's reach went to something else."""
    same_diameters: float = 3.5
    """Wires of a span nowhere farther apart than so many diameters are one: half of the seven and more at
    which subconductors hang."""
    loose_poses_px: float = 0.5
    """Pose residual beyond which the survey warns, and its stereo points are less certain."""

    def __post_init__(self) -> None:
        if self.diameter_m <= 0 or self.samples < 10 or self.most_rounds < 1:
            raise ConfigError(
                "The refit needs diameter_m > 0, samples >= 10 and most_rounds >= 1, but got "
                f"{self.diameter_m}, {self.samples} and {self.most_rounds}."
            )
        if not 0 <= self.least_leverage < 1:
            raise ConfigError(
                f"The refit needs a least_leverage of 0 or more and below 1, but got {self.least_leverage}."
            )
        least = min(self.least_beside, self.doubtful_diameters, self.thick_m, self.least_beside_thick)
        if min(self.stray_m, self.stray_indistinct_m) < 0 or self.stray_ratio < 1:
            raise ConfigError(
                "The refit needs stray_m and stray_indistinct_m of 0 or more and stray_ratio of 1 or more, "
                f"but got {self.stray_m}, {self.stray_indistinct_m} and {self.stray_ratio}."
            )
        if self.beside_every < 1 or least < 0 or not 0 <= self.least_seen <= 1:
            raise ConfigError(
                "The refit needs beside_every of 1 or more, least_beside, thick_m, least_beside_thick and "
                "doubtful_diameters of 0 or more and least_seen from 0 to 1, but got "
                f"{self.beside_every}, {self.least_beside}, {self.thick_m}, {self.least_beside_thick}, "
                f"{self.doubtful_diameters} and {self.least_seen}."
            )
        if not 0 <= self.least_often <= 1 or self.pieces_around < 0:
            raise ConfigError(
                "The refit needs a least_often from 0 to 1 and pieces_around of 0 or more, but got "
                f"{self.least_often} and {self.pieces_around}."
            )
        if self.thin_px < 0 or not 0 < self.thin_share <= 1:
            raise ConfigError(
                "The refit needs thin_px of 0 or more and a thin_share above 0 and at most 1, but got "
                f"{self.thin_px} and {self.thin_share}."
            )
