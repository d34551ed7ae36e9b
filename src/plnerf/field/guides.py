"""Where rays pass near known curves, so that samples can be laid there.

Letters: r rays o + t d, c curves (x, y(x), z(x)) of the scene frame, as in `curves.py`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from plnerf.detect.curves import Curve
from plnerf.rays.rays import Rays

ITERATIONS = 3
"""Newton steps to the closest approach; sag turns tangents by some degrees: each step gains two digits."""
MOST_OBLIQUE = 0.2
"""Sine of the angle to the curve below which a window grows no longer."""
WINDOWS = 2
"""Curves that a ray may meet: the closest ones."""


@dataclass(frozen=True)
class Guides:
    """c curves as tensors; `reach` is how far from a curve its conductor may be."""

    y: Float[Tensor, "c 2"]
    z: Float[Tensor, "c 3"]
    ends: Float[Tensor, "c 2"]
    reach: Float[Tensor, " c"]

    def __len__(self) -> int:
        return self.reach.shape[0]

    def to(self, device: torch.device | str) -> "Guides":
        """The same curves on another device."""
        return Guides(self.y.to(device), self.z.to(device), self.ends.to(device), self.reach.to(device))


@dataclass(frozen=True)
class Windows:
    """Where along the rays conductors may be: `WINDOWS` stretches, the same one twice where it is one."""

    low: Float[Tensor, "r k"]
    high: Float[Tensor, "r k"]
    curve: Int[Tensor, "r k"]
    hit: Bool[Tensor, " r"]
    """Whether there is one at all."""


def guides_of(curves: Sequence[Curve]) -> Guides:
    """Curves as tensors on the CPU."""
    return Guides(
        torch.tensor([curve.y for curve in curves], dtype=torch.float32),
        torch.tensor([curve.z for curve in curves], dtype=torch.float32),
        torch.tensor([curve.ends for curve in curves], dtype=torch.float32),
        torch.tensor([curve.reach for curve in curves], dtype=torch.float32),
    )


def windows(rays: Rays, guides: Guides, near: float) -> Windows:
    """The stretches of rays within reach of curves, beyond the distance `near`; nothing has a gradient."""
    with torch.no_grad():
        t, miss, oblique = closest_approach(rays, guides)
        reach = guides.reach + rays.radius[:, None] * t.clamp_min(0)
        half = reach / oblique.clamp_min(MOST_OBLIQUE)
        outside = torch.where((miss < reach) & (t - half > near), miss / reach, torch.inf)
        count = min(WINDOWS, len(guides))
        best, which = outside.topk(count, dim=1, largest=False)
        # A ray with one window has it twice: shapes do not depend on the data.
        which = torch.where(best.isfinite(), which, which[:, :1])
        t, half = t.gather(1, which), half.gather(1, which)
        return Windows(t - half, t + half, which, best[:, 0].isfinite())


def closest_approach(
    rays: Rays, guides: Guides
) -> tuple[Float[Tensor, "r c"], Float[Tensor, "r c"], Float[Tensor, "r c"]]:
    """Distance t along each ray where it comes closest to each curve, how close, and their angle's sine."""
    o, d = rays.origins[:, None], rays.directions[:, None]
    low, high = guides.ends.unbind(1)
    x = ((low + high) / 2).expand(len(rays), -1)
    for step in range(ITERATIONS + 1):
        point, tangent = _on_curves(guides, x)
        if step == 0:  # from the middle of the chord, along the chord
            first, last = (_on_curves(guides, end[None])[0] for end in (low, high))
            tangent = ((last - first) / (high - low)[:, None]).expand_as(point)
        apart = o - point
        b, dw = (d * tangent).sum(-1), (d * apart).sum(-1)
        ee = tangent.square().sum(-1)
        across = (ee - b * b).clamp_min(1e-6 * ee)
        if step == ITERATIONS:
            break
        x = (x + ((tangent * apart).sum(-1) - b * dw) / across).clamp(low, high)
    miss = (apart - dw[..., None] * d).norm(dim=-1)
    return -dw, miss, (across / ee).sqrt()


def _on_curves(
    guides: Guides, x: Float[Tensor, "r c"]
) -> tuple[Float[Tensor, "r c 3"], Float[Tensor, "r c 3"]]:
    """Points and tangents (1, y', z') at x."""
    z0, z1, z2 = guides.z.unbind(1)
    y0, y1 = guides.y.unbind(1)
    point = torch.stack([x, y0 + y1 * x, z0 + x * (z1 + z2 * x)], -1)
    return point, torch.stack([torch.ones_like(x), y1.expand_as(x), z1 + 2 * z2 * x], -1)
