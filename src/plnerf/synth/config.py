"""What a synthetic scene is made of, as plain values.  The defaults are the span that comes with the package.

Lengths in metres (_m), angles in degrees (_deg), image sizes in pixels (_px).  "Along" the line runs from the
first support to the second, 0 at mid-span; "across" it is positive to the left.
"""

from dataclasses import dataclass, field, replace
from typing import Literal

from plnerf.errors import ConfigError


def require_positive(**values: float | int) -> None:
    """Refuse the first value that is not greater than 0."""
    for name, value in values.items():
        if not value > 0:
            raise ConfigError(f"synth: {name} must be greater than 0, got {value}. Give a positive value.")


@dataclass(frozen=True)
class WireConfig:
    """One phase, shield wire or neutral; the same on both supports."""

    name: str
    kind: Literal["phase", "shield", "neutral"]
    across_m: float
    height_m: float
    """of the clamp above the support's foot"""
    sag_m: float
    diameter_m: float
    bundle: int = 1
    """sub-conductors side by side, each a conductor of its own"""
    bundle_gap_m: float = 0.4
    insulator: Literal["string", "vee", "pin", "spool", "none"] = "string"
    """one string or two in a V hang from the cross-arm, a pin stands on it, a spool sits at a pole's side"""

    def __post_init__(self) -> None:
        require_positive(**{
            f"{self.name}: sag_m": self.sag_m,
            f"{self.name}: diameter_m": self.diameter_m,
            f"{self.name}: height_m": self.height_m,
            f"{self.name}: bundle": self.bundle,
            f"{self.name}: bundle_gap_m": self.bundle_gap_m,
        })


@dataclass(frozen=True)
class SupportConfig:
    """The two towers or poles."""

    kind: Literal["lattice", "pole"] = "lattice"
    height_m: float = 12.7
    """top above the foot"""
    foot_m: float = 2.3
    """width of a lattice tower at its foot, diameter of a pole there"""
    waist_m: float = 0.72
    """width of a lattice tower at its lowest arm, diameter of a pole at its top"""
    shoulder_m: float = 0.6
    """width of a lattice tower above its highest arm"""
    string_length_m: float = 0.95
    """insulator string, from cross-arm down to the clamp"""

    def __post_init__(self) -> None:
        require_positive(
            height_m=self.height_m,
            foot_m=self.foot_m,
            waist_m=self.waist_m,
            shoulder_m=self.shoulder_m,
            string_length_m=self.string_length_m,
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
    """What is built: two supports, the wires between them, ground, plants."""

    seed: int = 7
    """decides plants, flight wobble, textures and noise"""
    span_length_m: float = 40.0
    """horizontal distance between the supports"""
    line_azimuth_deg: float = 4.0
    """direction of the line from +x towards +y"""
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

    def __post_init__(self) -> None:
        require_positive(span_length_m=self.span_length_m, spacer_step_m=self.spacer_step_m)
        if self.houses < 0:
            raise ConfigError(f"synth: the number of houses must be 0 or more, got {self.houses}.")
        if not self.wires:
            raise ConfigError("synth: wires must name at least one wire, got none.")
        names = [wire.name for wire in self.wires]
        if len(set(names)) < len(names):
            raise ConfigError(f"synth: every wire needs a name of its own, got {', '.join(names)}.")
        for wire in self.wires:
            top = wire.height_m + (
                self.support.string_length_m if wire.insulator in ("string", "vee") else 0.0
            )
            if top > self.support.height_m:
                raise ConfigError(
                    f"synth: {wire.name} needs its support at {top:.2f} m above the foot (clamp height + "
                    f"insulator) but the support's height_m is {self.support.height_m}. "
                    "Raise the support or lower the wire."
                )

    def wire(self, name: str) -> WireConfig:
        """The wire of this name."""
        for wire in self.wires:
            if wire.name == name:
                return wire
        raise ConfigError(f"synth: there is no wire {name!r}; name one of {[w.name for w in self.wires]}.")


@dataclass(frozen=True)
class Pass:
    """One flight along the line, relative to the wire it follows (of a bundle, its first sub-conductor)."""

    name: str
    follows: str
    """name of the wire"""
    across_m: float
    """camera's offset from that wire across the line"""
    above_m: float
    start: float
    """where it begins: -1 is the beginning of the filmed stretch, 1 its end, more lies beyond"""
    end: float
    toward_deg: float
    """camera turned from the flight direction to the left"""
    pitch_deg: float
    """upwards positive"""
    weave_m: float = 0.30
    """slow swing across the line, to either side"""
    heave_m: float = 0.35
    """slow swing up and down"""
    zigzag_m: float = 0.0
    """regular swing across the line, to either side, on top of the slow one"""
    zigzag_period_m: float = 12.0
    """length along the line of one regular swing"""

    def __post_init__(self) -> None:
        require_positive(**{f"pass {self.name}: zigzag_period_m": self.zigzag_period_m})
        if self.start == self.end:
            raise ConfigError(
                f"synth: pass {self.name} starts and ends at {self.start}. Let it go somewhere."
            )


@dataclass(frozen=True)
class CaptureConfig:
    """How it is filmed."""

    width_px: int = 480
    height_px: int = 320
    focal_px: float = 440.0
    passes: tuple[Pass, ...] = (
        Pass("right", "phase A", -2.5, 0.8, -1.2, 0.74, 40.0, -2.0),
        Pass("left", "phase B", 2.4, 1.0, 1.2, -0.74, 38.0, 4.0),
        Pass("above", "phase A", -0.5, 2.6, -1.2, 0.74, 27.0, -3.0),
    )
    views_per_pass: int = 24
    filmed_m: tuple[float, float] | None = None
    """the stretch along the line that the passes cover; None: from support to support"""
    pose_noise_m: float = 0.0
    """deviation of each axis of the written camera centres from the true ones"""
    pose_noise_deg: float = 0.0
    """deviation of the written directions about each axis"""

    def __post_init__(self) -> None:
        require_positive(width_px=self.width_px, height_px=self.height_px, focal_px=self.focal_px)
        if not self.passes:
            raise ConfigError("synth: passes must name at least one pass, got none: there would be no image.")
        if self.views_per_pass < 4:
            raise ConfigError(f"synth: views_per_pass must be at least 4, got {self.views_per_pass}.")
        if self.filmed_m is not None and not self.filmed_m[0] < self.filmed_m[1]:
            raise ConfigError(f"synth: filmed_m must run from low to high, got {self.filmed_m}.")
        for name, value in (("pose_noise_m", self.pose_noise_m), ("pose_noise_deg", self.pose_noise_deg)):
            if not value >= 0:
                raise ConfigError(f"synth: {name} must be 0 or more, got {value}.")


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

    def __post_init__(self) -> None:
        require_positive(samples_per_pixel=self.samples_per_pixel, exposure=self.exposure)
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
        for leg in self.capture.passes:
            self.span.wire(leg.follows)

    @property
    def seed(self) -> int:
        """Decides everything that is random."""
        return self.span.seed

    def with_seed(self, seed: int) -> "SceneConfig":
        """The same scene with other plants, wobble, textures and noise."""
        return replace(self, span=replace(self.span, seed=seed))
