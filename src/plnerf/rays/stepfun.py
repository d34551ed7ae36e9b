"""Step functions along rays.  Mip-NeRF 360, section 3 and supplement A; NeRF 2020, section 5.2.

Letters, always in the last axis: s the E = S + 1 edges in [0, 1], increasing; w the S weights of the
intervals, >= 0 and summing to at most 1.
"""

import torch
from jaxtyping import Float
from torch import Generator, Tensor

from plnerf.rays.jitter import ray_jitter


def even_edges(
    rays: int, intervals: int, generator: Generator | None, like: Float[Tensor, "..."]
) -> Float[Tensor, "{rays} {intervals}+1"]:
    """Edges of equal intervals in [0, 1]; with a generator, each moved at random by up to half an interval.

    The stratified sampling of NeRF 2020 eq. 2, for edges.
    """
    edges = torch.linspace(0, 1, intervals + 1, dtype=like.dtype, device=like.device).expand(rays, -1)
    if generator is None:
        return edges.contiguous()
    jitter = ray_jitter(rays, intervals + 1, generator, like) - 0.5
    return (edges + jitter / intervals).clamp(0, 1)


def stratified_levels(
    rays: int, count: int, generator: Generator | None, like: Float[Tensor, "..."]
) -> Float[Tensor, "{rays} {count}"]:
    """Levels in [0, 1] of a distribution function, one in each of `count` strata: its middle, or with a
    generator a random place in it.
    """
    if generator is None:
        middles = (torch.arange(count, dtype=like.dtype, device=like.device) + 0.5) / count
        return middles.expand(rays, -1).contiguous()
    jitter = ray_jitter(rays, count, generator, like)
    return (torch.arange(count, dtype=like.dtype, device=like.device) + jitter) / count


def resample_edges(
    s: Float[Tensor, "r E"],
    w: Float[Tensor, "r E-1"],
    u: Float[Tensor, "r n"],
    padding: float = 1e-5,
    anneal: float | Tensor = 1.0,
) -> Float[Tensor, "r n"]:
    """Edges at levels u of the distribution function of the histogram w^anneal: inverse transform sampling.

    NeRF 2020, section 5.2.  Levels increase along a ray.  Every interval is given `padding` > 0 of weight on
    top, so that no place is lost for good and 0/0 cannot arise.
    """
    padded = w.pow(anneal) + padding
    cdf = torch.nn.functional.pad(padded.cumsum(-1), (1, 0))
    return interpolate(u, cdf / cdf[..., -1:], s)


def interpolate(
    x: Float[Tensor, "r n"], xs: Float[Tensor, "r E"], ys: Float[Tensor, "r E"]
) -> Float[Tensor, "r n"]:
    """The piecewise linear function through (xs, ys), xs increasing, at x; constant beyond the ends."""
    upper = torch.searchsorted(xs.contiguous(), x, right=True).clamp(1, xs.shape[-1] - 1)
    x0, x1 = xs.gather(-1, upper - 1), xs.gather(-1, upper)
    y0, y1 = ys.gather(-1, upper - 1), ys.gather(-1, upper)
    width = x1 - x0
    share = torch.where(width > 0, (x - x0) / torch.where(width > 0, width, 1), 0.5).clamp(0, 1)
    return y0 + share * (y1 - y0)


def outer_measure(
    s: Float[Tensor, "r E"], s_other: Float[Tensor, "r P"], w_other: Float[Tensor, "r P-1"]
) -> Float[Tensor, "r E-1"]:
    """Most weight the histogram (s_other, w_other) can have in each interval of s.  Mip-NeRF 360 eq. 12."""
    total = torch.nn.functional.pad(w_other.cumsum(-1), (1, 0))
    edges = s_other.contiguous()
    low = torch.searchsorted(edges, s[..., :-1].contiguous(), right=True) - 1
    high = torch.searchsorted(edges, s[..., 1:].contiguous(), right=False)
    last = total.shape[-1] - 1
    return total.gather(-1, high.clamp(0, last)) - total.gather(-1, low.clamp(0, last))


def interlevel_loss(
    s: Float[Tensor, "r E"],
    w: Float[Tensor, "r E-1"],
    s_proposal: Float[Tensor, "r P"],
    w_proposal: Float[Tensor, "r P-1"],
) -> Float[Tensor, " r"]:
    """How much weight w lies where the proposal could not have it.  Mip-NeRF 360 eq. 13.

    sum_i max(0, w_i - bound_i)^2 / w_i,   w and s being constants
    """
    s, w = s.detach(), w.detach()
    excess = (w - outer_measure(s, s_proposal, w_proposal)).clamp_min(0)
    return (excess**2 / (w + torch.finfo(w.dtype).eps)).sum(-1)


def distortion_loss(s: Float[Tensor, "r E"], w: Float[Tensor, "r E-1"]) -> Float[Tensor, " r"]:
    """How spread out the weight of a ray is.  Mip-NeRF 360 eq. 15.

    sum_ij w_i w_j |m_i - m_j| + 1/3 sum_i w_i^2 (s_{i+1} - s_i),  m the middles; the double sum in linear
    time: for sorted m it is 2 sum_i w_i (m_i W_i - M_i), W and M the exclusive sums of w and w m.
    """
    middle, width = (s[..., 1:] + s[..., :-1]) / 2, s.diff()
    weight_before = w.cumsum(-1) - w
    moment_before = (w * middle).cumsum(-1) - w * middle
    between = 2 * (w * (middle * weight_before - moment_before)).sum(-1)
    return between + (w**2 * width).sum(-1) / 3
