"""The proposal field: density only, coarse and cheap.  Mip-NeRF 360, section 3; nerfacto."""

from jaxtyping import Float
from torch import Generator, Tensor, nn

from plnerf.field.config import DensityConfig
from plnerf.field.hashgrid import HashGrid
from plnerf.field.networks import density_activation, mlp
from plnerf.ops.backends import Backend
from plnerf.ops.dispatch import hash_mlp


class DensityField(nn.Module):
    """Positions in the unit cube to density.

    Positions are constants: the interlevel loss, which alone trains this field, shall not move cameras.
    """

    def __init__(self, config: DensityConfig, backend: Backend, generator: Generator) -> None:
        super().__init__()
        self.grid = HashGrid(config.grid, backend, generator)
        self.network = mlp([config.grid.width, config.hidden, 1], generator)

    def forward(self, unit: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n"]:
        first, last = (layer for layer in self.network if isinstance(layer, nn.Linear))
        weights = (first.weight, first.bias, last.weight, last.bias)
        grid = self.grid
        raw = hash_mlp(unit.detach().reshape(-1, 3), grid.table, grid.shape, weights, grid.backend)
        return density_activation(raw).reshape(unit.shape[:-1])
