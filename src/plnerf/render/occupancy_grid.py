"""Instant-NGP (Mueller et al. 2022): even samples along the ray, of which the field is evaluated only where a
grid of densities is occupied.

Letters: r rays, S intervals, n of them evaluated; lengths in the scene frame.
"""


import torch
from jaxtyping import Bool, Float
from torch import Generator, Tensor

from plnerf.field.occupancy import OccupancyGrid
from plnerf.field.radiance import RadianceField
from plnerf.ops.backends import Backend
from plnerf.rays.rays import Rays
from plnerf.rays.stepfun import even_edges
from plnerf.render.config import OccupancyGridConfig
from plnerf.render.normals import UNSTRETCHED, density_normals
from plnerf.render.proposals import s_to_t
from plnerf.render.ray_ops import TORCH, ray_ops
from plnerf.render.system import NormalSamples, RadianceSystem, RenderedRays
from plnerf.render.volume import composite


class OccupancyGridNeRF(RadianceSystem):
    """A hash field, and the grid that says where it is empty."""

    fixed_shapes = False

    def __init__(
        self, config: OccupancyGridConfig, images: int, backend: Backend, generator: Generator
    ) -> None:
        super().__init__(config.sampler, config.field.appearance, images, backend)
        self.config = config
        self.field = RadianceField(config.field, backend, generator)
        self.occupancy = OccupancyGrid(config.occupancy)
        self.skips = True
        """Whether empty intervals are skipped; turned off, all are evaluated."""

    @property
    def predicts_normals(self) -> bool:
        """True if the field predicts normals."""
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
        t = s_to_t(s, self.sampler, ops)
        unit, ipe = ops.frustum_features(rays, t, UNSTRETCHED, True, self.field.octaves)
        full = self.evaluated(unit, t)
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
            shaped = feature if normals_shape_density else feature.detach()
            own_normals = self.field.predicted_normals(shaped)[:, 0]
            predicted = unit.new_zeros(*full.shape, 3).index_put((ray, sample), own_normals)
            composited = composite(seen.w, predicted) if normals else None
            if q := normal_rays:
                with torch.set_grad_enabled(torch.is_grad_enabled() and normals_shape_density):
                    from_density = density_normals(self.field, rays[:q], t[:q])
                samples = NormalSamples(seen.w[:q], from_density, predicted[:q], rays.directions[:q])
        return RenderedRays.of(seen, s, normals=composited, normal_samples=samples)

    def evaluated(self, unit: Float[Tensor, "r S 3"], t: Float[Tensor, "r S+1"]) -> Bool[Tensor, "r S"]:
        """Which intervals the field is evaluated in."""
        with torch.no_grad():
            return self.occupancy.full(unit, t) if self.skips else torch.ones_like(unit[..., 0]).bool()
