"""Samples where a ray passes near a wire that was detected in the images.

A wire of some centimetres is hit by few of the samples that a histogram of metres spreads.  Where its
curve is known, some of a ray's edges are laid within its reach instead; whether anything is there stays the
colours' decision.
"""

import torch
from jaxtyping import Float
from torch import Generator, Tensor

from plnerf.field.guides import Windows
from plnerf.rays.jitter import ray_jitter
from plnerf.rays.warp import t_to_s


def guide_edges(
    s: Float[Tensor, "r E"],
    found: Windows,
    count: int,
    warp: tuple[float, float, float],
    generator: Generator | None,
) -> Float[Tensor, "r E"]:
    """The edges s, `count` of them moved into the windows of the curves where a ray meets any.

    `warp` holds near, far and knee.  With a generator the edges in a window are jittered together.
    """
    each = count // found.low.shape[1]
    even = torch.arange(each, device=s.device, dtype=s.dtype) / each
    # Of a window that stands twice, the second one's edges lie between the first one's.
    offset = torch.arange(found.low.shape[1], device=s.device, dtype=s.dtype)[:, None] / count
    jitter = torch.full((1, 1, 1), 0.5, device=s.device, dtype=s.dtype)
    if generator is not None:
        jitter = ray_jitter(len(s), 1, generator, s)[..., None]
    share = even + offset + jitter / count
    low, high = found.low[..., None], found.high[..., None]
    laid = t_to_s(low + share * (high - low), *warp).flatten(1)
    edges = s.shape[1]
    kept = torch.ones(edges, dtype=torch.bool)
    kept[torch.linspace(1, edges - 2, laid.shape[1]).round().long()] = False
    index = kept.nonzero()[:, 0].to(s.device)
    mixed = torch.cat([s[:, index], laid], 1).sort(1).values
    return torch.where(found.hit[:, None], mixed, s)
