"""The volume rendering equations, one function each.  NeRF 2020, section 4 (paper eq. 7, 8).

Letters: r rays, S intervals; t the S+1 edges along a ray, sigma the density in 1/length, d_i = t_{i+1} - t_i,
w the weights; all lengths in the scene frame.
"""

import torch
from jaxtyping import Float
from torch import Tensor


def weights_from_density(sigma: Float[Tensor, "*r S"], t: Float[Tensor, "*r S+1"]) -> Float[Tensor, "*r S"]:
    """Probability that a ray ends in each interval.  NeRF 2020 eq. 3 and 5.

    w_i = (1 - exp(-sigma_i d_i)) exp(-sum_{j<i} sigma_j d_j)
    """
    depth = (sigma * t.diff()).float() if sigma.dtype in {torch.float16, torch.bfloat16} else sigma * t.diff()
    before = torch.nn.functional.pad(depth[..., :-1].cumsum(-1), (1, 0))  # exclusive sum; never inf - inf
    return -torch.expm1(-depth) * torch.exp(-before)


def accumulation(w: Float[Tensor, "*r S"]) -> Float[Tensor, "*r"]:
    """Probability that a ray ends anywhere: sum_i w_i."""
    return w.sum(-1)


def composite(w: Float[Tensor, "*r S"], value: Float[Tensor, "*r S c"]) -> Float[Tensor, "*r c"]:
    """The rendering sum, sum_i w_i v_i: colour or normals.  NeRF 2020 eq. 3."""
    return (w[..., None] * value).sum(-2)


def expected_depth(w: Float[Tensor, "*r S"], t: Float[Tensor, "*r S+1"]) -> Float[Tensor, "*r"]:
    """Mean distance at which a ray ends, given that it ends: sum_i w_i m_i / sum_i w_i, m the middles."""
    middle = (t[..., 1:] + t[..., :-1]) / 2
    total = w.sum(-1).clamp_min(torch.finfo(w.dtype).eps)
    return ((w * middle).sum(-1) / total).clamp(t[..., 0], t[..., -1])


def depth_deviation(w: Float[Tensor, "*r S"], t: Float[Tensor, "*r S+1"]) -> Float[Tensor, "*r"]:
    """Standard deviation of the distance at which a ray ends, given that it ends; 0 where no ray ends.

    The second central moment of the rendering sum (Ewen et al., These Magic Moments, 2025, arXiv 2503.14665),
    with where in its interval a ray ends as even: sum_i w_i ((m_i - d)^2 + d_i^2 / 12) / sum_i w_i, with the
    middles m_i and the expected distance d.
    """
    middle, half = (t[..., 1:] + t[..., :-1]) / 2, t.diff() / 2
    total = w.sum(-1).clamp_min(torch.finfo(w.dtype).eps)
    aside = middle - ((w * middle).sum(-1) / total)[..., None]
    return ((w * (aside**2 + half**2 / 3)).sum(-1) / total).sqrt()


def median_depth(w: Float[Tensor, "*r S"], t: Float[Tensor, "*r S+1"]) -> Float[Tensor, "*r"]:
    """Distance where the transmittance is one half, density constant in an interval; the far end if never."""
    ended = w.cumsum(-1)
    index = (ended < 0.5).sum(-1, keepdim=True)
    last = w.shape[-1] - 1
    inside = index.clamp(max=last)
    before = ended.gather(-1, inside) - w.gather(-1, inside)
    # Within the interval: (1 - before) exp(-share D) = 1/2 with D = -log(1 - alpha) its optical depth.
    transmittance = (1 - before).clamp_min(torch.finfo(w.dtype).eps)
    alpha = (w.gather(-1, inside) / transmittance).clamp(0, 1 - torch.finfo(w.dtype).eps)
    optical = (-torch.log1p(-alpha)).clamp_min(torch.finfo(w.dtype).eps)
    share = (torch.log(2 * transmittance).clamp_min(0) / optical).clamp(0, 1)
    t0, t1 = t.gather(-1, inside), t.gather(-1, inside + 1)
    crossed = t0 + share * (t1 - t0)
    return torch.where(index > last, t[..., -1:], crossed)[..., 0]
