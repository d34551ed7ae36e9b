"""A trainable multi-resolution hash grid over the unit cube.  Instant-NGP, section 3."""

import torch
from jaxtyping import Float
from torch import Generator, Tensor, nn

from plnerf.ops.dispatch import Backend, hash_encode, hash_position_gradient
from plnerf.ops.grid import GridShape


class HashGrid(nn.Module):
    """Encodes points of the unit cube as L F features."""

    def __init__(self, shape: GridShape, backend: Backend, generator: Generator) -> None:
        super().__init__()
        self.shape, self.backend = shape, backend
        # Uniform in +-1e-4, as Instant-NGP: near zero, so that the networks start from a constant field.
        self.table = nn.Parameter(torch.rand(shape.rows, shape.features, generator=generator) * 2e-4 - 1e-4)

    def forward(self, unit: Float[Tensor, "*n 3"]) -> Float[Tensor, "*n LF"]:
        encoded = hash_encode(unit.reshape(-1, 3), self.table, self.shape, self.backend)
        return encoded.reshape(*unit.shape[:-1], self.shape.width)

    def position_gradient(
        self, unit: Float[Tensor, "*n 3"], g_encoded: Float[Tensor, "*n LF"]
    ) -> Float[Tensor, "*n 3"]:
        """Gradient of <g_encoded, self(unit)> by position, in closed form and differentiable."""
        points, cotangent = unit.detach().reshape(-1, 3), g_encoded.reshape(-1, self.shape.width)
        g_unit = hash_position_gradient(points, cotangent, self.table, self.shape, self.backend)
        return g_unit.reshape(unit.shape)
