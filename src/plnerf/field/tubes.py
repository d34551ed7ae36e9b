"""The field close to detected wires, in the wires' own coordinates.

A hash table of a scene is shared by everything in it: the few cells of a wire collide with the many of
ground and trees, whose gradients win, and a wire of some centimetres never becomes dense.  Around each curve
that was found in the images lies a tube; points inside of it are encoded along and across the curve in a
table of their own.  It holds density and feature vector like the field around it, free of any shape: whether
anything is there, and where, stays the colours' decision.

Letters: c curves of `reach` R; a point's offsets u (sideways) and v (up) from the curve at the same place s
of its base; n points.
"""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Generator, Tensor, nn

from plnerf.errors import ConfigError
from plnerf.field.config import TubeConfig
from plnerf.field.guides import Guides, Windows, to_bases
from plnerf.field.hashgrid import HashGrid
from plnerf.field.networks import density_and_feature, mlp
from plnerf.ops.backends import Backend
from plnerf.ops.dispatch import kernels
from plnerf.rays.rays import Rays

FIRST_DEPTH = 0.2
"""Optical depth across a new tube: thin enough to see through, thick enough to have a gradient."""
SLOTS = 16
"""Tubes side by side in the unit cube, and again as many rows of them."""


@dataclass(frozen=True)
class InTubes:
    """Which samples lie in a tube: their flat indices among all, their curves, and their unit coordinates."""

    index: Int[Tensor, " n"]
    curve: Int[Tensor, " n"]
    unit: Float[Tensor, "n 3"]


class TubeField(nn.Module):
    """Density and feature vector within reach of c curves."""

    def __init__(
        self, config: TubeConfig, feature: int, guides: Guides, backend: Backend, generator: Generator
    ) -> None:
        super().__init__()
        if len(guides) > SLOTS**2:
            raise ConfigError(f"A tube field holds {SLOTS**2} curves at most, but got {len(guides)}.")
        self.guides, self._along = guides, config.along
        self.grid = HashGrid(config.grid, backend, generator)
        self.network = mlp([config.grid.width, config.hidden, 1 + feature], generator)

    def locate(self, rays: Rays, t: Float[Tensor, "r E"], windows: Windows) -> InTubes:
        """The intervals of rays whose middles lie in the tube of one of the ray's windows."""
        fused = kernels(self.grid.backend).on_rays
        if fused is not None and fused.in_tubes is not None:
            return InTubes(*fused.in_tubes(
                rays.origins, rays.directions, t, windows.curve, windows.hit, self.guides.tensors,
                self._along, SLOTS,
            ))  # fmt: skip
        rows = windows.hit.nonzero()[:, 0]
        middle = (t[rows, 1:] + t[rows, :-1]) / 2
        points = rays.origins[rows, None] + middle[..., None] * rays.directions[rows, None]
        found: Tensor | None = None
        for k in range(windows.curve.shape[1]):
            curve = windows.curve[rows, k, None].expand_as(middle)
            inside, unit = self._in_tube(points, curve)
            if found is None:
                found, curves, units = inside, curve, unit
            else:
                other = inside & ~found
                curves = torch.where(other, curve, curves)
                units = torch.where(other[..., None], unit, units)
                found = found | other
        index = (rows[:, None] * middle.shape[1] + torch.arange(middle.shape[1], device=t.device))[found]
        return InTubes(index, curves[found], units[found])

    def forward(self, at: InTubes) -> tuple[Float[Tensor, " n"], Float[Tensor, "n G"]]:
        """Density in 1/length of the scene frame, and the feature vector."""
        return density_and_feature(self.raw(at))

    def raw(self, at: InTubes) -> Float[Tensor, "n O"]:
        """Logarithm of the density, not yet bounded, and feature vector of samples in tubes."""
        out = self.network(self.grid(at.unit))
        first = (FIRST_DEPTH / (2 * self.guides.reach)).log()[at.curve]
        return torch.cat([out[:, :1] + first[:, None], out[:, 1:]], 1)

    def replace(self, raw: Float[Tensor, "r S O"], at: InTubes) -> Float[Tensor, "r S O"]:
        """The samples' logarithms of density and feature vectors, with the tubes' own for those in tubes."""
        return raw.flatten(0, 1).index_copy(0, at.index, self.raw(at)).reshape(raw.shape)

    def _in_tube(
        self, points: Float[Tensor, "h S 3"], curve: Int[Tensor, "h S"]
    ) -> tuple[Bool[Tensor, "h S"], Float[Tensor, "h S 3"]]:
        """Whether points lie in the tubes of these curves, and where in the unit cube."""
        guides = self.guides
        apart = points - F.pad(guides.origin, (0, 1))[curve]
        s, y, z = to_bases(apart, guides.along[curve]).unbind(-1)
        y0, y1, y2 = guides.y[curve].unbind(-1)
        z0, z1, z2 = guides.z[curve].unbind(-1)
        low, high = guides.ends[curve].unbind(-1)
        reach = guides.reach[curve]
        u, v = (y - y0 - s * (y1 + y2 * s)) / reach, (z - z0 - s * (z1 + z2 * s)) / reach
        inside = (u * u + v * v < 1) & (s > low) & (s < high)
        along = self._along * (s - low) / (high - low)
        across = (curve % SLOTS + 0.5 * (u + 1)) / SLOTS
        upwards = (curve // SLOTS + 0.5 * (v + 1)) / SLOTS
        return inside, torch.stack([along, across, upwards], -1).clamp(0, 1)
