"""The warp along a ray in which first samples are even: nerfacto's.

Letters: t distances in units of the scene frame, s in [0, 1] warped distances: linear in t up to the knee, in
1/t beyond, half of the full range to each.
"""

import torch
from jaxtyping import Float
from torch import Tensor


def warp(t: float, knee: float) -> float:
    """Where t lies in the full range [0, 1]: t/(2 knee) up to the knee, 1 - knee/(2 t) beyond."""
    return t / (2 * knee) if t < knee else 1 - knee / (2 * t)


def s_to_t(s: Float[Tensor, "*n"], near: float, far: float, knee: float) -> Float[Tensor, "*n"]:
    """Distance t of warped distance s: near at 0, far at 1."""
    low, high = warp(near, knee), warp(far, knee)
    g = low + s * (high - low)
    rest = (1 - high) + (1 - s) * (high - low)  # 1 - g, without cancellation at the far end
    return torch.where(g < 0.5, 2 * knee * g, knee / (2 * rest))


def t_to_s(t: Float[Tensor, "*n"], near: float, far: float, knee: float) -> Float[Tensor, "*n"]:
    """Warped distance s of a distance t: the inverse of `s_to_t`, clamped to [0, 1]."""
    low, high = warp(near, knee), warp(far, knee)
    g = torch.where(t < knee, t / (2 * knee), 1 - knee / (2 * t.clamp_min(knee)))
    return ((g - low) / (high - low)).clamp(0, 1)
