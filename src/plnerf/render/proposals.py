"""Where to sample a ray: two small density fields narrow even samples down.  Mip-NeRF 360, section 3.

Letters: t distances along rays in the scene frame, s in [0, 1] the warped distances, in which the first
samples are even: linear in t up to the knee, in 1/t beyond, half of the range to each (as nerfacto).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from jaxtyping import Float
from torch import Generator, Tensor

from plnerf.field.guides import Windows
from plnerf.rays.rays import Rays
from plnerf.rays.stepfun import even_edges, stratified_levels
from plnerf.render.config import SamplerConfig
from plnerf.render.ray_ops import TORCH, RayOps


@dataclass(frozen=True)
class Histogram:
    """What a round of sampling found: E = S + 1 edges s in [0, 1] and S weights w."""

    s: Float[Tensor, "r E"]
    w: Float[Tensor, "r E-1"]


def s_to_t(s: Float[Tensor, "*n"], config: SamplerConfig, ops: RayOps = TORCH) -> Float[Tensor, "*n"]:
    """Distance t of warped distance s: near at 0, far at 1."""
    return ops.s_to_t(s, config.near, config.far, config.knee)


def sample_along_rays(
    rays: Rays,
    densities: Sequence[Callable[[Rays, Tensor], Tensor]],
    config: SamplerConfig,
    anneal: float | Tensor,
    generator: Generator | None,
    ops: RayOps = TORCH,
    windows: Windows | None = None,
) -> tuple[Float[Tensor, "r E"], tuple[Histogram, ...]]:
    """Edges s of the final intervals, and the histograms of the proposal rounds that led to them.

    `densities` maps rays and edges t (r, P+1) to densities (r, P), one for each round.  `anneal` in (0, 1]
    flattens the histograms early in training (w^anneal), so that a first wrong guess does not blind the
    sampler.  The edges carry no gradient: only the interlevel loss trains a proposal.
    """
    history: list[Histogram] = []
    first, *rounds = *config.proposals, config.final
    s = even_edges(len(rays), first, generator, rays.origins)
    for density, intervals in zip(densities, rounds, strict=True):
        t = s_to_t(s, config, ops)
        w = ops.weights_from_density(density(rays, t), t)
        history.append(Histogram(s, w))
        u = stratified_levels(len(rays), intervals + 1, generator, s)
        found = ops.dilate(s, w.detach(), config.dilation) if config.dilation else w.detach()
        s = ops.resample_edges(s, found, u, config.padding, anneal)
    if windows is not None and (count := int(config.guided * config.final)):
        s = ops.guide_edges(s, windows, count, (config.near, config.far, config.knee), generator)
    return s, tuple(history)
