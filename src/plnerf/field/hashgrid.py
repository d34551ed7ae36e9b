"""A trainable multi-resolution hash grid over the unit cube.  Instant-NGP, section 3.

Letters: L levels of N_l cells an axis, F features a level; sigma the size of the sampled ball.
"""

import math

import torch
from jaxtyping import Float
from torch import Generator, Tensor, nn

from plnerf.ops.backends import Backend
from plnerf.ops.dispatch import hash_encode, hash_position_gradient
from plnerf.ops.grid import GridShape


class HashGrid(nn.Module):
    """Encodes points of the unit cube as L F features."""

    cell: Tensor
    """Length of a cell of every level, 1/N_l."""

    def __init__(self, shape: GridShape, backend: Backend, generator: Generator) -> None:
        super().__init__()
        self.shape, self.backend = shape, backend
        # Uniform in +-1e-4, as Instant-NGP: near zero, so that the networks start from a constant field.
        self.table = nn.Parameter(torch.rand(shape.rows, shape.features, generator=generator) * 2e-4 - 1e-4)
        self.register_buffer(
            "cell", 1 / torch.tensor(shape.resolutions, dtype=torch.float32), persistent=False
        )

    def forward(
        self, unit: Float[Tensor, "*n 3"], size: Float[Tensor, "*n"] | None = None
    ) -> Float[Tensor, "*n LF"]:
        """Features of points; damped where they are balls of standard deviation `size`, without a gradient
        by it."""
        encoded = hash_encode(unit.reshape(-1, 3), self.table, self.shape, self.backend)
        encoded = encoded.reshape(*unit.shape[:-1], self.shape.width)
        return encoded if size is None else self.damped(encoded, size)

    def damping(self, size: Float[Tensor, "*n"]) -> Float[Tensor, "*n L"]:
        """Factor of each level's features for balls of standard deviation sigma = `size` in the unit cube.

            erf(1 / (sqrt(8) sigma N_l))      zip-NeRF, section 2
        the share of a ball, along one axis, within a cell's length around its centre: 1 for points, towards
        0 where cells are finer than the ball, so that they do not alias.
        """
        return torch.erf((1 / (math.sqrt(8) * size))[..., None] * self.cell)

    def damped(self, encoded: Float[Tensor, "*n LF"], size: Float[Tensor, "*n"]) -> Float[Tensor, "*n LF"]:
        """Encodings, each level times its `damping`."""
        with torch.no_grad():
            factor = self.damping(size)[..., None]
        by_level = encoded.unflatten(-1, (self.shape.levels, self.shape.features))
        return (by_level * factor).flatten(-2)

    def position_gradient(
        self, unit: Float[Tensor, "*n 3"], g_encoded: Float[Tensor, "*n LF"]
    ) -> Float[Tensor, "*n 3"]:
        """Gradient of <g_encoded, self(unit)> by position, in closed form and differentiable."""
        points, cotangent = unit.detach().reshape(-1, 3), g_encoded.reshape(-1, self.shape.width)
        g_unit = hash_position_gradient(points, cotangent, self.table, self.shape, self.backend)
        return g_unit.reshape(unit.shape)
