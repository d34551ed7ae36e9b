"""Where rays pass near known wires, so that samples can be laid there.

Letters: r rays o + t d, c curves (x, y(x), z(x)) of the scene frame: y is linear and z quadratic in x, a
parabola in an upright plane, within millimetres of the catenary of the same sag.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from plnerf.line.frame import LineFrame
from plnerf.line.wire import Wire
from plnerf.rays.rays import Rays

ITERATIONS = 3
"""Newton steps to the closest approach; sag turns tangents by some degrees: each step gains two digits."""
MOST_OBLIQUE = 0.2
"""Sine of the angle to the curve below which a window grows no longer."""
WINDOWS = 2
"""Curves that a ray may meet: the closest ones."""


@dataclass(frozen=True)
class Guides:
    """c curves as tensors, scene frame."""

    y: Float[Tensor, "c 2"]
    """y = y[0] + y[1] x"""
    z: Float[Tensor, "c 3"]
    """z = z[0] + z[1] x + z[2] x^2"""
    ends: Float[Tensor, "c 2"]
    """Least and greatest x."""
    reach: Float[Tensor, " c"]
    """Distance from the curve within which the wire lies."""

    def __len__(self) -> int:
        return self.reach.shape[0]

    def to(self, device: torch.device | str) -> "Guides":
        """The same curves on another device."""
        return Guides(self.y.to(device), self.z.to(device), self.ends.to(device), self.reach.to(device))


@dataclass(frozen=True)
class Windows:
    """Where along the rays wires may be: `WINDOWS` stretches, the same one twice where it is one."""

    low: Float[Tensor, "r k"]
    high: Float[Tensor, "r k"]
    curve: Int[Tensor, "r k"]
    hit: Bool[Tensor, " r"]
    """Whether there is one at all."""


def guides_of(wires: Sequence[Wire], frame: LineFrame) -> Guides:
    """One or more upright wires that run along x, as tensors on the CPU.

    frame: the wires', with a scene.  Every wire must have a reach.
    """
    y, z, ends, reach = [], [], [], []
    for wire in wires:
        (x0, y0, z0), (x1, y1, z1), b = parabola(wire, frame)
        # t = (x - x0) / (x1 - x0) in y0 + (y1 - y0) t and z0 + (z1 - z0) t - 4 b t (1 - t)
        length = x1 - x0
        slope_y, slope_z, bend = (y1 - y0) / length, (z1 - z0 - 4 * b) / length, 4 * b / length**2
        y.append((y0 - slope_y * x0, slope_y))
        z.append((z0 - slope_z * x0 + bend * x0**2, slope_z - 2 * bend * x0, bend))
        ends.append((min(x0, x1), max(x0, x1)))
        reach.append(reach_in_scene(wire, frame))
    return Guides(*(torch.tensor(values, dtype=torch.float32) for values in (y, z, ends, reach)))


def parabola(wire: Wire, frame: LineFrame) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"], float]:
    """Ends of a wire and its sag b below the chord, scene frame.

    Its points are those of the chord, 4 b t (1 - t) lower, with t in [0, 1] along the chord.
    """
    ends = frame.to_scene(wire.points(np.array([0.0, wire.base.length_m])))
    sag = wire.drop_between(0.0, wire.base.length_m)
    return ends[0], ends[1], float(frame.to_scene(np.array([sag]))[0])


def scene_points(wire: Wire, frame: LineFrame, count: int) -> Float[np.ndarray, "m 3"]:
    """Points of a wire from end to end, as its guide has them, in the scene frame."""
    first, last, sag = parabola(wire, frame)
    t = np.linspace(0.0, 1.0, count)[:, None]
    return first + t * (last - first) - 4 * sag * t * (1 - t) * np.array([0.0, 0.0, 1.0])


def reach_in_scene(wire: Wire, frame: LineFrame) -> float:
    """Distance from the curve within which a wire lies, in scene units."""
    if wire.evidence.reach_m is None:
        raise ValueError(f"wire {wire.id} was not detected in images: it has no reach")
    return float(frame.to_scene(np.array([wire.evidence.reach_m]))[0])


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
