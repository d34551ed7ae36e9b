"""A trainable multi-resolution hash grid over the contracted cube.  Instant-NGP, section 3."""

import torch
from jaxtyping import Float
from torch import Generator, Tensor, nn

from plnerf.ops.dispatch import Backend, hash_encode, hash_position_gradient
from plnerf.ops.grid import GridShape


class HashGrid(nn.Module):
    """Encodes points of the contracted cube [-2, 2]^3 as L F features."""

    def __init__(self, shape: GridShape, backend: Backend, generator: Generator) -> None:
        super().__init__()
        self.shape, self.backend = shape, backend
        # Uniform in +-1e-4, as Instant-NGP: near zero, so that the networks start from a constant field.
        self.table = nn.Parameter(torch.rand(shape.rows, shape.features, generator=generator) * 2e-4 - 1e-4)

    def forward(self, contracted: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n LF"]:
        unit = (contracted.reshape(-1, 3) + 2) / 4
        encoded = hash_encode(unit, self.table, self.shape, self.backend)
        return encoded.reshape(*contracted.shape[:-1], self.shape.width)

    def position_gradient(
        self, contracted: Float[Tensor, "*n 3"], g_encoded: Float[Tensor, "*n LF"]
    ) -> Float[Tensor, "*n 3"]:
        """Gradient of <g_encoded, self(contracted)> by position, in closed form and differentiable."""
        unit = (contracted.detach().reshape(-1, 3) + 2) / 4
        g_unit = hash_position_gradient(
            unit, g_encoded.reshape(-1, self.shape.width), self.table, self.shape, self.backend
        )
        return g_unit.reshape(contracted.shape) / 4
