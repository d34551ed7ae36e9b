"""The reference: every op in plain torch, for any float dtype, differentiable to any order; slow.

Letters: n points, L levels, F features, N_l cells an axis of level l.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float, Int
from torch import Tensor

from plnerf.ops.grid import HASH_PRIMES, GridShape, Interpolation
from plnerf.ops.layout import grid_layout


def interpolation_weight(u: Float[Tensor, "*n"], interpolation: Interpolation) -> Float[Tensor, "*n"]:
    """Weight of the upper of two vertices at fraction u in [0, 1] of the cell between them.

    linear: u.  cubic: the Hermite weight u^2 (3 - 2u), whose derivative vanishes at the vertices, so that
    encoded features have a continuous first derivative (paper 4.2.2, "cubic interpolation"; Instant-NGP,
    appendix A).
    """
    return u * u * (3 - 2 * u) if interpolation == "cubic" else u


def vertex_row(vertex: Int[Tensor, "*n 3"], level: int, grid: GridShape) -> Int[Tensor, "*n"]:
    """Row of the table that holds a vertex of a level.  Instant-NGP eq. 4 where the level is hashed."""
    n, start, dense, mask = (int(value) for value in grid_layout(grid)[level])
    x, y, z = vertex.unbind(-1)
    if dense:
        return start + x + (n + 1) * (y + (n + 1) * z)
    return start + ((x * HASH_PRIMES[0] ^ y * HASH_PRIMES[1] ^ z * HASH_PRIMES[2]) & mask)


def hash_encode(
    x: Float[Tensor, "n 3"], table: Float[Tensor, "rows F"], grid: GridShape
) -> Float[Tensor, "n LF"]:
    """Multi-resolution hash encoding of points in [0, 1]^3.  Instant-NGP, section 3.

    Features of the eight vertices of the cell around x, weighted by the interpolation of each axis, for every
    level side by side.  Points outside the cube continue the border cell's interpolant.
    """
    encoded = []
    for level, n in enumerate(grid.resolutions):
        scaled = x * n
        cell = scaled.detach().floor().clamp(0, n - 1)
        upper = interpolation_weight(scaled - cell, grid.interpolation)
        cell_index = cell.long()
        feature = torch.zeros(x.shape[0], grid.features, dtype=table.dtype, device=table.device)
        for corner in range(8):
            step = torch.tensor([corner & 1, corner >> 1 & 1, corner >> 2 & 1], device=x.device)
            weight = torch.where(step.bool(), upper, 1 - upper).prod(-1, keepdim=True)
            feature = feature + weight * table[vertex_row(cell_index + step, level, grid)]
        encoded.append(feature)
    return torch.cat(encoded, -1)


def hash_position_gradient(
    x: Float[Tensor, "n 3"], g_out: Float[Tensor, "n LF"], table: Float[Tensor, "rows F"], grid: GridShape
) -> Float[Tensor, "n 3"]:
    """Gradient of <g_out, hash_encode(x)> with respect to x, itself differentiable: what normals are
    made of.
    """
    with torch.enable_grad():
        position = x if x.requires_grad else x.detach().requires_grad_()
        encoded = hash_encode(position, table, grid)
        (g_x,) = torch.autograd.grad(encoded, position, g_out, create_graph=True)
    return g_x


def hash_mlp(
    x: Float[Tensor, "n 3"],
    table: Float[Tensor, "rows F"],
    grid: GridShape,
    weights: tuple[Tensor, Tensor, Tensor, Tensor],
) -> Float[Tensor, " n"]:
    """A hash encoding and a network of one hidden layer on top: w2 relu(w1 encoded + b1) + b2.

    weights: w1 (hidden, L F), b1 (hidden,), w2 (1, hidden), b2 (1,).
    """
    return mlp_on(hash_encode(x, table, grid), weights)


def mlp_on(
    encoded: Float[Tensor, "n LF"], weights: tuple[Tensor, Tensor, Tensor, Tensor]
) -> Float[Tensor, " n"]:
    """The network of `hash_mlp` on what is encoded already."""
    w1, b1, w2, b2 = weights
    return (torch.relu(encoded @ w1.T + b1) @ w2.T + b2)[:, 0]


def ray_mlp(
    x: Float[Tensor, "r S I"],
    const: Float[Tensor, "r S J"],
    base: Float[Tensor, "r H"],
    weights: Sequence[Tensor],
) -> Float[Tensor, "r S O"]:
    """A network of ReLU layers on the samples of rays, whose first bias differs from ray to ray.

    Inputs of a sample are x and const side by side, the latter mostly without gradient; what all samples of
    a ray share (direction, appearance) has gone through its part of the first layer already, into `base`.
    weights: w1 (H, I + J), then w and b of every further layer; no activation after the last one.
    """
    first, *rest = weights
    hidden = torch.cat([x, const], -1) @ first.T + base[:, None]
    for w, b in zip(rest[0::2], rest[1::2], strict=True):
        hidden = torch.relu(hidden) @ w.T + b
    return hidden


@torch.no_grad()
def adam_rows(
    param: Float[Tensor, "rows F"],
    grad: Float[Tensor, "rows F"],
    m: Float[Tensor, "rows F"],
    v: Float[Tensor, "rows F"],
    *,
    rate: float | Float[Tensor, ""],
    betas: tuple[float, float],
    eps: float,
    step: int | Float[Tensor, ""],
) -> None:
    """Adam on the rows of a table that have a gradient, which is set to zero after.  All in place.

    A row whose gradient is zero throughout is left alone: it neither moves nor do its moments decay, as
    tiny-cuda-nn does for grids.  Kingma and Ba 2015, algorithm 1; `step` counts from 1:

        m = β1 m + (1 - β1) g,   v = β2 v + (1 - β2) g²
        param -= rate m/(1 - β1^step) / (sqrt(v/(1 - β2^step)) + eps)
    """
    touched = (grad != 0).any(-1, keepdim=True)
    count = step.double() if isinstance(step, Tensor) else step  # 1 - β2 has few digits in float32
    m.copy_(torch.where(touched, betas[0] * m + (1 - betas[0]) * grad, m))
    v.copy_(torch.where(touched, betas[1] * v + (1 - betas[1]) * grad * grad, v))
    length = (v / (1 - betas[1] ** count)).sqrt() + eps
    param.sub_(torch.where(touched, rate / (1 - betas[0] ** count) * m / length, torch.zeros_like(m)))
    grad.zero_()
