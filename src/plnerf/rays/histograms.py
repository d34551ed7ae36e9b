"""Histograms along rays that shall not lose what is thinner than their intervals: blur and dilation.

Zip-NeRF (Barron et al. 2023), section 3; Mip-NeRF 360, supplement A; InfoNeRF (Kim et al. 2022), section 3.

Letters, always in the last axis, as in `stepfun.py`: s the E = S + 1 edges in [0, 1], increasing; w the S
weights of the intervals, >= 0 and summing to at most 1.
"""

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import pad

FLOOR = 1e-5
"""Weights below it count as about this much where they are divided by, or their logarithm is taken."""


def blurred_weights(
    s: Float[Tensor, "r E"], w: Float[Tensor, "r E-1"], edges: Float[Tensor, "r P"], half_width: float
) -> Float[Tensor, "r P-1"]:
    """Weights between other edges of the histogram (s, w), blurred by a box.  Zip-NeRF, section 3.

    The box of half width h makes the piecewise constant density piecewise linear and its distribution
    function piecewise quadratic: C_h(x) = (D(x + h) - D(x - h)) / 2h, D the integral of the distribution
    function C before the blur.  In double, since the difference cancels for a small h; h = 0 does not blur.
    """
    s, w, edges, dtype = s.double(), w.double(), edges.double(), w.dtype
    if half_width == 0:
        below = _integrals(s, w, edges)[0]
    else:
        upper, lower = (_integrals(s, w, edges + h)[1] for h in (half_width, -half_width))
        below = (upper - lower) / (2 * half_width)
    return below.diff().clamp_min(0).to(dtype)


def _integrals(
    s: Float[Tensor, "r E"], w: Float[Tensor, "r E-1"], x: Float[Tensor, "r P"]
) -> tuple[Float[Tensor, "r P"], Float[Tensor, "r P"]]:
    """The distribution function of a histogram at x, and its integral up to x."""
    width = s.diff()
    density = pad(torch.where(width > 0, w / torch.where(width > 0, width, 1), 0), (0, 1))  # none beyond
    below = pad(w.cumsum(-1), (1, 0))
    area = pad(((below[:, 1:] + below[:, :-1]) / 2 * width).cumsum(-1), (1, 0))
    last = (torch.searchsorted(s.contiguous(), x.contiguous(), right=True) - 1).clamp_min(0)
    past = (x - s.gather(-1, last)).clamp_min(0)
    density, below, area = (value.gather(-1, last) for value in (density, below, area))
    return below + density * past, area + past * (below + density * past / 2)


def blurred_interlevel_loss(
    s: Float[Tensor, "r E"],
    w: Float[Tensor, "r E-1"],
    s_proposal: Float[Tensor, "r P"],
    w_proposal: Float[Tensor, "r P-1"],
    half_width: float,
) -> Float[Tensor, " r"]:
    """How much of the blurred weight a proposal lacks, anti-aliased interlevel loss.  Zip-NeRF, section 3.

    sum_j max(0, b_j - v_j)^2 / (v_j + FLOOR),   b the blurred weights and v the proposal's

    b is a constant.  Unlike the bound of Mip-NeRF 360 it asks for weight where the final histogram has it,
    not anywhere in the proposal's intervals that touch it, and the less a proposal has the louder: a wire
    moves smoothly between intervals, and one that a proposal sees nothing of still has a gradient.
    """
    with torch.no_grad():
        wanted = blurred_weights(s, w, s_proposal, half_width)
    return ((wanted - w_proposal).clamp_min(0).square() / (w_proposal + FLOOR)).sum(-1)


def dilate(s: Float[Tensor, "r E"], w: Float[Tensor, "r E-1"], half_width: float) -> Float[Tensor, "r E-1"]:
    """Weights of the histogram whose density is everywhere the largest within `half_width`, on its own edges.

    Max-dilation of Mip-NeRF 360, supplement A, which samples beside what it found since a proposal may be off
    by a part of an interval.  The dilated density is integrated over the intervals there are, instead of
    given new edges, and scaled to the total weight there was: `padding` keeps its meaning.
    """
    low, high = s[:, :-1] - half_width, s[:, 1:] + half_width
    density = w / s.diff().clamp_min(torch.finfo(w.dtype).eps)
    knots = torch.cat([s, low, high], -1).clamp(s[:, :1], s[:, -1:]).sort(-1).values
    middle = ((knots[:, 1:] + knots[:, :-1]) / 2).contiguous()
    first = torch.searchsorted(high, middle).clamp_max(w.shape[-1] - 1)
    last = torch.searchsorted(low, middle, right=True) - 1
    weight = _largest(density, first, torch.maximum(last, first)) * knots.diff()
    owner = torch.searchsorted(s[:, 1:-1].contiguous(), middle, right=True)
    spread = torch.maximum(torch.zeros_like(w).scatter_add(-1, owner, weight), w)
    total, spread_total = w.sum(-1, keepdim=True), spread.sum(-1, keepdim=True)
    return spread * (total / torch.where(spread_total > 0, spread_total, 1))


def _largest(
    v: Float[Tensor, "r S"], first: Int[Tensor, "r n"], last: Int[Tensor, "r n"]
) -> Float[Tensor, "r n"]:
    """max(v[first], ..., v[last]): two overlapping runs whose length is a power of 2, from a table of all."""
    size, runs = v.shape[-1], [v]
    while 2 ** len(runs) <= size:
        runs.append(torch.maximum(runs[-1], pad(runs[-1], (0, 2 ** (len(runs) - 1)))[:, -size:]))
    powers = 2 ** torch.arange(len(runs), device=v.device)
    level = torch.searchsorted(powers, last - first + 1, right=True) - 1
    table = torch.cat(runs, -1)
    left, right = level * size + first, level * size + last + 1 - powers[level]
    return torch.maximum(table.gather(-1, left), table.gather(-1, right))
