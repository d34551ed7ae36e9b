"""Settings of a corridor: its blocks, their fields and their surveys."""

from dataclasses import dataclass, field

from plnerf.errors import ConfigError
from plnerf.survey.config import SurveyConfig

CLOUD_BLOCK_M, CLOUD_OVERLAP_M = 1000.0, 500.0
"""Default length and overlap of the blocks of a cloud."""


@dataclass(frozen=True)
class CutConfig:
    """Sizes of the blocks that a corridor is cut into, in metres."""

    block_m: float = 150.0
    """Length of a block in which wires are looked for, along the cameras' way or the cloud."""
    overlap_m: float = 50.0
    """How far a block reaches beyond its ends; the block of a span of images by half of its length at most.
    Of clouds: at least the longest span, so that each is whole in a block."""
    link_m: float = 60.0
    """Cameras that are no farther apart are of one flight: so are passes on both sides of a line."""
    cell_m: float = 10.0
    """Side of the squares that a cloud's plan is divided into."""
    see_m: float = 100.0
    """Cameras farther from a span than this show too little of it."""

    def __post_init__(self) -> None:
        for name in ("block_m", "cell_m", "see_m", "link_m"):
            if not getattr(self, name) > 0:
                raise ConfigError(f"{name} must be above 0, but is {getattr(self, name)}.")
        if not self.overlap_m >= 0:
            raise ConfigError(f"overlap_m must not be below 0, but is {self.overlap_m}.")


@dataclass(frozen=True)
class FieldOfBlock:
    """The radiance field of a block."""

    seconds: float = 0.0
    """Budget of training; 0: no field is trained, and blocks are surveyed from images and poses alone."""
    preset: str = "pl-nerf-wire"
    downscale: int = 1
    seed: int = 0


@dataclass(frozen=True)
class CorridorConfig:
    """Everything that decides a corridor's result."""

    cut: CutConfig = field(default_factory=CutConfig)
    train: FieldOfBlock = field(default_factory=FieldOfBlock)
    survey: SurveyConfig = field(default_factory=SurveyConfig)

    @classmethod
    def of_clouds(cls) -> "CorridorConfig":
        """Blocks of clouds are longer, and overlap by more than a span."""
        return cls(CutConfig(CLOUD_BLOCK_M, CLOUD_OVERLAP_M))
