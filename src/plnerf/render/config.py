"""What decides the shapes of the systems.  Without PyTorch, so that the command line can show it at once."""

import dataclasses
from dataclasses import dataclass
from typing import Literal

from plnerf.errors import ConfigError
from plnerf.field.config import DensityConfig, OccupancyConfig, RadianceConfig, TubeConfig, VanillaConfig


@dataclass(frozen=True)
class SamplerConfig:
    """How rays are sampled; lengths in units of the scene frame."""

    proposals: tuple[int, ...] = (64, 32)
    """Intervals of each proposal round."""
    final: int = 24
    """Intervals that are given colour."""
    near: float = 0.03
    """Where rays begin."""
    far: float = 1000.0
    """Where rays end."""
    knee: float = 0.25
    """Where even samples in t give way to even samples in 1/t."""
    guided: float = 0.4
    """Share of the final intervals' edges that is laid where a ray passes near a known curve."""
    padding: float = 0.03
    """Weight given to every interval before resampling: with 32 intervals half of the samples stay
    where no density was found yet, which is how thin things are found (nerfacto: 0.01 of many more
    intervals)."""
    dilation: float = 0.0
    """How far, in s, a round samples beside what the round before found: its density is raised to the largest
    within this distance (Mip-NeRF 360, whose constant part is 0.0025).  0: not at all."""

    def __post_init__(self) -> None:
        if (
            not 0 < self.near < self.far
            or self.knee <= 0
            or self.padding <= 0
            or self.dilation < 0
            or not 0 <= self.guided < 1
            or self.final < 1
            or any(n < 1 for n in self.proposals)
        ):
            raise ConfigError(
                "A sampler needs 0 < near < far, knee > 0, padding > 0, dilation >= 0, 0 <= guided < 1 and "
                f"at least one interval a round, but got near={self.near}, far={self.far}, knee={self.knee}, "
                f"proposals={self.proposals}, final={self.final}, padding={self.padding}, "
                f"dilation={self.dilation}, guided={self.guided}."
            )


@dataclass(frozen=True)
class ModelConfig:
    """Everything that decides the shape of the model and of its checkpoint."""

    field: RadianceConfig
    proposals: tuple[DensityConfig, ...]
    sampler: SamplerConfig = dataclasses.field(default_factory=SamplerConfig)
    tubes: TubeConfig | None = None
    """The field around found curves; None leaves them to the field of everything else."""
    contraction: bool = True
    """L-infinity contraction of unbounded space; without it, all beyond [-2, 2]^3 is clamped to its faces."""
    stretch: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Stretch of x, y and z before the contraction; a span wants more cells across (y, z) than along (x)."""
    kind: Literal["pl-nerf"] = dataclasses.field(default="pl-nerf", init=False)

    def __post_init__(self) -> None:
        if len(self.proposals) != len(self.sampler.proposals):
            raise ConfigError(
                "Every proposal round needs a proposal field, but sampler.proposals has "
                f"{len(self.sampler.proposals)} rounds and proposals {len(self.proposals)} fields. "
                "Give both the same number of entries."
            )
        if min(self.stretch) <= 0:
            raise ConfigError(f"The stretch of every axis must be above 0, but got {self.stretch}.")


@dataclass(frozen=True)
class CoarseFineConfig:
    """Everything that decides the shape of the system and of its checkpoint."""

    kind: Literal["coarse-fine"] = dataclasses.field(default="coarse-fine", init=False)
    field: VanillaConfig = dataclasses.field(default_factory=VanillaConfig)
    sampler: SamplerConfig = dataclasses.field(
        default_factory=lambda: SamplerConfig(proposals=(64,), final=128, padding=1e-5)
    )
    """One proposal round: the coarse pass; none: there is only one pass, of `final` intervals."""
    networks: int = 2
    """1: one network for both passes (Mip-NeRF); 2: one for each (NeRF 2020)."""

    def __post_init__(self) -> None:
        if self.networks not in {1, 2} or len(self.sampler.proposals) > 1:
            raise ConfigError(
                "Coarse and fine passes need 1 or 2 networks and at most one proposal round, but got "
                f"networks={self.networks}, sampler.proposals={list(self.sampler.proposals)}."
            )
        if min(self.sampler.proposals, default=3) < 3:
            raise ConfigError(
                f"A coarse pass needs 3 intervals or more, but has {self.sampler.proposals[0]}."
            )


@dataclass(frozen=True)
class DeepProposalsConfig:
    """Everything that decides the shape of the system and of its checkpoint."""

    kind: Literal["deep-proposals"] = dataclasses.field(default="deep-proposals", init=False)
    field: VanillaConfig = dataclasses.field(
        default_factory=lambda: VanillaConfig(encoding="ipe", octaves=12, contraction=True)
    )
    proposal: VanillaConfig = dataclasses.field(
        default_factory=lambda: VanillaConfig(
            encoding="ipe", octaves=12, contraction=True, depth=4, width=64, skip=0
        )
    )
    """One network for all rounds; of its settings only those before the density count."""
    sampler: SamplerConfig = dataclasses.field(default_factory=SamplerConfig)

    def __post_init__(self) -> None:
        if not self.sampler.proposals:
            raise ConfigError("A proposal network needs a round: sampler.proposals has none.")


@dataclass(frozen=True)
class OccupancyGridConfig:
    """Everything that decides the shape of the system and of its checkpoint."""

    field: RadianceConfig
    sampler: SamplerConfig = dataclasses.field(default_factory=lambda: SamplerConfig(proposals=(), final=128))
    occupancy: OccupancyConfig = dataclasses.field(default_factory=OccupancyConfig)
    kind: Literal["occupied"] = dataclasses.field(default="occupied", init=False)

    def __post_init__(self) -> None:
        if self.sampler.proposals:
            raise ConfigError(
                "Samples by an occupancy grid have no proposal rounds, but got "
                f"sampler.proposals={list(self.sampler.proposals)}. Give none: []."
            )


SystemConfig = ModelConfig | CoarseFineConfig | DeepProposalsConfig | OccupancyGridConfig
"""Distinguished in a run's config.json by their `kind`."""
