"""Samples where a ray passes near a wire that was detected in the images.

A wire of some centimetres is hit by few of the samples that a histogram of metres spreads.  Where its
curve is known, some of a ray's edges are laid within its reach instead; whether anything is there stays the
colours' decision.
"""

import torch
from jaxtyping import Float
from torch import Generator, Tensor

from plnerf.field.guides import Windows
from plnerf.ops.backends import Backend
from plnerf.ops.dispatch import kernels
from plnerf.rays.jitter import ray_jitter
from plnerf.rays.warp import t_to_s, warp


def guide_edges(
    s: Float[Tensor, "r E"],
    found: Windows,
    count: int,
    span: tuple[float, float, float],
    generator: Generator | None,
    backend: Backend = "torch",
) -> Float[Tensor, "r E"]:
    """The edges s, `count` of them moved into the windows of the curves where a ray meets any.

    `span` holds near, far and knee.  With a generator the edges in a window are jittered together.
    """
    each, edges = count // found.low.shape[1], s.shape[1]
    jitter = s.new_full((len(s), 1), 0.5) if generator is None else ray_jitter(len(s), 1, generator, s)
    kept = torch.ones(edges, dtype=torch.bool)
    kept[torch.linspace(1, edges - 2, each * found.low.shape[1]).round().long()] = False
    fused = kernels(backend).on_rays
    if fused is not None and fused.lay_edges is not None:
        near, far, knee = span
        warped = (warp(near, knee), warp(far, knee), knee)
        return fused.lay_edges(s, found.low, found.high, found.hit, jitter, kept, count, warped)
    even = torch.arange(each, device=s.device, dtype=s.dtype) / each
    # Of a window that stands twice, the second one's edges lie between the first one's.
    offset = torch.arange(found.low.shape[1], device=s.device, dtype=s.dtype)[:, None] / count
    share = even + offset + jitter[..., None] / count
    low, high = found.low[..., None], found.high[..., None]
    laid = t_to_s(low + share * (high - low), *span).flatten(1)
    index = kept.nonzero()[:, 0].to(s.device)
    mixed = torch.cat([s[:, index], laid], 1).sort(1).values
    return torch.where(found.hit[:, None], mixed, s)
