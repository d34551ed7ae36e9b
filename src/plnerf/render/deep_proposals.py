"""Mip-NeRF 360 (Barron et al. 2022): a small network proposes where along the ray the large one looks.

Letters: r rays, S final intervals; lengths in the scene frame.
"""

import dataclasses
from dataclasses import dataclass
from typing import Literal

from jaxtyping import Float
from torch import Generator, Tensor

from plnerf.errors import ConfigError
from plnerf.field.vanilla import DeepDensity, VanillaConfig
from plnerf.ops.dispatch import Backend
from plnerf.rays.rays import Rays
from plnerf.render.deep import DeepNeRF
from plnerf.render.proposals import Histogram, SamplerConfig, sample_along_rays


@dataclass(frozen=True)
class DeepProposalsConfig:
    """Everything that decides the shape of the system and of its checkpoint."""

    kind: Literal["deep-proposals"] = "deep-proposals"
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


class DeepProposalsNeRF(DeepNeRF):
    """Mip-NeRF 360, its networks at the sizes that the configuration gives."""

    def __init__(
        self, config: DeepProposalsConfig, images: int, backend: Backend, generator: Generator
    ) -> None:
        super().__init__(config.field, config.sampler, images, backend, generator)
        self.config = config
        self.proposal = DeepDensity(config.proposal, generator)

    def edges(
        self,
        rays: Rays,
        appearance: Float[Tensor, "r A"],
        anneal: float | Tensor,
        generator: Generator | None,
    ) -> tuple[Float[Tensor, "r E"], tuple[Histogram, ...], Float[Tensor, "r 3"] | None]:
        """Where the proposal puts them, round by round."""
        densities = [self._proposed] * len(self.sampler.proposals)
        s, history = sample_along_rays(rays, densities, self.sampler, anneal, generator)
        return s, history, None

    def _proposed(self, rays: Rays, t: Float[Tensor, "r E"]) -> Float[Tensor, "r E-1"]:
        """Density of the proposal; the interlevel loss, which alone trains it, shall not move cameras."""
        still = dataclasses.replace(rays, origins=rays.origins.detach(), directions=rays.directions.detach())
        return self.proposal.density(self.proposal.encode(still, t.detach()))[0]
