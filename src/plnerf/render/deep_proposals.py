"""Mip-NeRF 360 (Barron et al. 2022): a small network proposes where along the ray the large one is evaluated.

Letters: r rays, S final intervals; lengths in the scene frame.
"""

import dataclasses

from jaxtyping import Float
from torch import Generator, Tensor

from plnerf.field.vanilla import DeepDensity
from plnerf.ops.backends import Backend
from plnerf.rays.rays import Rays
from plnerf.render.config import DeepProposalsConfig
from plnerf.render.mlp_nerf import MLPNeRF
from plnerf.render.proposals import Histogram, sample_along_rays


class DeepProposalsNeRF(MLPNeRF):
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
