"""How a scene is filmed, as plain values: passes along the line, orbits of a structure, grids from above.

Lengths in metres (_m), angles in degrees (_deg), image sizes in pixels (_px).  "Along" and "across" as in
`line_config.py`.
"""

from dataclasses import dataclass

from plnerf.errors import ConfigError
from plnerf.synth.line_config import require_positive


@dataclass(frozen=True)
class Pass:
    """One flight along the first line, relative to the wire it follows (of a bundle, its first conductor)."""

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
class Orbit:
    """A flight around a structure of the first line, looking at it; without a sweep it climbs beside it."""

    name: str
    about: int
    """index of the structure"""
    radius_m: float
    """horizontal distance from its axis"""
    low_m: float
    """camera above the structure's foot at the beginning"""
    high_m: float
    """and at the end"""
    from_deg: float = 0.0
    """where it begins, from +x towards +y as seen from the structure"""
    sweep_deg: float = 360.0
    """how far it goes around"""
    aim_m: float = 10.0
    """height above the foot of what it looks at"""
    wobble_m: float = 0.3
    """slow swing of the camera along each axis"""

    def __post_init__(self) -> None:
        require_positive(**{f"orbit {self.name}: radius_m": self.radius_m})


@dataclass(frozen=True)
class Grid:
    """Parallel rows over the first line, flown to and fro, looking down."""

    name: str
    along_m: tuple[float, float]
    """stretch of the line above which the rows run"""
    across_m: float
    """of the outermost rows from the line, to either side"""
    rows: int
    height_m: float
    """above the ground at the origin"""
    tilt_deg: float = 0.0
    """from straight down, forwards"""
    wobble_m: float = 0.4
    """slow swing of the camera along each axis"""
    crosses: bool = False
    """whether the rows run across the line"""

    def __post_init__(self) -> None:
        require_positive(**{
            f"grid {self.name}: {key}": value
            for key, value in (("rows", self.rows), ("height_m", self.height_m), ("across_m", self.across_m))
        })
        if not self.along_m[0] < self.along_m[1]:
            raise ConfigError(
                f"synth: grid {self.name}: along_m must run from low to high, got {self.along_m}."
            )


Leg = Pass | Orbit | Grid
"""A part of a flight."""


@dataclass(frozen=True)
class CaptureConfig:
    """How it is filmed."""

    width_px: int = 480
    height_px: int = 320
    focal_px: float = 440.0
    passes: tuple[Leg, ...] = (
        Pass("right", "phase A", -2.5, 0.8, -1.2, 0.74, 40.0, -2.0),
        Pass("left", "phase B", 2.4, 1.0, 1.2, -0.74, 38.0, 4.0),
        Pass("above", "phase A", -0.5, 2.6, -1.2, 0.74, 27.0, -3.0),
    )
    views_per_pass: int = 24
    filmed_m: tuple[float, float] | None = None
    """the stretch along the first line that the passes cover; None: the main span"""
    pose_noise_m: float = 0.0
    """deviation of each axis of the written camera centres from the true ones"""
    pose_noise_deg: float = 0.0
    """deviation of the written directions about each axis"""
    seen_px: float = 0.0
    """images in which a wire is thinner do not count as showing it: of lines that go on into the distance"""

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
