"""Cases of the hash encoding, of its gradient by position, of a proposal's density, and of a table's step.

Letters: n points, L levels, F features, H hidden units.
"""

import math
from collections.abc import Callable
from functools import partial

import torch
from jaxtyping import Float
from torch import Generator, Tensor

from plnerf.bench.case import Op, OpCase, Work, leaf
from plnerf.bench.ceilings import LINE_BYTES
from plnerf.ops import dispatch, reference
from plnerf.ops.backends import Backend
from plnerf.ops.grid import GridShape
from plnerf.rays.contraction import contract
from plnerf.rays.stepfun import even_edges
from plnerf.render.config import SamplerConfig
from plnerf.render.proposals import s_to_t

HIDDEN = 16


def hash_cases(
    backend: Backend, rays: int, proposals: int, final: int, *, small: bool = False
) -> list[OpCase]:
    """At Instant-NGP's size with random points, and at the sizes of a step with points along rays."""
    instant_ngp = GridShape(16, 16, 2048, 2, 10 if small else 19)
    training = GridShape(8, 16, 512, 4, 10 if small else 17)
    proposal = GridShape(5, 16, 128, 2, 10 if small else 15)
    spread = random_points(256 if small else 65536)
    return [
        _hash_encode("random", spread, instant_ngp, backend),
        _hash_encode("along rays", points_along_rays(rays, final), training, backend),
        _hash_position_gradient(points_along_rays(max(1, rays // 16), final), training, backend),
        _hash_mlp(points_along_rays(rays, proposals), proposal, backend),
        *_adam(points_along_rays(rays, final), training, backend),
    ]


def _hash_encode(what: str, points: Float[Tensor, "n 3"], grid: GridShape, backend: Backend) -> OpCase:
    n, lines = len(points), lines_of_points(points, grid)
    moved, flops = 4 * n * (3 + grid.width), encoding_flops(n, grid)
    return OpCase(
        name=f"hash encoding, {what}",
        shape=f"{n:,} points, {words(grid)}",
        setup=lambda generator: (points, random_table(grid, generator)),
        reference=partial(reference.hash_encode, grid=grid),
        kernel=partial(dispatch.hash_encode, grid=grid, backend=backend),
        forward=Work(moved, lines, flops),
        backward=Work(moved, 2 * lines, flops),
        table_bytes=level_bytes(grid),
    )


def _hash_position_gradient(points: Float[Tensor, "n 3"], grid: GridShape, backend: Backend) -> OpCase:
    n, lines, corners = len(points), lines_of_points(points, grid), len(points) * grid.levels * 8

    def setup(generator: Generator) -> tuple[Tensor, ...]:
        cotangent = torch.randn(n, grid.width, generator=generator)
        return points, leaf(cotangent), random_table(grid, generator)

    return OpCase(
        name="gradient by position",
        shape=f"{n:,} points along rays, {words(grid)}",
        setup=setup,
        reference=partial(reference.hash_position_gradient, grid=grid),
        kernel=partial(dispatch.hash_position_gradient, grid=grid, backend=backend),
        # A corner: its value 2F, three products of three and their sums.
        forward=Work(4 * n * (6 + grid.width), lines, corners * (2 * grid.features + 9)),
        # And backward: its share, and a multiply-add into both gradients.
        backward=Work(4 * n * (6 + 2 * grid.width), 3 * lines, corners * (4 * grid.features + 9)),
        table_bytes=level_bytes(grid),
    )


def _hash_mlp(points: Float[Tensor, "n 3"], grid: GridShape, backend: Backend) -> OpCase:
    n, lines, products = len(points), lines_of_points(points, grid), 2 * (grid.width + 1) * HIDDEN

    def setup(generator: Generator) -> tuple[Tensor, ...]:
        sizes = ((HIDDEN, grid.width), (HIDDEN,), (1, HIDDEN), (1,))
        weights = (leaf(torch.randn(size, generator=generator) / 2) for size in sizes)
        return points, random_table(grid, generator), *weights

    encoding = encoding_flops(n, grid)
    return OpCase(
        name="proposal density",
        shape=f"{n:,} points along rays, {words(grid)}, {HIDDEN} hidden units",
        setup=setup,
        reference=lambda x, table, *weights: reference.hash_mlp(x, table, grid, weights),
        kernel=lambda x, table, *weights: dispatch.hash_mlp(x, table, grid, weights, backend),
        forward=Work(4 * n * 4, lines, encoding + n * products),
        # The encoding again, or read back: what is less; gradients by inputs and by weights.
        backward=Work(4 * n * (4 + grid.width), 2 * lines, encoding + 2 * n * products),
        table_bytes=level_bytes(grid),
    )


def _adam(points: Float[Tensor, "n 3"], grid: GridShape, backend: Backend) -> list[OpCase]:
    """A step on the rows that a backward pass of the points has touched; none where there is no kernel."""
    kernel = dispatch.kernels(backend).adam_rows
    if kernel is reference.adam_rows:
        return []
    table = torch.zeros(grid.rows, grid.features, requires_grad=True)
    (made,) = torch.autograd.grad(reference.hash_encode(points, table, grid).sum(), table)
    touched = int((made != 0).any(-1).sum())

    def setup(generator: Generator) -> tuple[Tensor, ...]:
        param, m, v = (torch.rand(made.shape, generator=generator) for _ in range(3))
        return made, param, torch.zeros_like(made), m, v

    def step(adam_rows: Callable[..., None]) -> Op:
        def stepped(made: Tensor, *tensors: Tensor) -> tuple[Tensor, ...]:
            adam_rows(*tensors, rate=1e-2, betas=(0.9, 0.99), eps=1e-15, step=10)
            return tensors

        return stepped

    def prepare(made: Tensor, param: Tensor, grad: Tensor, m: Tensor, v: Tensor) -> None:
        grad.copy_(made)

    row = 4 * grid.features
    case = OpCase(
        name="Adam on a table",
        shape=f"{words(grid)}, {touched:,} of {grid.rows:,} rows touched",
        setup=setup,
        reference=step(reference.adam_rows),
        kernel=step(kernel),
        # Every gradient is read; of the touched rows four arrays are written and three more read.
        forward=Work(row * (grid.rows + 7 * touched), flops=12 * grid.features * touched),
        prepare=prepare,
    )
    return [case]


def encoding_flops(n: int, grid: GridShape) -> int:
    """A level: place in the cell 12, weights of its corners 16, and a multiply-add per corner and feature."""
    return n * grid.levels * (28 + 16 * grid.features)


def random_points(n: int) -> Float[Tensor, "{n} 3"]:
    """Points spread evenly over the unit cube: the worst a cache can meet."""
    return torch.rand(n, 3, generator=torch.Generator().manual_seed(1))


def points_along_rays(rays: int, intervals: int) -> Float[Tensor, "{rays}*{intervals} 3"]:
    """Middles of even intervals along random rays from near the origin, contracted, in the unit cube.

    As a training step's points lie, but for the resampling, which draws them closer together still.
    """
    generator = torch.Generator().manual_seed(2)
    origins = torch.rand(rays, 1, 3, generator=generator) * 0.6 - 0.3
    directions = torch.nn.functional.normalize(torch.randn(rays, 1, 3, generator=generator), dim=-1)
    t = s_to_t(even_edges(rays, intervals, generator, origins), SamplerConfig())
    middle = (t[:, 1:] + t[:, :-1])[..., None] / 2
    return ((contract(origins + middle * directions) + 2) / 4).reshape(-1, 3)


def random_table(grid: GridShape, generator: Generator) -> Float[Tensor, "rows F"]:
    """A table of a grid."""
    return leaf(torch.randn(grid.rows, grid.features, generator=generator))


def lines_of_points(points: Float[Tensor, "n 3"], grid: GridShape) -> int:
    """Lines of the table that the cell of each point needs on each level, summed."""
    total = 0
    corners = torch.tensor([[c & 1, c >> 1 & 1, c >> 2] for c in range(8)])
    for level, cells in enumerate(grid.resolutions):
        cell = (points * cells).floor().clamp(0, cells - 1).long()
        row = reference.vertex_row(cell[:, None] + corners, level, grid)
        line = (row * (4 * grid.features) // LINE_BYTES).sort(-1).values
        total += len(points) + int((line.diff() != 0).sum())
    return total


def level_bytes(grid: GridShape) -> int:
    """Size of the largest level: no more need be looked up at random at once, a level after the other."""
    return 4 * max(grid.sizes) * grid.features


def words(grid: GridShape) -> str:
    """A grid's size in words."""
    return f"{grid.levels} levels x {grid.features}, T = 2^{math.log2(max(grid.sizes)):.0f}"
