"""Instant-NGP (Mueller et al. 2022): even samples along the ray, of which only those are looked at where a
grid of densities has something.

Letters: r rays, S intervals, n of them looked at; lengths in the scene frame.
"""

import dataclasses
from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Bool, Float
from torch import Generator, Tensor

from plnerf.errors import ConfigError
from plnerf.field.occupancy import OccupancyConfig, OccupancyGrid
from plnerf.field.radiance import RadianceConfig, RadianceField
from plnerf.ops.dispatch import Backend
from plnerf.rays.rays import Rays
from plnerf.rays.stepfun import even_edges
from plnerf.render.normals import UNSTRETCHED, density_normals
from plnerf.render.proposals import SamplerConfig, to_distance
from plnerf.render.ray_ops import TORCH, ray_ops
from plnerf.render.system import NormalSamples, RadianceSystem, RenderedRays
from plnerf.render.volume import composite


@dataclass(frozen=True)
class OccupiedConfig:
    """Everything that decides the shape of the system and of its checkpoint."""

    field: RadianceConfig
    sampler: SamplerConfig = dataclasses.field(default_factory=lambda: SamplerConfig(proposals=(), final=128))
    occupancy: OccupancyConfig = dataclasses.field(default_factory=OccupancyConfig)
    kind: Literal["occupied"] = "occupied"

    def __post_init__(self) -> None:
        if self.sampler.proposals:
            raise ConfigError(
                "Samples by an occupancy grid have no proposal rounds, but got "
                f"sampler.proposals={list(self.sampler.proposals)}. Give none: []."
            )


class OccupiedNeRF(RadianceSystem):
    """A hash field, and the grid that says where it is empty."""

    fixed_shapes = False

    def __init__(self, config: OccupiedConfig, images: int, backend: Backend, generator: Generator) -> None:
        super().__init__(config.sampler, config.field.appearance, images, backend)
        self.config = config
        self.field = RadianceField(config.field, backend, generator)
        self.occupancy = OccupancyGrid(config.occupancy)
        self.skips = True
        """Whether empty intervals are passed over; turned off, all are looked at."""

    @property
    def predicts_normals(self) -> bool:
        """As its field was told."""
        return self.config.field.normals

    def update(self, step: int, generator: Generator) -> None:
        """Brings the grid up to date where its turn has come."""
        if step % self.config.occupancy.every == 0:
            self.occupancy.update(lambda unit: self.field.density(unit[:, None])[0][:, 0], generator)

    def forward(
        self,
        rays: Rays,
        *,
        appearance: Float[Tensor, "r A"],
        anneal: float | Tensor = 1.0,
        generator: Generator | None = None,
        normals: bool = False,
        normal_rays: int = 0,
        normals_shape_density: bool = True,
    ) -> RenderedRays:
        ops = TORCH if rays.origins.requires_grad else ray_ops(self.backend)
        s = even_edges(len(rays), self.sampler.final, generator, rays.origins)
        t = to_distance(s, self.sampler, ops)
        unit, ipe = ops.frustum_features(rays, t, UNSTRETCHED, True, self.field.octaves)
        full = self.looked_at(unit, t)
        ray, sample = full.nonzero().unbind(1)
        own_density, feature = self.field.density(unit[ray, sample][:, None])
        own_colours = self.field.colour(
            feature, ipe[ray, sample][:, None], rays.directions[ray], appearance[ray]
        )
        density = unit.new_zeros(full.shape).index_put((ray, sample), own_density[:, 0])
        colours = unit.new_zeros(*full.shape, 3).index_put((ray, sample), own_colours[:, 0])
        seen = ops.render_rays(density, t, colours)
        composited = samples = None
        if normals or normal_rays:
            own_normals = self.field.predicted_normals(feature)[:, 0]
            predicted = unit.new_zeros(*full.shape, 3).index_put((ray, sample), own_normals)
            composited = composite(seen.w, predicted) if normals else None
            if q := normal_rays:
                with torch.set_grad_enabled(torch.is_grad_enabled() and normals_shape_density):
                    from_density = density_normals(self.field, rays[:q], t[:q])
                samples = NormalSamples(seen.w[:q], from_density, predicted[:q], rays.directions[:q])
        return RenderedRays.of(seen, s, normals=composited, normal_samples=samples)

    def looked_at(self, unit: Float[Tensor, "r S 3"], t: Float[Tensor, "r S+1"]) -> Bool[Tensor, "r S"]:
        """Which intervals the field is asked about."""
        with torch.no_grad():
            return self.occupancy.full(unit, t) if self.skips else torch.ones_like(unit[..., 0]).bool()
