"""Where rays pass near known wires, so that samples can be laid there.

Letters: r rays o + t d, c curves (s, y(s), z(s)), each on a base of its own in the scene frame: s along it
from its middle, y to its left, z up.  y and z are quadratic in s: a parabola in the plane of the chord and
the load, within millimetres of the catenary of the same sag.  The load of an upright wire is downwards, and
its y linear.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor

from plnerf.line.frame import LineFrame
from plnerf.line.wire import Wire
from plnerf.ops.backends import Backend
from plnerf.ops.dispatch import kernels
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

    origin: Float[Tensor, "c 2"]
    """x and y of the point s = 0 of each base."""
    along: Float[Tensor, "c 2"]
    """Horizontal unit vectors of s."""
    y: Float[Tensor, "c 3"]
    """y = y[0] + y[1] s + y[2] s^2"""
    z: Float[Tensor, "c 3"]
    """z = z[0] + z[1] s + z[2] s^2"""
    ends: Float[Tensor, "c 2"]
    """Least and greatest s."""
    reach: Float[Tensor, " c"]
    """Distance from the curve within which the wire lies."""

    def __len__(self) -> int:
        return self.reach.shape[0]

    @property
    def tensors(self) -> tuple[Tensor, ...]:
        """The fields in their order."""
        return tuple(getattr(self, one.name) for one in fields(self))

    def to(self, device: torch.device | str) -> "Guides":
        """The same curves on another device."""
        return Guides(*(value.to(device) for value in self.tensors))


@dataclass(frozen=True)
class Windows:
    """Where along the rays wires may be: `WINDOWS` stretches, the same one twice where it is one."""

    low: Float[Tensor, "r k"]
    high: Float[Tensor, "r k"]
    curve: Int[Tensor, "r k"]
    hit: Bool[Tensor, " r"]
    """Whether there is one at all."""


def guides_of(wires: Sequence[Wire], frame: LineFrame) -> Guides:
    """One or more wires as tensors on the CPU, each on its own base.

    frame: the wires', with a scene.  Every wire must have a reach.
    """
    rows = [_row(wire, frame) for wire in wires]
    return Guides(
        *(torch.tensor(np.stack(values), dtype=torch.float32) for values in zip(*rows, strict=True))
    )


def _row(wire: Wire, frame: LineFrame) -> tuple[Float[np.ndarray, "*n"], ...]:
    """The values of `Guides` for one wire, float64."""
    base, (first, last, load) = wire.base, parabola(wire, frame)
    length = frame.to_scene(np.array([base.length_m]))[0]
    axes = np.stack([np.append(base.n, 0.0), [0.0, 0.0, 1.0]])  # of y and z
    middle = frame.to_scene((base.a + base.b) / 2)
    origin = np.append(middle, 0.0)
    # With t = s / length + 1/2:  (first + last) / 2 + (last - first) s / length + load (1 - 4 s^2 / length^2)
    y, z = (
        np.array([
            axis @ ((first + last) / 2 - origin + load),
            axis @ (last - first) / length,
            -4 * (axis @ load) / length**2,
        ])
        for axis in axes
    )
    ends = np.array([-0.5, 0.5]) * length
    return middle, base.u, y, z, ends, np.array(reach_in_scene(wire, frame))


def parabola(
    wire: Wire, frame: LineFrame
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Ends of a wire, and how far it hangs from the middle of its chord, scene frame.

    Its points are those of the chord and 4 t (1 - t) of that, with t in [0, 1] along the chord.
    """
    ends = frame.to_scene(wire.points(np.array([0.0, wire.base.length_m])))
    aside = math.tan(wire.swing_rad) * wire.base.n
    load = wire.drop_between(0.0, wire.base.length_m) * np.array([*aside, -1.0])
    return ends[0], ends[1], frame.to_scene(load)


def scene_points(wire: Wire, frame: LineFrame, count: int) -> Float[np.ndarray, "m 3"]:
    """Points of a wire from end to end, as its guide has them, in the scene frame."""
    first, last, load = parabola(wire, frame)
    t = np.linspace(0.0, 1.0, count)[:, None]
    return first + t * (last - first) + 4 * t * (1 - t) * load


