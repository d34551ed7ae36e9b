"""What a synthetic scene is made of, as plain values.  The defaults are the span that comes with the package.

Lengths in metres (_m), angles in degrees (_deg).  "Along" a line is 0 in the middle of its main span;
"across" it is positive to the left.
"""

from dataclasses import dataclass, field, replace
from typing import Literal

from plnerf.errors import ConfigError
from plnerf.synth.flight_config import CaptureConfig, Orbit, Pass
from plnerf.synth.line_config import (
    LineConfig,
    StructureConfig,
    SupportConfig,
    WireConfig,
    require_positive,
    wire_named,
)


@dataclass(frozen=True)
class TerrainConfig:
    """The ground; 0 m high at the origin."""

    waves: float = 1.0
    """factor on the gentle waves of about half a metre near the line"""
    hills: float = 1.0
    """factor on the hills that stand from 150 m on"""
    rise_m: float = 0.0
    """how much higher the slope lies at the second support than at the first, waves aside"""
    track: Literal["dirt", "road", "none"] = "dirt"
    """what runs beside the line"""
    centre_m: float = 0.0
    """where along the line the ground is finest and the plants are strewn"""
    shift_m: tuple[float, float] = (0.0, 0.0)
    """x and y by which the pattern of waves and hills is moved"""
    fine_m: tuple[float, float] = (44.0, 24.0)
    """half the finest ground's lengths in x and y, whole metres"""
    texel_m: float = 0.025
    """of the finest ground's texture"""
    lush: float = 0.5
    """share of dry grass among lush on average"""
    bare: float = -0.75
    """how much soil shows: the mean of a noise of deviation 0.75 or more, of which what is above 0 shows"""
    tint: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """factors on the ground's linear reflectance"""


@dataclass(frozen=True)
class PlantsConfig:
    """How many plants stand where.  No plant comes closer to a conductor than `clearance_m`."""

    trees: int = 10
    """trees beside the line, one of them under it"""
    bushes: int = 16
    background: int = 170
    """trees from 30 m to 170 m away"""
    trees_across_m: tuple[float, float] = (10.0, 17.0)
    tree_height_m: tuple[float, float] = (5.5, 8.8)
    conifers: float = 0.0
    """share of spruces among the trees"""
    near: int = 0
    """trees under and beside the wires, each as high as a clearance drawn from `near_clearance_m` allows"""
    near_clearance_m: tuple[float, float] = (2.0, 4.0)
    near_across_m: tuple[float, float] = (0.0, 6.0)
    clearance_m: float = 1.5
    reach_m: float | None = None
    """how far along the line from the terrain's centre trees stand; None: half the main span, at most 60 m"""

    def __post_init__(self) -> None:
        counts = {
            "trees": self.trees,
            "bushes": self.bushes,
            "background": self.background,
            "near": self.near,
        }
        for name, value in counts.items():
            if value < 0:
                raise ConfigError(f"synth: the number of {name} must be 0 or more, got {value}.")
        require_positive(clearance_m=self.clearance_m)
        if not 0 <= self.conifers <= 1:
            raise ConfigError(f"synth: conifers is a share from 0 to 1, got {self.conifers}.")
        if self.near and self.near_clearance_m[0] < self.clearance_m:
            raise ConfigError(
                f"synth: near_clearance_m begins at {self.near_clearance_m[0]} m, below clearance_m = "
                f"{self.clearance_m} m. Lower clearance_m or draw larger clearances."
            )


