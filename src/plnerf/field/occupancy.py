"""Where there is anything at all: a grid of densities that spares the field the empty intervals.

Instant-NGP (Mueller et al. 2022), section 5.4 and appendix E, in the contracted unit cube: each cell keeps
the largest density met there lately.  An interval whose cell promises less than `least` of optical depth is
not looked at.

Letters: C cells along an axis; r rays, S intervals; lengths in the scene frame.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Generator, Tensor, nn

from plnerf.errors import ConfigError


@dataclass(frozen=True)
class OccupancyConfig:
    """Size of the grid and how it is kept up to date."""

    cells: int = 64
    """Along an axis of the contracted cube (Instant-NGP: 128 for each of its cubes)."""
    least: float = 0.01
    """Optical depth below which an interval is passed over: that much of a ray's light at most."""
    every: int = 16
    """Steps between updates."""
    decay: float = 0.95
    """What is left of a cell's density at an update, unless more is met there."""
    looks: int = 1 << 15
    """Cells that an update looks at, half of them anywhere, half where something is."""

    def __post_init__(self) -> None:
        if min(self.cells, self.every, self.looks) < 1 or self.least <= 0 or not 0 < self.decay <= 1:
            raise ConfigError(
                "An occupancy grid needs cells, every and looks of 1 or more, least > 0 and 0 < decay <= 1, "
                f"but got {self}."
            )


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
        """Which intervals are to be looked at; the last of a ray always: it is the background's colour."""
        cell = self._cell(unit)
        full = ~self.met[cell] | (self.density[cell] * t.diff() >= self.config.least)
        return torch.cat([full[:, :-1], torch.ones_like(full[:, -1:])], 1)

    @torch.no_grad()
    def update(self, density: Callable[[Tensor], Tensor], generator: Generator) -> None:
        """Looks at some cells, each at a random place.  `density` maps (n, 3) in the unit cube to (n,)."""
        C, half, device = self.config.cells, self.config.looks // 2, self.density.device
        known = torch.nonzero(~self.met | (self.density >= 0.5 * self.density.mean()))[:, 0]
        pick = torch.rand(half, generator=generator).to(device)
        anywhere = torch.randint(C**3, (self.config.looks - half,), generator=generator).to(device)
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
