"""Where to look along a ray: two small density fields narrow even samples down.  Mip-NeRF 360, section 3.

Letters: t distances along rays in the scene frame, s in [0, 1] the warped distances, in which the first
samples are even: linear in t up to the knee, in 1/t beyond, half of the range to each (as nerfacto).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from jaxtyping import Float
from torch import Generator, Tensor

from plnerf.errors import ConfigError
from plnerf.field.guides import Windows
from plnerf.rays.rays import Rays
from plnerf.rays.stepfun import even_edges, stratified_levels
from plnerf.render.guided import guide_edges
from plnerf.render.ray_ops import TORCH, RayOps


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
    """Weight given to every interval before resampling: with 32 intervals half of the samples go on
    looking where nothing was found yet, which is how thin things are found (nerfacto: 0.01 of many more
    intervals)."""
    dilation: float = 0.0
    """How far, in s, a round looks beside what the round before found: its density is raised to the largest
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
class Histogram:
    """What a round of sampling found: E = S + 1 edges s in [0, 1] and S weights w."""

    s: Float[Tensor, "r E"]
    w: Float[Tensor, "r E-1"]


def to_distance(s: Float[Tensor, "*n"], config: SamplerConfig, ops: RayOps = TORCH) -> Float[Tensor, "*n"]:
    """Distance t of warped distance s: near at 0, far at 1."""
    return ops.to_distance(s, config.near, config.far, config.knee)


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
        t = to_distance(s, config, ops)
        w = ops.weights_from_density(density(rays, t), t)
        history.append(Histogram(s, w))
        u = stratified_levels(len(rays), intervals + 1, generator, s)
        found = ops.dilate(s, w.detach(), config.dilation) if config.dilation else w.detach()
        s = ops.resample_edges(s, found, u, config.padding, anneal)
    if windows is not None and (count := int(config.guided * config.final)):
        s = guide_edges(s, windows, count, (config.near, config.far, config.knee), generator)
    return s, tuple(history)
