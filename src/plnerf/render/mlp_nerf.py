"""Systems whose field is one deep MLP: NeRF 2020, Mip-NeRF and Mip-NeRF 360 differ in how they sample rays.

Letters: r rays, S final intervals; s in [0, 1] warped distances; lengths in the scene frame.
"""

import torch
from jaxtyping import Float
from torch import Generator, Tensor

from plnerf.field.config import VanillaConfig
from plnerf.field.vanilla import VanillaField, density_normals
from plnerf.ops.backends import Backend
from plnerf.ops.rendered import Rendered
from plnerf.rays.rays import Rays
from plnerf.render.config import SamplerConfig
from plnerf.render.proposals import Histogram, s_to_t
from plnerf.render.ray_ops import render_rays
from plnerf.render.system import NormalSamples, RadianceSystem, RenderedRays
from plnerf.render.volume import composite


class MLPNeRF(RadianceSystem):
    """A deep field, sampled between the edges that `edges` returns."""

    def __init__(
        self,
        config: VanillaConfig,
        sampler: SamplerConfig,
        images: int,
        backend: Backend,
        generator: Generator,
    ) -> None:
        super().__init__(sampler, config.appearance, images, backend)
        self.field = VanillaField(config, generator)

    @property
    def predicts_normals(self) -> bool:
        """True if the field predicts normals."""
        return self.field.config.normals

    def edges(
        self,
        rays: Rays,
        appearance: Float[Tensor, "r A"],
        anneal: float | Tensor,
        generator: Generator | None,
    ) -> tuple[Float[Tensor, "r E"], tuple[Histogram, ...], Float[Tensor, "r 3"] | None]:
        """Edges s of the final intervals, the proposal histograms, and a coarse pass's colour, if any."""
        raise NotImplementedError

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
        s, history, coarse_colour = self.edges(rays, appearance, anneal, generator)
        seen, feature, t = self.evaluate(self.field, rays, s, appearance)
        samples = None
        if q := normal_rays:
            with torch.set_grad_enabled(torch.is_grad_enabled() and normals_shape_density):
                from_density = density_normals(self.field, rays[:q], t[:q])
            shaped = feature[:q] if normals_shape_density else feature[:q].detach()
            predicted = self.field.predicted_normals(shaped)
            samples = NormalSamples(seen.w[:q], from_density, predicted, rays.directions[:q])
        return RenderedRays.of(
            seen,
            s,
            history,
            normals=composite(seen.w, self.field.predicted_normals(feature)) if normals else None,
            normal_samples=samples,
            coarse_colour=coarse_colour,
        )

    def evaluate(
        self, field: VanillaField, rays: Rays, s: Float[Tensor, "r E"], appearance: Float[Tensor, "r A"]
    ) -> tuple[Rendered, Float[Tensor, "r E-1 G"], Float[Tensor, "r E"]]:
        """Rendered rays of a field with the edges s, its feature vectors, and the edges' distances."""
        t = s_to_t(s, self.sampler)
        density, feature = field.density(field.encode(rays, t))
        return render_rays(density, t, field.colour(feature, rays.directions, appearance)), feature, t
