"""Where there is anything at all: a grid of densities that spares the field the empty intervals.

Instant-NGP (Mueller et al. 2022), section 5.4 and appendix E, in the contracted unit cube: each cell keeps
the largest density met there lately.  An interval whose cell has less than `least` of optical depth is
skipped.

Letters: C cells along an axis; r rays, S intervals; lengths in the scene frame.
"""

from collections.abc import Callable

import torch
from jaxtyping import Bool, Float, Int
from torch import Generator, Tensor, nn

from plnerf.field.config import OccupancyConfig


class OccupancyGrid(nn.Module):
    """Densities of C^3 cells; everything may be full until the first update."""

    density: Tensor
    met: Tensor

    def __init__(self, config: OccupancyConfig) -> None:
        super().__init__()
        self.config = config
        self.register_buffer("density", torch.zeros(config.cells**3))
        self.register_buffer("met", torch.zeros(config.cells**3, dtype=torch.bool))

    def full(self, unit: Float[Tensor, "r S 3"], t: Float[Tensor, "r S+1"]) -> Bool[Tensor, "r S"]:
        """Which intervals are to be evaluated; the last of a ray always: it is the background's colour."""
        cell = self._cell(unit)
        full = ~self.met[cell] | (self.density[cell] * t.diff() >= self.config.least)
        return torch.cat([full[:, :-1], torch.ones_like(full[:, -1:])], 1)

    @torch.no_grad()
    def update(self, density: Callable[[Tensor], Tensor], generator: Generator) -> None:
        """Samples some cells, each at a random place.  `density` maps (n, 3) in the unit cube to (n,)."""
        C, half, device = self.config.cells, self.config.samples // 2, self.density.device
        known = torch.nonzero(~self.met | (self.density >= 0.5 * self.density.mean()))[:, 0]
        pick = torch.rand(half, generator=generator).to(device)
        anywhere = torch.randint(C**3, (self.config.samples - half,), generator=generator).to(device)
        cells = torch.cat([known[(pick * len(known)).long()], anywhere])
        place = torch.rand(len(cells), 3, generator=generator).to(device)
        corner = torch.stack([cells // C**2, cells // C % C, cells % C], -1)
        found = density((corner + place) / C)
        self.density *= torch.where(self.met, self.config.decay, 1)
        self.density.scatter_reduce_(0, cells, found, "amax")
        self.met[cells] = True

    def _cell(self, unit: Float[Tensor, "*n 3"]) -> Int[Tensor, "*n"]:
        C = self.config.cells
        i, j, k = (unit * C).long().clamp(0, C - 1).unbind(-1)
        return (i * C + j) * C + k
