"""Hierarchical sampling: the weights of a coarse pass decide where a fine pass samples.

    NeRF 2020 (paper 4.2.1): points, stratified; a network for each pass; the fine one has the points of both
    Mip-NeRF: intervals; one network for both passes; the fine one has intervals of its own, spread a little

Both passes render a colour, and both are trained on it.

Letters: r rays, N coarse intervals; s in [0, 1] warped distances; lengths in the scene frame.
"""

import dataclasses

import torch
from jaxtyping import Float
from torch import Generator, Tensor, nn

from plnerf.field.vanilla import VanillaField
from plnerf.ops.backends import Backend
from plnerf.rays.rays import Rays
from plnerf.rays.stepfun import even_edges, resample_edges, stratified_levels
from plnerf.render.config import CoarseFineConfig
from plnerf.render.mlp_nerf import MLPNeRF
from plnerf.render.proposals import Histogram


class CoarseFineNeRF(MLPNeRF):
    """NeRF 2020 and Mip-NeRF."""

    def __init__(self, config: CoarseFineConfig, images: int, backend: Backend, generator: Generator) -> None:
        super().__init__(config.field, config.sampler, images, backend, generator)
        self.config = config
        two = config.networks == 2 and config.sampler.proposals
        # Normals are those of the fine pass.
        plain = dataclasses.replace(config.field, normals=False)
        self.coarse = VanillaField(plain, generator) if two else None

    def edges(
        self,
        rays: Rays,
        appearance: Float[Tensor, "r A"],
        anneal: float | Tensor,
        generator: Generator | None,
    ) -> tuple[Float[Tensor, "r E"], tuple[Histogram, ...], Float[Tensor, "r 3"] | None]:
        """Those of the fine pass, after the coarse one."""
        if not self.sampler.proposals:
            return self._first_edges(rays, self.sampler.final, generator), (), None
        s = self._first_edges(rays, self.sampler.proposals[0], generator)
        seen, _, _ = self.evaluate(self.field if self.coarse is None else self.coarse, rays, s, appearance)
        fine = self._fine_edges(s, seen.w.detach(), anneal, generator)
        return fine, (Histogram(s, seen.w),), seen.colour

    def _first_edges(
        self, rays: Rays, count: int, generator: Generator | None
    ) -> Float[Tensor, "r {count}+1"]:
        """Stratified: a point in each of `count` equal bins and the far end, or the bins' moved edges."""
        if self.config.field.encoding == "ipe":
            return even_edges(len(rays), count, generator, rays.origins)
        return _to_the_end(stratified_levels(len(rays), count, generator, rays.origins))

    def _fine_edges(
        self,
        s: Float[Tensor, "r E"],
        w: Float[Tensor, "r E-1"],
        anneal: float | Tensor,
        generator: Generator | None,
    ) -> Float[Tensor, "r _"]:
        """Inverse transform sampling of the coarse weights.  NeRF 2020, section 5.2."""
        final, padding = self.sampler.final, self.sampler.padding
        if self.config.field.encoding == "ipe":
            u = stratified_levels(len(s), final + 1, generator, s)
            return resample_edges(s, spread(w), u, padding, anneal)
        # A point's weight is that of the interval behind it; it is laid around the point, as NeRF 2020 does.
        u = stratified_levels(len(s), final, generator, s)
        middle = (s[:, 1:-1] + s[:, :-2]) / 2
        found = resample_edges(middle, w[:, 1:-1], u, padding, anneal)
        return _to_the_end(torch.cat([s[:, :-1], found], 1).sort(1).values)


def spread(w: Float[Tensor, "r N"]) -> Float[Tensor, "r N"]:
    """Weights widened to their neighbours: the mean of the larger of each two.  Mip-NeRF eq. 18."""
    sides = nn.functional.pad(w, (1, 1))
    larger = torch.maximum(sides[:, 1:], sides[:, :-1])
    return (larger[:, 1:] + larger[:, :-1]) / 2


def _to_the_end(s: Float[Tensor, "r n"]) -> Float[Tensor, "r n+1"]:
    return torch.cat([s, torch.ones_like(s[:, :1])], 1)