@dataclass(frozen=True)
class SpanConfig:
    """What is built: the first line with its main span around the origin, other lines, ground, plants.

    By default the first line is that one span.
    """

    seed: int = 7
    """decides plants, flight wobble, textures and noise"""
    span_length_m: float = 40.0
    """horizontal distance between the main span's supports"""
    line_azimuth_deg: float = 4.0
    """direction of the main span from +x towards +y"""
    wires: tuple[WireConfig, ...] = (
        WireConfig("phase A", "phase", -1.9, 9.4, 1.4, 0.032),
        WireConfig("phase B", "phase", 1.9, 9.4, 1.4, 0.032),
        WireConfig("phase C", "phase", 1.5, 10.9, 1.4, 0.032),
        WireConfig("shield", "shield", 0.0, 12.58, 1.0, 0.020, insulator="none"),
    )
    support: SupportConfig = field(default_factory=SupportConfig)
    terrain: TerrainConfig = field(default_factory=TerrainConfig)
    plants: PlantsConfig = field(default_factory=PlantsConfig)
    houses: int = 0
    """houses beside the line, behind the track"""
    spacer_step_m: float = 15.0
    """between the spacers of a bundle, at most"""
    before_m: tuple[float, ...] = ()
    """lengths of the first line's spans before the main one, the nearest last"""
    after_m: tuple[float, ...] = ()
    """lengths of its spans after the main one, the nearest first"""
    structures: tuple[StructureConfig, ...] = ()
    """of the first line, one more than spans; empty: suspension structures in a straight line"""
    slack: tuple[tuple[float, ...], ...] = ()
    """of each of its spans, as in LineConfig"""
    others: tuple[LineConfig, ...] = ()
    """other lines, which need names"""

    def __post_init__(self) -> None:
        if self.houses < 0:
            raise ConfigError(f"synth: the number of houses must be 0 or more, got {self.houses}.")
        names = [line.name for line in self.others]
        if "" in names or len(set(names)) < len(names):
            raise ConfigError(f"synth: every other line needs a name of its own, got {names}.")
        _ = self.line  # is checked where it is made

    @property
    def line(self) -> LineConfig:
        """The first line."""
        return LineConfig(
            self.wires,
            self.support,
            self.line_azimuth_deg,
            (*self.before_m, self.span_length_m, *self.after_m),
            main=len(self.before_m),
            structures=self.structures,
            slack=self.slack,
            spacer_step_m=self.spacer_step_m,
        )

    @property
    def lines(self) -> tuple[LineConfig, ...]:
        """All lines."""
        return (self.line, *self.others)

    def wire(self, name: str) -> WireConfig:
        """The wire of this name of the first line."""
        return wire_named(self.wires, name)


@dataclass(frozen=True)
class ImageConfig:
    """How it looks."""

    samples_per_pixel: int = 36
    sun_azimuth_deg: float = 310.0
    """direction of the sun from +x towards +y"""
    sun_elevation_deg: float = 46.0
    exposure: float = 2.9
    """factor from the sky model's radiance to linear sRGB"""
    auto_exposure: bool = False
    """every image towards the same mean brightness, as a camera's automatic does"""
    exposure_drift: float = 0.0
    """slow drift of the exposure over the flight, in stops (deviation)"""
    white_balance_drift: float = 0.0
    """slow drift of red against blue over the flight, relative (deviation)"""
    motion_blur_px: float = 0.0
    """longest smear, of the nearest wire"""
    noise: float = 0.0
    """deviation of the sensor's noise at mid grey, as a part of white"""
    jpeg_quality: int = 95
    turbidity: float = 3.5
    """of the sky: 2 is clear, 8 hazy"""

    def __post_init__(self) -> None:
        require_positive(samples_per_pixel=self.samples_per_pixel, exposure=self.exposure)
        if not 1 <= self.turbidity <= 10:
            raise ConfigError(f"synth: turbidity must be in 1 to 10, got {self.turbidity}.")
        if not 5 <= self.sun_elevation_deg <= 85:
            raise ConfigError(f"synth: sun_elevation_deg must be in 5 to 85, got {self.sun_elevation_deg}.")
        if not 1 <= self.jpeg_quality <= 100:
            raise ConfigError(f"synth: jpeg_quality must be in 1 to 100, got {self.jpeg_quality}.")
        for name, value in (
            ("exposure_drift", self.exposure_drift),
            ("white_balance_drift", self.white_balance_drift),
            ("motion_blur_px", self.motion_blur_px),
            ("noise", self.noise),
        ):
            if not value >= 0:
                raise ConfigError(f"synth: {name} must be 0 or more, got {value}.")


@dataclass(frozen=True)
class SceneConfig:
    """One scene: what is built, how it is filmed, how it looks."""

    name: str = "span"
    span: SpanConfig = field(default_factory=SpanConfig)
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    image: ImageConfig = field(default_factory=ImageConfig)

    def __post_init__(self) -> None:
        towers = len(self.span.line.lengths_m) + 1
        for leg in self.capture.passes:
            if isinstance(leg, Pass):
                self.span.wire(leg.follows)
            elif isinstance(leg, Orbit) and not 0 <= leg.about < towers:
                raise ConfigError(
                    f"synth: orbit {leg.name} is about structure {leg.about}, but the first line has "
                    f"structures 0 to {towers - 1}. Name one of these."
                )

    @property
    def seed(self) -> int:
        """Decides everything that is random."""
        return self.span.seed

    def with_seed(self, seed: int) -> "SceneConfig":
        """The same scene with other plants, wobble, textures and noise."""
        return replace(self, span=replace(self.span, seed=seed))
