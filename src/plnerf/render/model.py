"""PL-NeRF on one page: rays in, colours, depths and normals out.  Seed 4.2.2, figures 18 and 20.

    cone ─▶ frustums ─▶ L-inf contraction ─▶ hash encoding ─▶ density ───┬─▶ weights ─▶ colour, depth, normals
      ▲                                  └─▶ IPE, direction, appearance ─┴─▶ colour
      └── two proposal fields choose where along the ray the frustums lie

Letters: r rays, S final intervals; lengths in the scene frame.
"""

import dataclasses
from dataclasses import dataclass
from functools import partial

import torch
from jaxtyping import Float
from torch import Generator, Tensor, nn

from plnerf.errors import ConfigError
from plnerf.field.density import DensityConfig, DensityField
from plnerf.field.poses import PoseCorrections
from plnerf.field.radiance import RadianceConfig, RadianceField
from plnerf.ops.dispatch import Backend
from plnerf.rays.contraction import clamp_frustums, contract, contract_frustums, pull_back
from plnerf.rays.frustums import Frustums, ray_frustums
from plnerf.rays.rays import Rays
from plnerf.render.proposals import Histogram, SamplerConfig, sample_along_rays, to_distance
from plnerf.render.volume import (
    accumulation,
    composite,
    expected_depth,
    median_depth,
    weights_from_density,
)


@dataclass(frozen=True)
class ModelConfig:
    """Everything that decides the shape of the model and of its checkpoint."""

    field: RadianceConfig
    proposals: tuple[DensityConfig, ...]
    sampler: SamplerConfig = dataclasses.field(default_factory=SamplerConfig)
    contraction: bool = True
    """L-infinity contraction of unbounded space; without it, all beyond [-2, 2]^3 is clamped to its faces."""
    stretch: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Stretch of x, y and z before the contraction; a span wants more cells across (y, z) than along (x)."""

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
class NormalSamples:
    """Normals of the samples of some rays, for the losses of Ref-NeRF."""

    weights: Float[Tensor, "q S"]
    from_density: Float[Tensor, "q S 3"]
    predicted: Float[Tensor, "q S 3"]
    directions: Float[Tensor, "q 3"]


@dataclass(frozen=True)
class RenderedRays:
    """What rays see."""

    colour: Float[Tensor, "r 3"]
    accumulation: Float[Tensor, " r"]
    depth: Float[Tensor, " r"]
    depth_median: Float[Tensor, " r"]
    normals: Float[Tensor, "r 3"] | None
    histograms: tuple[Histogram, ...]
    """Of the proposal rounds and, last, of the final one."""
    normal_samples: NormalSamples | None


class PLNeRF(nn.Module):
    """The radiance field, its two proposal fields, and what is learnt of each image: appearance and pose."""

    def __init__(self, config: ModelConfig, images: int, backend: Backend, generator: Generator) -> None:
        super().__init__()
        self.config = config
        self.field = RadianceField(config.field, backend, generator)
        self.proposals = nn.ModuleList(
            DensityField(proposal, backend, generator) for proposal in config.proposals
        )
        # Zero at the start: the mean vector, used for views without an image of their own, stays within what
        # is seen.
        self.appearance = nn.Parameter(torch.zeros(images, config.field.appearance))
        self.poses = PoseCorrections(images)

    def forward(
        self,
        rays: Rays,
        *,
        appearance: Float[Tensor, "r A"],
        anneal: float = 1.0,
        generator: Generator | None = None,
        normal_rays: int = 0,
        normals: bool = False,
    ) -> RenderedRays:
        """Render rays.  With a generator the samples are jittered; `normals` renders the predicted normals;
        the first `normal_rays` rays return their samples' normals for the losses."""
        densities = [partial(self._proposal_density, field) for field in self.proposals]
        s, history = sample_along_rays(rays, densities, self.config.sampler, anneal, generator)
        t = to_distance(s, self.config.sampler)
        frustums = ray_frustums(rays, t)
        mean, variance = self._contracted(frustums)
        density, feature = self.field.density(mean)
        w = weights_from_density(density, t)
        colours = self.field.colour(feature, mean, variance, rays.directions, appearance)
        total = accumulation(w)
        # What lies behind the last interval takes its colour (nerfacto's "last sample"): the sky needs no
        # density.
        colour = composite(w, colours) + (1 - total)[:, None] * colours[:, -1]
        normal_samples = None
        if q := normal_rays:
            normal_samples = self._normal_samples(frustums.mean[:q], feature[:q], w[:q], rays.directions[:q])
        return RenderedRays(
            colour=colour,
            accumulation=total,
            depth=expected_depth(w.detach(), t),
            depth_median=median_depth(w.detach(), t),
            normals=composite(w, self.field.predicted_normals(feature)) if normals else None,
            histograms=(*history, Histogram(s, w)),
            normal_samples=normal_samples,
        )

    def mean_appearance(self, rays: int, images: Tensor) -> Float[Tensor, "{rays} A"]:
        """The mean vector of some images, for views that have none of their own."""
        return self.appearance[images].mean(0).expand(rays, -1)

    def _contracted(self, frustums: Frustums) -> tuple[Float[Tensor, "*n 3"], Float[Tensor, "*n 3"]]:
        bound = contract_frustums if self.config.contraction else clamp_frustums
        return bound(frustums, self.config.stretch)

    def _proposal_density(
        self, field: nn.Module, rays: Rays, t: Float[Tensor, "r E"]
    ) -> Float[Tensor, "r E-1"]:
        density: Tensor = field(self._bounded(ray_frustums(rays, t).mean))
        return density

    def _bounded(self, position: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n 3"]:
        """Positions in the cube, where only they are needed and not the frustums' extent."""
        stretched = position * position.new_tensor(self.config.stretch)
        return contract(stretched) if self.config.contraction else stretched.clamp(-2, 2)

    def _normal_samples(self, mean: Tensor, feature: Tensor, w: Tensor, directions: Tensor) -> NormalSamples:
        """Normals as the density says, n = -grad sigma / |grad sigma|, and as predicted.  Ref-NeRF eq. 3.

        The log density has a gradient of the same direction, without the range of exp.
        """
        mean = mean.detach()
        stretch = mean.new_tensor(self.config.stretch)
        stretched = mean * stretch
        gradient = self.field.log_density_gradient(self._bounded(mean))
        if self.config.contraction:
            gradient = pull_back(gradient, stretched)
        else:
            gradient = gradient * (stretched.abs() <= 2)  # clamped: nothing changes beyond
        gradient = gradient * stretch
        length = (gradient.square().sum(-1, keepdim=True) + 1e-6).sqrt()
        return NormalSamples(w, -gradient / length, self.field.predicted_normals(feature), directions)