def reach_in_scene(wire: Wire, frame: LineFrame) -> float:
    """Distance from the curve within which a wire lies, in scene units."""
    if wire.evidence.reach_m is None:
        raise ValueError(f"wire {wire.id} was not detected in images: it has no reach")
    return float(frame.to_scene(np.array([wire.evidence.reach_m]))[0])


def windows(rays: Rays, guides: Guides, near: float, backend: Backend = "torch") -> Windows:
    """The stretches of rays within reach of curves, beyond the distance `near`; nothing has a gradient."""
    count, fused = min(WINDOWS, len(guides)), kernels(backend).on_rays
    if fused is not None and fused.windows is not None:
        return Windows(*fused.windows(
            rays.origins, rays.directions, rays.radius, guides.tensors, near, MOST_OBLIQUE, ITERATIONS, count
        ))  # fmt: skip
    with torch.no_grad():
        t, miss, oblique = closest_approach(rays, guides)
        reach = guides.reach + rays.radius[:, None] * t.clamp_min(0)
        half = reach / oblique.clamp_min(MOST_OBLIQUE)
        outside = torch.where((miss < reach) & (t - half > near), miss / reach, torch.inf)
        best, which = outside.topk(count, dim=1, largest=False)
        # A ray with one window has it twice: shapes do not depend on the data.
        which = torch.where(best.isfinite(), which, which[:, :1])
        t, half = t.gather(1, which), half.gather(1, which)
        return Windows(t - half, t + half, which, best[:, 0].isfinite())


def closest_approach(
    rays: Rays, guides: Guides
) -> tuple[Float[Tensor, "r c"], Float[Tensor, "r c"], Float[Tensor, "r c"]]:
    """Distance t along each ray where it comes closest to each curve, how close, and their angle's sine."""
    o = to_bases(rays.origins[:, None] - F.pad(guides.origin, (0, 1)), guides.along)
    d = to_bases(rays.directions[:, None].expand_as(o), guides.along)
    low, high = guides.ends.unbind(1)
    s = ((low + high) / 2).expand(len(rays), -1)
    for step in range(ITERATIONS + 1):
        point, tangent = _on_curves(guides, s)
        if step == 0:  # from the middle of the chord, along the chord
            first, last = (_on_curves(guides, end[None])[0] for end in (low, high))
            tangent = ((last - first) / (high - low)[:, None]).expand_as(point)
        apart = o - point
        b, dw = (d * tangent).sum(-1), (d * apart).sum(-1)
        ee = tangent.square().sum(-1)
        across = (ee - b * b).clamp_min(1e-6 * ee)
        if step == ITERATIONS:
            break
        s = (s + ((tangent * apart).sum(-1) - b * dw) / across).clamp(low, high)
    miss = (apart - dw[..., None] * d).norm(dim=-1)
    return -dw, miss, (across / ee).sqrt()


def to_bases(vectors: Float[Tensor, "*b 3"], along: Float[Tensor, "*#b 2"]) -> Float[Tensor, "*b 3"]:
    """Vectors of the scene frame by their parts along bases, to the left of them, and up."""
    x, y, z = vectors.unbind(-1)
    ux, uy = along.unbind(-1)
    return torch.stack([ux * x + uy * y, ux * y - uy * x, z], -1)


def _on_curves(
    guides: Guides, s: Float[Tensor, "r c"]
) -> tuple[Float[Tensor, "r c 3"], Float[Tensor, "r c 3"]]:
    """Points and tangents (1, y', z') at s, each on its own base."""
    y0, y1, y2 = guides.y.unbind(1)
    z0, z1, z2 = guides.z.unbind(1)
    point = torch.stack([s, y0 + s * (y1 + y2 * s), z0 + s * (z1 + z2 * s)], -1)
    return point, torch.stack([torch.ones_like(s), y1 + 2 * y2 * s, z1 + 2 * z2 * s], -1)
