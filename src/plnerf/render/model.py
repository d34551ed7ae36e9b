"""PL-NeRF on one page: rays in, colours, depths and normals out.

The paper, here and elsewhere: Sensors 2023, 23(23), 9537.  Its 4.2.2, figures 18 and 20:

    cone ─▶ frustums ─▶ L-inf contraction ─▶ hash encoding ─▶ density ───┬─▶ weights ─▶ colour, depth, normals
      ▲                                  └─▶ IPE, direction, appearance ─┴─▶ colour
      └── two proposal fields choose where along the ray the frustums lie

Letters: r rays, S final intervals; lengths in the scene frame.
"""

from functools import partial

import torch
from jaxtyping import Float
from torch import Generator, Tensor, nn

from plnerf.field.density import DensityField
from plnerf.field.guides import Guides, Windows, windows
from plnerf.field.networks import density_and_feature
from plnerf.field.radiance import RadianceField
from plnerf.field.tubes import TubeField
from plnerf.ops.backends import Backend
from plnerf.rays.contraction import ball_sizes
from plnerf.rays.frustums import frustum_moments
from plnerf.rays.rays import Rays
from plnerf.render.config import ModelConfig
from plnerf.render.normals import density_normals
from plnerf.render.proposals import s_to_t, sample_along_rays
from plnerf.render.ray_ops import TORCH, RayOps, ray_ops
from plnerf.render.system import NormalSamples, RadianceSystem, RenderedRays
from plnerf.render.volume import composite


class PLNeRF(RadianceSystem):
    """The radiance field, its two proposal fields, and a field of their own around curves."""

    def __init__(
        self,
        config: ModelConfig,
        images: int,
        backend: Backend,
        generator: Generator,
        guides: Guides | None = None,
    ) -> None:
        super().__init__(config.sampler, config.field.appearance, images, backend)
        self.config, self.guides = config, guides
        self.fixed_shapes = guides is None  # which samples lie near curves changes from step to step
        self.field = RadianceField(config.field, backend, generator)
        self.proposals = nn.ModuleList(
            DensityField(proposal, backend, generator) for proposal in config.proposals
        )
        self.tubes: TubeField | None = None
        if guides is not None and config.tubes is not None:
            self.tubes = TubeField(config.tubes, config.field.feature, guides, backend, generator)

    @property
    def predicts_normals(self) -> bool:
        """True if the field predicts normals."""
        return self.config.field.normals

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
        # Poses are refined through the geometry, of which only the references have a gradient.
        ops = TORCH if rays.origins.requires_grad else ray_ops(self.backend)
        densities = [partial(self._proposal_density, ops, field) for field in self.proposals]
        near = self.windows(rays)
        s, history = sample_along_rays(rays, densities, self.sampler, anneal, generator, ops, near)
        t = s_to_t(s, self.sampler, ops)
        unit, ipe = self._features(ops, rays, t, self.field.octaves)
        size = self.frustum_sizes(rays, t, unit)
        raw = self.field.raw(unit, size)
        if self.tubes is not None and near is not None:
            raw = self.tubes.replace(raw, self.tubes.locate(rays, t, near))
        density, feature = density_and_feature(raw)
        colours = self.field.colour(feature, ipe, rays.directions, appearance)
        seen = ops.render_rays(density, t, colours)
        normal_samples = None
        if q := normal_rays:
            with torch.set_grad_enabled(torch.is_grad_enabled() and normals_shape_density):
                from_density = density_normals(
                    self.field, rays[:q], t[:q], None if size is None else size[:q],
                    stretch=self.config.stretch, contraction=self.config.contraction,
                )  # fmt: skip
            shaped = feature[:q] if normals_shape_density else feature[:q].detach()
            predicted = self.field.predicted_normals(shaped)
            normal_samples = NormalSamples(seen.w[:q], from_density, predicted, rays.directions[:q])
        return RenderedRays.of(
            seen,
            s,
            history,
            normals=composite(seen.w, self.field.predicted_normals(feature)) if normals else None,
            normal_samples=normal_samples,
        )

    def windows(self, rays: Rays) -> Windows | None:
        """Where rays pass near the curves that guide this model; None where there are none."""
        return None if self.guides is None else windows(rays, self.guides, self.sampler.near, self.backend)

    def _features(
        self, ops: RayOps, rays: Rays, t: Float[Tensor, "r E"], octaves: int
    ) -> tuple[Float[Tensor, "r E-1 3"], Float[Tensor, "r E-1 e"]]:
        """Where the frustums between the edges lie in the unit cube, and their IPE."""
        return ops.frustum_features(rays, t, self.config.stretch, self.config.contraction, octaves)

    def _proposal_density(
        self, ops: RayOps, field: nn.Module, rays: Rays, t: Float[Tensor, "r E"]
    ) -> Float[Tensor, "r E-1"]:
        density: Tensor = field(self._features(ops, rays, t, 0)[0])
        return density

    def frustum_sizes(
        self, rays: Rays, t: Float[Tensor, "r E"], unit: Float[Tensor, "r E-1 3"]
    ) -> Float[Tensor, "r E-1"] | None:
        """Sizes of the frustums in the unit cube, as constants; None where the field takes none."""
        if not self.config.field.damping:
            return None
        config = self.config
        with torch.no_grad():
            radius = rays.radius[:, None].expand(-1, t.shape[1] - 1)
            _, var_t, var_r = frustum_moments(t[:, :-1], t[:, 1:], radius)
            return ball_sizes(var_t, var_r, 4 * unit - 2, config.stretch, config.contraction) / 4
